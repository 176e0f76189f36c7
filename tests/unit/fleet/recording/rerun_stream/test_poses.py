"""Poses of drawn parts against hand-computed numbers and a plain product of 4x4 matrices."""

import math

import numpy as np
import pytest

from fleet.recording.rerun_stream.poses import (
    ArmChain,
    ackermann_angles,
    arm_parts,
    car_link_poses,
    car_parts,
    quat_from_matrix,
    quat_multiply,
    snapped,
)
from fleet.robots import ARMS, ArmTeam
from fleet.robots.cars.racecar import racecar_spec


def quat_rotate(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Turn a vector by a quaternion xyzw: v' = v + 2 w (u x v) + 2 u x (u x v)."""
    u, w = quat[:3], quat[3]
    across = 2 * np.cross(u, vector)
    return vector + w * across + np.cross(u, across)


def matrix_of(quat: np.ndarray) -> np.ndarray:
    return np.column_stack([quat_rotate(quat, axis) for axis in np.eye(3)])


def turn_z(angle: float) -> np.ndarray:
    made = np.eye(4)
    made[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    return made


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    half = math.sqrt(0.5)
    np.testing.assert_allclose(quat_rotate(np.array([0, 0, half, half]), np.array([1.0, 0, 0])), [0, 1, 0], atol=1e-15)


@pytest.mark.parametrize("quat", [(0, 0, 0, 1), (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0.5, -0.5, 0.5, 0.5)])
def test_quaternion_of_a_matrix_gives_the_matrix_back(quat: tuple[float, ...]) -> None:
    matrix = matrix_of(np.array(quat, float))
    np.testing.assert_allclose(matrix_of(quat_from_matrix(matrix)), matrix, atol=1e-15)


def test_product_of_quaternions_applies_the_right_one_first() -> None:
    a, b = np.array([0.5, -0.5, 0.5, 0.5]), np.array([0.6, 0.0, 0.0, 0.8])
    np.testing.assert_allclose(matrix_of(quat_multiply(a, b)), matrix_of(a) @ matrix_of(b), atol=1e-15)


def test_wheels_of_a_car_that_faces_north() -> None:
    car = racecar_spec()
    links = car_link_poses(car, np.array([[[2.0, 3.0, math.pi / 2]]]), np.zeros((1, 1)), np.zeros((1, 1)))
    np.testing.assert_allclose(links["body"][0][0, 0], [2.0, 3.0, 0.0])
    np.testing.assert_allclose(links["rear_left"][0][0, 0], [1.9, 3.0, 0.05])
    np.testing.assert_allclose(links["front_right"][0][0, 0], [2.1, 3.325, 0.05])


def test_a_wheel_rolls_forward_about_its_axle() -> None:
    car = racecar_spec()
    links = car_link_poses(car, np.zeros((1, 1, 3)), np.zeros((1, 1)), np.full((1, 1), math.pi / 2))
    top = quat_rotate(links["rear_left"][1][0, 0], np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(top, [1.0, 0.0, 0.0], atol=1e-15)


def test_steered_wheels_turn_about_one_centre() -> None:
    car = racecar_spec()
    left, right = ackermann_angles(car.wheelbase_m, car.track_m, np.array([0.3, -0.3, 0.0]))
    radius = 0.325 / math.tan(0.3)
    assert left[0] == pytest.approx(math.atan(0.325 / (radius - 0.1)))
    assert right[0] == pytest.approx(math.atan(0.325 / (radius + 0.1)))
    assert (left[1], right[1]) == (pytest.approx(-right[0]), pytest.approx(-left[0]))
    assert (left[2], right[2]) == (0.0, 0.0)


def test_arm_links_equal_the_product_of_matrices() -> None:
    arm = ARMS["iiwa"].spec()
    base = np.array([[0.0, 0.0, 0.0, 0.0], [3.0, 1.0, 0.1, 2.0]])
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 2, 7))
    positions, quats = ArmChain(ArmTeam.alike(arm, 2)).link_poses(base, q)
    for f, m in np.ndindex(3, 2):
        world_from_link = turn_z(base[m, 3])
        world_from_link[:3, 3] = base[m, :3]
        for joint in range(7):
            world_from_link = world_from_link @ arm.base_from_joint[joint] @ turn_z(q[f, m, joint])
            position, quat = positions[joint + 1, f, m], quats[joint + 1, f, m]
            np.testing.assert_allclose(position, world_from_link[:3, 3], atol=1e-12)
            np.testing.assert_allclose(matrix_of(quat), world_from_link[:3, :3], atol=1e-12)


def test_parts_hold_every_triangle_whether_or_not_wheels_turn() -> None:
    car = racecar_spec()
    apart, together = car_parts(car, wheels=True), car_parts(car, wheels=False)
    assert [part.link for part in apart] == ["body", "rear_left", "rear_right", "front_left", "front_right"]
    assert [part.link for part in together] == ["body"]
    assert sum(len(part.mesh.triangles) for part in apart) == len(together[0].mesh.triangles)


def test_wheels_that_are_part_of_the_body_stand_where_they_would_turn() -> None:
    car = racecar_spec()
    links = car_link_poses(car, np.zeros((1, 1, 3)), np.zeros((1, 1)), np.zeros((1, 1)))
    wheel = next(part for part in car_parts(car, wheels=True) if part.link == "front_left")
    expected = wheel.mesh.positions + links["front_left"][0][0, 0]
    body = car_parts(car, wheels=False)[0].mesh.positions
    assert np.abs(body[:, None] - expected[::100][None]).sum(axis=2).min(axis=0).max() < 1e-6


def test_the_tool_of_an_arm_belongs_to_its_last_link() -> None:
    arm = ARMS["iiwa"].spec()
    made = arm_parts(arm)
    assert [part.link for part in made] == [f"link_{k}" for k in range(8)]
    reach = made[-1].mesh.positions[:, 2].max()
    assert reach == pytest.approx(arm.tool_length_m, abs=0.02)


def test_snapped_coordinates_are_within_a_quarter_of_a_millimetre_and_repeat() -> None:
    values = np.random.default_rng(0).uniform(-50.0, 50.0, 1000)
    assert np.abs(snapped(values) - values).max() <= 0.5 / 4096 + 1e-12
    np.testing.assert_array_equal(snapped(values + 1e-6 * np.sign(snapped(values) - values)), snapped(values))
