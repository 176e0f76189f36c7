"""Skid steering, gait, inertial estimate and descriptions of robots that are told a speed and a yaw rate."""

from __future__ import annotations

import math
from dataclasses import fields
from xml.etree import ElementTree

import numpy as np
import pytest

from fleet.robots.differential import TwistLimits
from fleet.robots.twist import TWIST_ROBOTS
from fleet.robots.twist.a1 import JOINTS, TROT, a1_urdf
from fleet.robots.twist.husky import ROLLERS, SKID, WHEELS, husky_spec, husky_urdf, wheel_places
from fleet.robots.twist.inertial import InertialConfig, InertialEstimator
from fleet.robots.twist.trot import LEGS, Trot, standing_angles, two_links

TICK_S = 1 / 60
NOTHING = InertialConfig(
    gyro_noise_radps=0.0,
    gyro_bias_radps=0.0,
    accelerometer_noise_mps2=0.0,
    odometer_noise_mps=0.0,
    odometer_scale=0.0,
    fix_noise_m=0.0,
    fix_noise_rad=0.0,
)
"""Sensors without errors."""


def masses(text: str) -> float:
    return sum(float(mass.attrib["value"]) for mass in ElementTree.fromstring(text).iter("mass"))


def test_skidding_makes_the_track_nearly_twice_as_wide() -> None:
    rims = SKID.rims(np.array([[0.0, 1.0], [1.0, 0.0], [0.5, -0.5]]))
    np.testing.assert_allclose(rims[0], [-0.5203125, 0.5203125])  # 1.875 x 0.555 m / 2
    np.testing.assert_allclose(rims[1], [1.0, 1.0])
    np.testing.assert_allclose(SKID.twists(rims), [[0.0, 1.0], [1.0, 0.0], [0.5, -0.5]])


def test_simulated_wheels_roll_without_what_the_real_ones_scrub() -> None:
    contacts = SKID.contacts(SKID.rims(np.array([[0.3, 1.0]])))
    np.testing.assert_allclose(contacts, [[0.3 - 0.2854, 0.3 + 0.2854]], atol=0.003)


@pytest.mark.parametrize("name", TWIST_ROBOTS)
def test_every_limit_and_size_has_a_source(name: str) -> None:
    spec = TWIST_ROBOTS[name]()
    sizes = {"mass_kg", "max_payload_kg", "front_m", "rear_m", "half_width_m", "height_m"}
    assert set(spec.sources) == sizes | {field.name for field in fields(TwistLimits)}
    assert all(spec.sources.values())
    assert spec.name == name


def test_the_husky_s_description_weighs_what_its_specification_says_and_has_four_wheels() -> None:
    text = husky_urdf()
    # The link of the supports has a gram of its own: no link may be without mass.
    assert masses(text) == pytest.approx(husky_spec().mass_kg, abs=0.002)
    root = ElementTree.fromstring(text)
    assert {joint.attrib["name"] for joint in root.findall("joint")} == {
        *(f"{roller}_spin" for roller in ROLLERS),
        "supports_fixed",
    }
    assert len(WHEELS) == len(wheel_places()) == 4
    supports = root.findall("link[@name='supports']/collision/geometry/sphere")
    radii = [float(sphere.attrib["radius"]) for sphere in supports]
    roller = root.find("link[@name='left_roller']/collision/geometry/sphere")
    assert roller is not None
    assert len(radii) == 4
    assert max(radii) < float(roller.attrib["radius"])


def test_the_a1_s_description_has_our_tray_and_all_joints() -> None:
    root = ElementTree.fromstring(a1_urdf())
    assert set(JOINTS) <= {joint.attrib["name"] for joint in root.findall("joint")}
    assert len(root.findall("link[@name='tray']/collision")) == 5
    assert masses(a1_urdf()) == pytest.approx(12.76, abs=0.01)


@pytest.mark.parametrize(("x", "down"), [(0.0, 0.28), (0.1, 0.25), (-0.08, 0.3), (0.0, 0.399)])
def test_two_links_put_the_foot_where_it_should_be(x: float, down: float) -> None:
    hip, knee = two_links(0.2, x, down)
    # Angles are about y: a link that hangs down and turns by q ends at (-sin q, -cos q).
    foot = -0.2 * np.array([math.sin(hip) + math.sin(hip + knee), math.cos(hip) + math.cos(hip + knee)])
    np.testing.assert_allclose(foot, [x, -down], atol=1e-9)
    assert knee < 0


def test_a_foot_out_of_reach_leaves_the_leg_straight() -> None:
    _, knee = two_links(0.2, 0.0, 0.9)
    assert -0.1 < knee < 0.0


