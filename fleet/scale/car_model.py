"""CarModel: the kinematic car with its parameters free, and how well it says what a physical car does.

`fleet.world.kinematic.BicycleCars` drives a bicycle whose speed and steering reach their commands within a tick unless
a limit holds them back. Here they may lag, and more than the command may come out: with no lag and a gain of 1 the
model is that of the kinematic world.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.robots.angle import wrapped_all
from fleet.robots.spec import CarSpec
from fleet.scale.drives import DriveRecord

AHEAD_S = 1.0
"""How far ahead places are foretold [s]."""
AFRESH_S = 0.25
"""Time between two moments from which they are [s]."""


@dataclass(frozen=True, kw_only=True)
class CarModel:
    """Parameters of the kinematic car."""

    max_accel_mps2: float
    max_brake_mps2: float
    speed_lag_s: float
    """Time in which the speed has come to within 37 % of its command, as long as no limit holds it back [s]."""
    speed_gain: float
    """Speed of the rear axle for a command of 1 m/s."""
    max_steering_rate_radps: float
    steering_lag_s: float
    """The same for the steering [s]."""
    wheelbase_m: float
    grip_mps2: float
    """Greatest sideways acceleration: a tighter curve becomes a wider one."""

    @staticmethod
    def today(spec: CarSpec) -> CarModel:
        """What the kinematic world drives."""
        return CarModel(
            max_accel_mps2=spec.max_accel_mps2,
            max_brake_mps2=spec.max_brake_mps2,
            speed_lag_s=0.0,
            speed_gain=1.0,
            max_steering_rate_radps=spec.max_steering_rate_radps,
            steering_lag_s=0.0,
            wheelbase_m=spec.wheelbase_m,
            grip_mps2=math.inf,
        )

    @property
    def numbers(self) -> FloatArray:
        """The parameters in their order, shape (8,)."""
        return np.array([getattr(self, field.name) for field in fields(self)])


def simulated_speeds(model: CarModel, drive: DriveRecord) -> FloatArray:
    """Speeds that the model has under the commands of a drive, from its first moment on [m/s]."""
    m = model
    rates = (m.max_accel_mps2, m.max_brake_mps2)
    return _follow(m.speed_gain * drive.commands[:, :, 1], drive.speeds[0], *rates, m.speed_lag_s, drive.tick_s)


def simulated_steering(model: CarModel, drive: DriveRecord) -> FloatArray:
    """The same for the steering angles [rad]."""
    return _turn_to(
        drive.commands[:, :, 0], drive.steering[0], model.max_steering_rate_radps, model.steering_lag_s, drive.tick_s
    )


def simulated_turns(model: CarModel, drive: DriveRecord) -> FloatArray:
    """Yaw of each tick by the model at the measured speeds and steering angles [rad], shape (n_ticks, n_cars)."""
    speed = 0.5 * (drive.speeds[1:] + drive.speeds[:-1])
    angle = 0.5 * (drive.steering[1:] + drive.steering[:-1])
    rate = speed * np.tan(angle) / model.wheelbase_m
    most = model.grip_mps2 / np.maximum(np.abs(speed), 1e-9)
    turned: FloatArray = drive.tick_s * np.clip(rate, -most, most)
    return turned


def measured_turns(drive: DriveRecord) -> FloatArray:
    """Yaw of each tick as it was measured [rad], shape (n_ticks, n_cars)."""
    return wrapped_all(np.diff(drive.poses[:, :, 2], axis=0))


@dataclass(frozen=True, kw_only=True)
class Residuals:
    """How far a model is from a drive, root mean square over all cars while they move or should."""

    speed_mps: float
    """Of speeds simulated from the commands alone."""
    steering_rad: float
    """The same of steering angles."""
    yaw_rate_radps: float
    """Of yaw rates at the measured speed and steering."""
    ahead_m: float
    """Distance between the measured place and the one foretold `AHEAD_S` before."""


def residuals(model: CarModel, drive: DriveRecord) -> Residuals:
    """Compare a model with a drive."""
    awake = (np.abs(drive.speeds[1:]) > 0.01) | (np.abs(drive.commands[:, :, 1]) > 0.01)

    def rms(errors: FloatArray) -> float:
        return float(np.sqrt(np.mean(errors[awake] ** 2))) if awake.any() else 0.0

    turns = (simulated_turns(model, drive) - measured_turns(drive)) / drive.tick_s
    horizon, stride = round(AHEAD_S / drive.tick_s), round(AFRESH_S / drive.tick_s)
    squared, n = _ahead(model.numbers, drive.commands, drive.poses, drive.speeds, drive.steering,
                        drive.tick_s, horizon, stride)  # fmt: skip
    return Residuals(
        speed_mps=rms(simulated_speeds(model, drive)[1:] - drive.speeds[1:]),
        steering_rad=rms(simulated_steering(model, drive)[1:] - drive.steering[1:]),
        yaw_rate_radps=rms(turns),
        ahead_m=math.sqrt(squared / n) if n else 0.0,
    )


@njit(cache=True)
def _turned(value: float, goal: float, rate: float, lag: float, tick: float) -> float:
    """Where an angle is a tick later: it goes to its goal with a lag, at most at a rate."""
    way = goal - value
    if lag > 0.0:
        way *= 1.0 - math.exp(-tick / lag)
    most = rate * tick
    return value + min(max(way, -most), most)


@njit(cache=True)
def _sped(value: float, goal: float, up: float, down: float, lag: float, tick: float) -> float:
    """Where a speed is a tick later: it goes to its goal with a lag, at most at a rate, by way of a stand."""
    slows = abs(goal) < abs(value) or goal * value < 0.0
    after = _turned(value, goal, down if slows else up, lag, tick)
    return 0.0 if after * value < 0.0 else after


@njit(cache=True)
def _follow(goals: FloatArray, start: FloatArray, up: float, down: float, lag: float, tick: float) -> FloatArray:
    n_ticks, n_cars = goals.shape
    values = np.empty((n_ticks + 1, n_cars))
    values[0] = start
    for car in range(n_cars):
        for k in range(n_ticks):
            values[k + 1, car] = _sped(values[k, car], goals[k, car], up, down, lag, tick)
    return values


@njit(cache=True)
def _turn_to(goals: FloatArray, start: FloatArray, rate: float, lag: float, tick: float) -> FloatArray:
    n_ticks, n_cars = goals.shape
    values = np.empty((n_ticks + 1, n_cars))
    values[0] = start
    for car in range(n_cars):
        for k in range(n_ticks):
            values[k + 1, car] = _turned(values[k, car], goals[k, car], rate, lag, tick)
    return values


@njit(cache=True)
def _ahead(
    numbers: FloatArray,
    commands: FloatArray,
    poses: FloatArray,
    speeds: FloatArray,
    steering: FloatArray,
    tick: float,
    horizon: int,
    stride: int,
) -> tuple[float, int]:
    """Sum of squared distances between foretold and measured places of cars that drive, and their number."""
    accel, brake, speed_lag, gain, steering_rate, steering_lag, wheelbase, grip = numbers
    total, n = 0.0, 0
    for car in range(commands.shape[1]):
        for begin in range(0, len(commands) - horizon, stride):
            far = np.hypot(poses[begin + horizon, car, 0] - poses[begin, car, 0],
                           poses[begin + horizon, car, 1] - poses[begin, car, 1])  # fmt: skip
            if far < 0.01 and abs(commands[begin, car, 1]) < 0.01:
                continue
            x, y, yaw = poses[begin, car]
            v, angle = speeds[begin, car], steering[begin, car]
            for k in range(begin, begin + horizon):
                old_v, old_angle = v, angle
                v = _sped(v, gain * commands[k, car, 1], accel, brake, speed_lag, tick)
                angle = _turned(angle, commands[k, car, 0], steering_rate, steering_lag, tick)
                mean = 0.5 * (old_v + v)
                rate = mean * math.tan(0.5 * (old_angle + angle)) / wheelbase
                if abs(mean * rate) > grip:
                    rate = math.copysign(grip / abs(mean), rate)
                middle = yaw + 0.5 * rate * tick
                x += mean * tick * math.cos(middle)
                y += mean * tick * math.sin(middle)
                yaw += rate * tick
            dx, dy = x - poses[begin + horizon, car, 0], y - poses[begin + horizon, car, 1]
            total += dx * dx + dy * dy
            n += 1
    return total, n
