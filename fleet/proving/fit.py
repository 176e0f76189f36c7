"""Fit: how a robot in physics answers a speed and a yaw rate, as the parameters of its kinematic model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.optimize import least_squares

from fleet.arrays import FloatArray
from fleet.control.standard_errors import standard_errors
from fleet.proving.vehicles import TICK_S, PhysicalTwist
from fleet.robots.differential import TwistResponse
from fleet.robots.twist.motion import TwistMotion
from fleet.robots.twist.spec import TwistSpec

N_STEPS = 24
"""Commands that are held, one after the other."""
HOLD_S = 2.0
"""Time of each [s]."""
_LEAST_LAG_S = 0.005
"""A lag begins here at least: at zero, what it does has no slope [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TwistRecord:
    """What a robot was told and what it did; row k of the states is the moment before command k."""

    commands: FloatArray
    """Speeds [m/s] and yaw rates [rad/s], within the limits, shape (n, 2)."""
    states: FloatArray
    """The same, measured, shape (n + 1, 2)."""


@dataclass(frozen=True, kw_only=True)
class TwistFit:
    """A fitted response beside the one that the robot's file says."""

    stated: TwistResponse
    fitted: TwistResponse
    sigma: Mapping[str, float]
    """Standard errors of the fitted parameters."""
    stated_rms: tuple[float, float]
    """Root mean square errors of speed [m/s] and yaw rate [rad/s] with the stated response."""
    fitted_rms: tuple[float, float]
    """The same with the fitted one."""


def fit_response(spec: TwistSpec, *, seed: int, load_kg: float = 0.0) -> TwistFit:
    """Drive a robot through random steps in physics and fit its response; the same arguments, the same numbers.

    Args:
        spec: The robot.
        seed: Of the steps and of its sensors.
        load_kg: What lies in its tray.
    """
    record = drive_steps(spec, np.random.default_rng(seed), load_kg)
    names = [field.name for field in fields(TwistResponse)]
    start = np.array([max(getattr(spec.response, name), _LEAST_LAG_S) for name in names])

    def errors(values: FloatArray) -> FloatArray:
        response = TwistResponse(**dict(zip(names, values.tolist(), strict=True)))
        return (simulated(replace(spec, response=response), record) - record.states).ravel()

    found = least_squares(errors, start, bounds=(1e-3, np.inf), x_scale=start, diff_step=1e-3)
    fitted = TwistResponse(**dict(zip(names, found.x.tolist(), strict=True)))
    return TwistFit(
        stated=spec.response,
        fitted=fitted,
        sigma=dict(zip(names, standard_errors(found).tolist(), strict=True)),
        stated_rms=_rms(spec, record),
        fitted_rms=_rms(replace(spec, response=fitted), record),
    )


def drive_steps(spec: TwistSpec, rng: np.random.Generator, load_kg: float = 0.0) -> TwistRecord:
    """Let a robot in physics answer random steps of speed and yaw rate, as fast as its limits let commands change."""
    limits = spec.limits
    speeds = rng.uniform(0.2, 1.0, N_STEPS) * limits.max_speed_mps * rng.choice((0.0, 1.0, 1.0), N_STEPS)
    rooms = np.minimum((limits.max_rim_mps - speeds) / limits.lever_m, limits.max_yaw_rate_radps)
    with np.errstate(divide="ignore"):
        rooms = np.minimum(rooms, limits.max_lateral_mps2 / speeds)
    rates = rng.uniform(0.2, 1.0, N_STEPS) * np.maximum(rooms, 0.0) * rng.choice((-1.0, 0.0, 1.0), N_STEPS)
    most = np.array([limits.max_accel_mps2, limits.max_yaw_accel_radps2]) * TICK_S
    body = PhysicalTwist(spec, load_kg, 1.0, rng)
    try:
        command = np.zeros(2)
        commands, states = [], [np.zeros(2)]
        for target in np.column_stack((speeds, rates)):
            for _ in range(round(HOLD_S / TICK_S)):
                command = command + np.clip(target - command, -most, most)
                motion = body.advance(command).motion
                commands.append(command)
                states.append(motion[[0, 2]])
    finally:
        body.close()
    return TwistRecord(commands=np.array(commands), states=np.array(states))


def simulated(spec: TwistSpec, record: TwistRecord) -> FloatArray:
    """Speeds and yaw rates that the kinematic model has under the commands of a record, shape (n + 1, 2)."""
    motion = TwistMotion(spec, np.zeros((1, 3)), TICK_S)
    states = np.zeros_like(record.states)
    for k, command in enumerate(record.commands):
        motion.step(command.reshape(1, 2))
        states[k + 1] = motion.speeds[0], motion.yaw_rates[0]
    return states


def _rms(spec: TwistSpec, record: TwistRecord) -> tuple[float, float]:
    errors = simulated(spec, record) - record.states
    speed, rate = np.sqrt((errors**2).mean(axis=0)).tolist()
    return (float(speed), float(rate)) if math.isfinite(speed) else (math.inf, math.inf)