def feet(targets: np.ndarray) -> np.ndarray:
    """Feet x, y beside their places and z below the hips, of the joint angles, shape (4, 3)."""
    places = []
    for leg in range(4):
        roll, hip, knee = targets[3 * leg : 3 * leg + 3]
        side = -1.0 if LEGS[leg].endswith("R") else 1.0
        x = -TROT.link_m * (math.sin(hip) + math.sin(hip + knee))
        down = TROT.link_m * (math.cos(hip) + math.cos(hip + knee))
        out = side * TROT.hip_m
        y, z = out * math.cos(roll) + down * math.sin(roll), out * math.sin(roll) - down * math.cos(roll)
        places.append((x, y - out, z))
    return np.array(places)


def test_a_robot_that_is_told_nothing_stands() -> None:
    trot = Trot(TROT, 1, 1 / 120)
    targets = trot.joint_targets(np.zeros((1, 3)))
    np.testing.assert_allclose(targets[0], standing_angles(TROT))


@pytest.mark.parametrize("command", [[0.4, 0.0, 0.0], [0.0, 0.0, 0.5], [0.2, 0.05, -0.4]])
def test_feet_that_stand_move_with_the_floor_and_two_always_stand(command: list[float]) -> None:
    trot, step = Trot(TROT, 1, 1 / 120), 1 / 120
    told = np.array([command])
    before = None
    for tick in range(240):
        now = feet(trot.joint_targets(told)[0])
        standing = now[:, 2] < -TROT.height_m + 1e-6
        assert standing.sum() in (2, 4)
        if before is not None and tick > 120:
            vx, vy, rate = command[0] / TROT.speed_gain, command[1] / TROT.speed_gain, command[2] / TROT.yaw_gain
            for leg in np.flatnonzero(standing & (before[:, 2] < -TROT.height_m + 1e-6)):
                end = 1.0 if LEGS[leg].startswith("F") else -1.0
                side = -1.0 if LEGS[leg].endswith("R") else 1.0
                x, y = end * TROT.foot_x_m + before[leg, 0], side * TROT.foot_y_m + before[leg, 1]
                floor = np.array([-(vx - rate * y), -(vy + rate * x)])
                np.testing.assert_allclose((now - before)[leg, :2] / step, floor, atol=1e-6)
        before = now.copy()


def test_a_robot_that_is_told_to_stand_brings_its_feet_home() -> None:
    trot = Trot(TROT, 1, 1 / 120)
    for _ in range(100):
        trot.joint_targets(np.array([[0.4, 0.0, 0.2]]))
    for _ in range(90):
        targets = trot.joint_targets(np.zeros((1, 3)))
    np.testing.assert_allclose(feet(targets[0])[:, 2], -TROT.height_m, atol=1e-9)
    np.testing.assert_allclose(feet(targets[0])[:, :2], 0.0, atol=0.01)


def moved(config: InertialConfig, *, seconds: float, seed: int = 0) -> tuple[InertialEstimator, np.ndarray]:
    """A robot goes round in a circle of 1 m radius at 0.5 m/s; the estimator and its true pose."""
    estimator = InertialEstimator(np.zeros((1, 3)), TICK_S, rng=np.random.default_rng(seed), config=config)
    pose = np.zeros(3)
    for _ in range(round(seconds / TICK_S)):
        pose = pose + TICK_S * np.array([0.5 * math.cos(pose[2]), 0.5 * math.sin(pose[2]), 0.5])
        estimator.update(pose.reshape(1, 3), np.array([[0.5, 0.0, 0.5]]), np.zeros((1, 2)))
    return estimator, pose


def test_without_errors_the_estimate_is_the_truth() -> None:
    estimator, pose = moved(NOTHING, seconds=10.0)
    np.testing.assert_allclose(estimator.poses[0, :2], pose[:2], atol=0.01)
    np.testing.assert_allclose(estimator.poses[0, 2], pose[2], atol=1e-9)


def test_fixes_keep_the_estimate_near_and_without_them_it_drifts() -> None:
    near = [
        np.hypot(*(e.poses[0, :2] - p[:2]))
        for e, p in (moved(InertialConfig(), seconds=60.0, seed=k) for k in range(5))
    ]
    drifting = InertialConfig(fix_every_ticks=0)
    far = [np.hypot(*(e.poses[0, :2] - p[:2])) for e, p in (moved(drifting, seconds=60.0, seed=k) for k in range(5))]
    assert max(near) < 0.02
    assert np.mean(far) > 3 * np.mean(near)


def test_the_gyro_s_constant_error_is_learned() -> None:
    config = InertialConfig(gyro_bias_radps=0.05, gyro_noise_radps=0.0)
    estimator, _ = moved(config, seconds=120.0)
    assert abs(estimator.motions[0, 2] - 0.5) < 0.01


def test_the_accelerometer_corrects_the_lean_in_the_long_run_and_a_fall_is_felt() -> None:
    estimator = InertialEstimator(np.zeros((1, 3)), TICK_S, rng=np.random.default_rng(0), config=NOTHING)
    leaning = np.array([[0.8, 0.1]])
    for _ in range(600):
        estimator.update(np.zeros((1, 3)), np.zeros((1, 3)), leaning)
    np.testing.assert_allclose(estimator.leans, leaning, atol=1e-6)
    assert estimator.fallen.tolist() == [True]
