"""The free kinematic car: today's is that of the kinematic world, and a fit finds the parameters that made a drive."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fleet.arrays import FloatArray
from fleet.robots.cars.models import CarModels
from fleet.robots.cars.racecar import racecar_spec
from fleet.scale.car_model import CarModel, residuals, simulated_speeds, simulated_steering, simulated_turns
from fleet.scale.drives import DriveRecord, circles, speed_steps, steering_steps
from fleet.scale.fit import AS_DRIVEN, LAG_S, SPEED, STEERING, TURNING, fit_car
from fleet.world.kinematic import BicycleCars

TICK_S = 1 / 60
TODAY = CarModel.today(racecar_spec())


def held(commands: FloatArray) -> FloatArray:
    """Each command for a second, of one car."""
    return np.repeat(commands, 60, axis=0)[:, None, :]


def bicycle_drive(commands: FloatArray) -> DriveRecord:
    cars = BicycleCars(CarModels.alike(racecar_spec(), 1), np.zeros((1, 3)), TICK_S, TICK_S)
    states = [(cars.poses.copy(), cars.speeds.copy(), cars.steering.copy())]
    for command in commands:
        cars.step(command)
        states.append((cars.poses.copy(), cars.speeds.copy(), cars.steering.copy()))
    poses, speeds, steering = (np.array(part) for part in zip(*states, strict=True))
    return DriveRecord(tick_s=TICK_S, commands=commands, poses=poses, speeds=speeds, steering=steering)


def model_drive(model: CarModel, commands: FloatArray) -> DriveRecord:
    """What a car does that is exactly the model."""
    n = len(commands)
    still = np.zeros((n + 1, 1))
    drive = DriveRecord(tick_s=TICK_S, commands=commands, poses=np.zeros((n + 1, 1, 3)), speeds=still, steering=still)
    drive = replace(drive, speeds=simulated_speeds(model, drive), steering=simulated_steering(model, drive))
    poses = np.zeros((n + 1, 1, 3))
    poses[1:, :, 2] = np.cumsum(simulated_turns(model, drive), axis=0)
    return replace(drive, poses=poses)


def test_today_is_the_car_of_the_kinematic_world() -> None:
    rng = np.random.default_rng(0)
    drive = bicycle_drive(held(np.concatenate((speed_steps(6, rng), steering_steps(6, rng), circles(6, rng)))))
    assert simulated_speeds(TODAY, drive) == pytest.approx(drive.speeds, abs=1e-12)
    assert simulated_steering(TODAY, drive) == pytest.approx(drive.steering, abs=1e-12)
    found = residuals(TODAY, drive)
    assert found.speed_mps < 1e-9
    assert found.steering_rad < 1e-9
    assert found.yaw_rate_radps < 1e-9
    assert found.ahead_m < 1e-9


def test_a_lag_leaves_37_per_cent_after_its_time() -> None:
    model = replace(TODAY, max_accel_mps2=1e6, speed_lag_s=0.1, speed_gain=1.1)
    drive = model_drive(model, held(np.array([[0.0, 1.0]])))
    assert 1.1 - drive.speeds[6, 0] == pytest.approx(1.1 * math.exp(-1.0))


def test_a_car_that_turns_round_comes_by_a_stand() -> None:
    speeds = model_drive(TODAY, held(np.array([[0.0, 1.0], [0.0, -1.0]]))).speeds[:, 0]
    assert 0.0 in speeds[60:].tolist()
    assert speeds[-1] < 0.0


def test_a_fit_finds_what_made_a_drive() -> None:
    true = CarModel(
        max_accel_mps2=4.0,
        max_brake_mps2=6.0,
        speed_lag_s=0.03,
        speed_gain=0.98,
        max_steering_rate_radps=3.0,
        steering_lag_s=0.04,
        wheelbase_m=0.33,
        grip_mps2=6.0,
    )
    rng = np.random.default_rng(1)
    made = [model_drive(true, held(make(20, rng))) for make in (speed_steps, steering_steps, circles)]
    start = replace(TODAY, speed_lag_s=LAG_S, steering_lag_s=LAG_S)
    fit = fit_car(start, SPEED + STEERING + TURNING, speed=made[0], steering=made[1], turning=made[2])
    assert fit.model.numbers == pytest.approx(true.numbers, rel=1e-3)
    assert set(fit.sigma) == {*SPEED, *STEERING, *TURNING}
    # The same drives, the same numbers.
    again = fit_car(start, SPEED + STEERING + TURNING, speed=made[0], steering=made[1], turning=made[2])
    assert (again.model.numbers == fit.model.numbers).all()


def test_what_a_drive_does_not_tell_is_said_and_what_is_held_stays() -> None:
    straight = model_drive(TODAY, held(np.array([[0.0, 1.0], [0.0, 0.5]])))
    start = replace(TODAY, speed_lag_s=LAG_S, steering_lag_s=LAG_S)
    fit = fit_car(start, AS_DRIVEN, speed=straight, steering=straight, turning=straight)
    assert math.isinf(fit.sigma["wheelbase_m"])
    assert math.isinf(fit.sigma["steering_lag_s"])
    assert fit.model.max_accel_mps2 == TODAY.max_accel_mps2
    assert "max_accel_mps2" not in fit.sigma
