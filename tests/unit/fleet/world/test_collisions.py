"""Collisions in the kinematic world: who overlaps is set apart and stops, who drives away is free."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
import pytest

from fleet.errors import ConfigError
from fleet.world.collisions import SLOP_M
from fleet.world.kinematic import KinematicConfig, KinematicWorld
from fleet.world.scene import Scene

FloatArray = npt.NDArray[np.float64]


def world_of(hall: Scene, poses: list[tuple[float, float, float]], contact: str = "stop") -> KinematicWorld:
    """Return a world of cars at these poses, in which no arm stands."""
    scene = dataclasses.replace(
        hall,
        car_start=np.array(poses),
        arms=hall.arms.part(()),
        arm_base=hall.arm_base[:0],
        arm_start=hall.arm_start[:0],
    )
    return KinematicWorld(scene, KinematicConfig(contact=contact))


def drive(world: KinematicWorld, speeds: list[float], n_ticks: int, steering: float = 0.0) -> None:
    """Let all cars drive."""
    commands = np.column_stack((np.full(len(speeds), steering), speeds))
    for _ in range(n_ticks):
        world.step(commands, np.zeros((0, 7)), np.zeros((0, 7)), np.zeros(0, dtype=np.bool_))


def outline_gap(world: KinematicWorld, scene: Scene, one: int, other: int) -> float:
    """Distance that the outline of one car reaches into another, negative = inside, by points 2 mm apart."""
    car, poses = scene.car, world.car_poses()
    u, v = np.linspace(-car.rear_m, car.front_m, 250), np.linspace(-car.half_width_m, car.half_width_m, 140)
    sides = [np.column_stack((u, np.full_like(u, y))) for y in (-car.half_width_m, car.half_width_m)]
    ends = [np.column_stack((np.full_like(v, x), v)) for x in (-car.rear_m, car.front_m)]
    local = np.concatenate(sides + ends)

    def turned(yaw: float) -> FloatArray:
        return np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])

    points = (local @ turned(poses[one, 2]) + poses[one, :2] - poses[other, :2]) @ turned(poses[other, 2]).T
    outside = np.maximum(
        np.abs(points[:, 0] - (car.front_m - car.rear_m) / 2) - (car.front_m + car.rear_m) / 2,
        np.abs(points[:, 1]) - car.half_width_m,
    )
    return float(outside.min())


@pytest.mark.parametrize(
    ("other", "speeds"),
    [
        ((4.2, 3.0, math.pi), [1.0, 1.0]),
        ((4.2, 3.0, 0.0), [1.5, 0.0]),
        ((4.2, 2.0, math.pi / 2), [1.0, 1.0]),
        ((4.2, 3.05, 2.6), [0.8, 0.4]),
    ],
    ids=["head on", "from behind", "across", "askew"],
)
def test_cars_that_meet_touch_and_do_not_overlap(
    hall: Scene, other: tuple[float, float, float], speeds: list[float]
) -> None:
    world = world_of(hall, [(3.0, 3.0, 0.0), other])
    for _ in range(60):
        drive(world, speeds, 1)
        # One tick's way is left to the passes: bodies part along one axis at a time.
        assert outline_gap(world, hall, 0, 1) > -2.5 * SLOP_M
    assert world.contacts().robot >= 1


def test_a_car_that_runs_into_another_stops_and_is_free_to_back_out(hall: Scene) -> None:
    world = world_of(hall, [(3.0, 3.0, 0.0), (4.2, 3.0, math.pi)])
    drive(world, [1.0, 1.0], 60)
    assert np.abs(world.car_speeds()).max() < 0.1
    stands = world.car_poses()
    assert stands[0, 0] + 0.41 == pytest.approx(stands[1, 0] - 0.41, abs=0.01)
    drive(world, [-0.5, 0.0], 30)
    assert world.car_poses()[0, 0] < stands[0, 0] - 0.4
    assert world.car_poses()[1] == pytest.approx(stands[1], abs=0.01)


def test_a_car_slides_along_what_it_touches_at_a_small_angle(hall: Scene) -> None:
    world = world_of(hall, [(2.8, 3.0, 0.05), (3.0, 3.295, 0.0)])
    drive(world, [1.0, 0.0], 60)
    assert world.contacts().robot >= 1
    assert world.car_poses()[0, 0] > 4.0


def test_walls_stop_cars(hall: Scene) -> None:
    ends = {}
    for contact in ("pass", "stop"):
        world = world_of(hall, [(7.0, 3.0, 0.0)], contact)
        drive(world, [2.0], 60)
        ends[contact] = world.car_poses()[0, 0]
        assert world.contacts().static >= 1
    wall = hall.boxes[0].centre_m[0] - hall.boxes[0].half_m[0]
    assert ends["stop"] + hall.car.front_m == pytest.approx(wall, abs=2 * SLOP_M)
    assert ends["pass"] > wall


def test_friction_holds_a_nose_until_its_car_reverses(hall: Scene) -> None:
    held, slides = (world_of(hall, [(7.0, 3.0, 0.1)], contact) for contact in ("hold", "stop"))
    for world in (held, slides):
        drive(world, [2.0], 60)
    at_wall = held.car_poses()[0]
    for world in (held, slides):
        drive(world, [2.0], 60, steering=0.8)
    assert held.car_poses()[0] == pytest.approx(at_wall, abs=0.005)
    assert slides.car_poses()[0, 2] - at_wall[2] > 0.3
    assert held.car_speeds()[0] == 0.0
    drive(held, [-0.5], 30, steering=-0.5)
    assert held.car_poses()[0, 0] < at_wall[0] - 0.2
    assert held.car_poses()[0, 2] > at_wall[2] + 0.1


def test_a_nose_that_meets_a_wall_askew_slides_along_it(hall: Scene) -> None:
    world = world_of(hall, [(7.0, 3.0, 0.9)], "hold")
    drive(world, [1.0], 60)
    at_wall = world.car_poses()[0]
    drive(world, [1.0], 20)
    assert world.car_poses()[0, 1] > at_wall[1] + 0.02


def test_who_touches_nobody_drives_as_without_contact_to_the_last_bit(hall: Scene) -> None:
    poses = [(3.0, 3.0, 0.0), (3.0, 4.0, 0.0)]
    worlds = [world_of(hall, poses, contact) for contact in ("pass", "stop", "hold")]
    for world in worlds:
        drive(world, [1.0, 0.7], 30, steering=0.05)
    assert len({world.state_bytes() for world in worlds}) == 1
    assert KinematicConfig().contact == "pass"


def test_a_queue_that_is_pushed_from_behind_stays_apart(hall: Scene) -> None:
    world = world_of(hall, [(2.0 + 0.502 * k, 3.0, 0.0) for k in range(4)])
    drive(world, [1.5, 0.0, 0.0, 0.0], 40)
    gaps = np.diff(np.sort(world.car_poses()[:, 0]))
    assert gaps.min() > 0.5 - 0.01
    assert world.car_poses()[0, 0] < 2.3


def test_an_unknown_contact_is_refused() -> None:
    with pytest.raises(ConfigError, match="contact is 'bounce'; valid: pass, stop, hold"):
        KinematicConfig(contact="bounce")
