"""Pose estimator: exact without noise, millimetres with it, and awake when a car is moved."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from fleet.robots.cars.models import CarModels
from fleet.robots.cars.racecar import racecar_spec
from fleet.robots.estimator import PoseEstimator
from fleet.world.kinematic import BicycleCars

SPEC = racecar_spec()


def errors(estimator: PoseEstimator, tick_s: float, n_cars: int, ticks: int) -> npt.NDArray[np.float64]:
    """Weave at 1 m/s; returns estimate minus truth, shape (ticks, n_cars, 3)."""
    cars = BicycleCars(CarModels.alike(SPEC, n_cars), np.zeros((n_cars, 3)), tick_s, 0.0125)
    out = []
    for tick in range(ticks):
        out.append(estimator.update(cars.poses.copy(), cars.speeds, cars.steering) - cars.poses)
        cars.step(np.tile([0.6 * math.sin(2.0 * tick * tick_s), 1.0], (n_cars, 1)))
    error = np.array(out)
    error[..., 2] = (error[..., 2] + math.pi) % (2 * math.pi) - math.pi
    return error


@pytest.mark.parametrize("tick_s", [1 / 60, 0.05])
def test_rms_error_while_driving(tick_s: float) -> None:
    estimator = PoseEstimator(CarModels.alike(SPEC, 20), tick_s, rng=np.random.default_rng(0))
    error = errors(estimator, tick_s, 20, 200)[40:]
    assert np.sqrt(np.mean(np.sum(error[..., :2] ** 2, axis=-1))) < 0.0045
    assert math.degrees(np.sqrt(np.mean(error[..., 2] ** 2))) < 0.17


def test_without_noise_and_latency_the_estimate_is_the_truth() -> None:
    estimator = PoseEstimator(
        CarModels.alike(SPEC, 3), 0.05, noise_m=0, noise_rad=0, latency_ticks=0, rng=np.random.default_rng(0)
    )
    assert np.all(errors(estimator, 0.05, 3, 100) == 0.0)


def test_latency_alone_is_predicted_away() -> None:
    estimator = PoseEstimator(
        CarModels.alike(SPEC, 1), 0.05, noise_m=0, noise_rad=0, latency_ticks=4, rng=np.random.default_rng(0)
    )
    assert np.abs(errors(estimator, 0.05, 1, 200)).max() < 1e-3  # 0.2 m are driven in the time of four ticks


def test_standing_car_is_known_better_and_better() -> None:
    estimator = PoseEstimator(CarModels.alike(SPEC, 50), 0.05, rng=np.random.default_rng(1))
    truth, still = np.tile([3.0, 2.0, 1.0], (50, 1)), np.zeros(50)
    spread = [float(np.std(estimator.update(truth, still, still)[:, 0] - 3.0)) for _ in range(200)]
    assert spread[0] == 0.0
    assert max(spread) < 0.003


def test_pushed_car_is_noticed_within_a_second() -> None:
    estimator = PoseEstimator(CarModels.alike(SPEC, 1), 0.05, rng=np.random.default_rng(2))
    still = np.zeros(1)
    for _ in range(200):
        estimator.update(np.zeros((1, 3)), still, still)
    pushed = np.array([[0.0, 0.3, 0.5]])
    for _ in range(20):
        estimate = estimator.update(pushed, still, still)
    assert np.abs(estimate - pushed)[0, :2].max() < 0.02
    assert abs(estimate[0, 2] - 0.5) < 0.02


def test_yaw_across_pi_is_followed() -> None:
    estimator = PoseEstimator(CarModels.alike(SPEC, 1), 0.05, rng=np.random.default_rng(3))
    cars = BicycleCars(CarModels.alike(SPEC, 1), np.array([[0.0, 0.0, math.pi - 0.1]]), 0.05, 0.0125)
    for _ in range(100):
        estimate = estimator.update(cars.poses.copy(), cars.speeds, cars.steering)
        off = (estimate[0, 2] - cars.poses[0, 2] + math.pi) % (2 * math.pi) - math.pi
        assert abs(off) < 0.03
        cars.step(np.array([[0.5, 1.0]]))


def test_same_seed_gives_the_same_estimates() -> None:
    runs = [
        errors(PoseEstimator(CarModels.alike(SPEC, 2), 0.05, rng=np.random.default_rng(5)), 0.05, 2, 50)
        for _ in range(2)
    ]
    assert np.array_equal(runs[0], runs[1])


@pytest.mark.parametrize("factor", [5.0, 12.0, 20.0])
def test_a_burst_of_noise_is_not_believed(factor: float) -> None:
    n_cars = 20
    estimator = PoseEstimator(CarModels.alike(SPEC, n_cars), 0.05, rng=np.random.default_rng(4))
    truth, still = np.zeros((n_cars, 3)), np.zeros(n_cars)
    for _ in range(40):
        estimator.update(truth, still, still)
        assert not estimator.in_doubt.any()
        assert not estimator.any_in_doubt
    for car in range(n_cars):
        estimator.blur(car, factor)
    off_m, in_doubt = [], []
    for _ in range(100):
        off_m.append(np.hypot(*estimator.update(truth, still, still)[:, :2].T))
        in_doubt.append(estimator.in_doubt)
        assert estimator.any_in_doubt == estimator.in_doubt.any()
    assert np.mean(np.array(off_m) < 0.05) > 0.9  # a measurement is off by 0.06 m and more
    assert np.mean(in_doubt) > 0.3
