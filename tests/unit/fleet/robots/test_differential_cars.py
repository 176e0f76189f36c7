"""Cars that are told a yaw rate beside cars that steer: each moves, is followed and is estimated by its own drive."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fleet.robots import CARS
from fleet.robots.cars.models import CarModels
from fleet.robots.estimator import PoseEstimator
from fleet.robots.followers import Followers, follower_of
from fleet.robots.pursuit import Follower, PathBuffer
from fleet.robots.twist.path import straight, turn
from fleet.world.kinematic import BicycleCars, UnlikeCars

TICK_S = 1 / 20
BOTH = CarModels.named(("racecar", "husky", "racecar"))
HUSKY = CARS["husky"].spec()


def test_a_racecar_beside_a_husky_drives_as_among_its_like() -> None:
    start = np.array([[0.0, 0.0, 0.3], [5.0, 0.0, 0.0], [0.0, 5.0, 1.0]])
    mixed, alike = (
        UnlikeCars(BOTH, start, TICK_S, 1 / 80),
        BicycleCars(BOTH.some(np.array([0, 2])), start[[0, 2]], TICK_S, 1 / 80),
    )
    for tick in range(60):
        told = np.array([[0.4 * math.sin(tick / 9), 0.8], [0.7, 0.3], [-0.2, 0.5]])
        mixed.step(told)
        alike.step(told[[0, 2]])
    np.testing.assert_array_equal(mixed.poses[[0, 2]], alike.poses)
    np.testing.assert_array_equal(mixed.steering[[0, 2]], alike.steering)


def test_a_husky_answers_a_yaw_rate_and_turns_on_the_spot() -> None:
    cars = UnlikeCars(CarModels.alike(HUSKY, 1), np.zeros((1, 3)), TICK_S, 1 / 80)
    for _ in range(40):
        cars.step(np.array([[0.8, 0.0]]))
    assert cars.steering[0] == pytest.approx(0.8, abs=1e-3)
    assert cars.poses[0, 2] == pytest.approx(0.8 * 2.0, rel=0.1)
    assert np.hypot(*cars.poses[0, :2]) < 1e-9


def test_a_pose_is_carried_on_by_a_yaw_rate_where_a_car_does_not_steer() -> None:
    models = CarModels.alike(HUSKY, 1)
    estimator = PoseEstimator(models, TICK_S, latency_ticks=1, noise_m=0.0, noise_rad=0.0, rng=np.random.default_rng(0))
    pose, rate = np.zeros((1, 3)), np.array([0.5])
    estimate = estimator.update(pose, np.zeros(1), rate)
    for _ in range(20):
        pose = pose + np.array([[0.0, 0.0, 0.5 * TICK_S]])
        estimate = estimator.update(pose, np.zeros(1), rate)
    np.testing.assert_allclose(estimate, pose, atol=1e-9)


def test_each_car_is_driven_along_its_path_by_its_own_follower() -> None:
    assert isinstance(follower_of(CarModels.named(("racecar",)), TICK_S), Follower)
    follower = follower_of(BOTH, TICK_S)
    assert isinstance(follower, Followers)
    start = np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 6.0, 0.0]])
    cars, paths = UnlikeCars(BOTH, start, TICK_S, 1 / 80), PathBuffer(3)
    for car, pose in enumerate(start):
        paths.reset(car, pose)
        paths.append(car, *(turn(pose, math.pi / 2) if car == 1 else straight(pose, 1.5)))
    paths.append(1, *straight(np.array([0.0, 3.0, math.pi / 2]), 1.5))
    ends = np.array([paths.end_s(car) for car in range(3)])
    for _ in range(200):
        told = follower.commands(paths, cars.poses.copy(), cars.speeds.copy(), ends, np.ones(3))
        cars.step(told)
    np.testing.assert_allclose(cars.poses[[0, 2], 0], 1.5, atol=0.01)
    np.testing.assert_allclose(cars.poses[1], [0.0, 4.5, math.pi / 2], atol=0.02)
    np.testing.assert_allclose(follower.progress, ends, atol=0.01)
    assert follower.standing.all()


def test_a_car_that_turns_on_the_spot_stands_still_when_it_must_not_drive() -> None:
    models = CarModels.alike(HUSKY, 1)
    follower, paths = follower_of(models, TICK_S), PathBuffer(1)
    paths.reset(0, np.zeros(3))
    paths.append(0, *turn(np.zeros(3), 1.0))
    for _ in range(5):
        told = follower.commands(paths, np.zeros((1, 3)), np.zeros(1), np.array([paths.end_s(0)]), np.zeros(1))
        assert not told.any()
    told = follower.commands(paths, np.zeros((1, 3)), np.zeros(1), np.array([paths.end_s(0)]), np.ones(1))
    assert told[0, 0] > 0.0


def test_a_fleet_has_as_many_kinds_of_trays_as_its_models_do() -> None:
    assert [hull.name for hull in BOTH.hulls] == ["racecar", "husky"]
    assert BOTH.tray_of.tolist() == [0, 1, 0]
    assert len(CarModels.named(("racecar", "racecar")).hulls) == 1


def test_a_husky_that_is_put_somewhere_stands_and_front_wheels_stay_as_they_are() -> None:
    cars = UnlikeCars(BOTH, np.zeros((3, 3)), TICK_S, 1 / 80)
    for _ in range(20):
        cars.step(np.array([[0.4, 0.5], [0.8, 0.3], [0.0, 0.0]]))
    assert cars.steering[0] == pytest.approx(0.4)
    assert cars.steering[1] == pytest.approx(0.8, abs=0.05)
    for car in (0, 1):
        cars.put(car, np.array([2.0, 3.0, 0.5]))
    assert cars.steering[0] == pytest.approx(0.4)
    assert cars.steering[1] == cars.speeds[1] == 0.0
    cars.step(np.zeros((3, 2)))
    np.testing.assert_array_equal(cars.poses[1], [2.0, 3.0, 0.5])
