"""TwistMotion: robots that answer a speed and a yaw rate, on the flat floor and without physics."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.robots.differential import DifferentialDrive
from fleet.robots.twist.follower import shared
from fleet.robots.twist.spec import TwistSpec


class _Model(NamedTuple):
    max_speed: float
    max_yaw_rate: float
    accel: float
    brake: float
    yaw_accel: float
    rim: float
    lever: float
    speed_gain: float
    speed_lag: float
    yaw_gain: float
    yaw_lag: float


class TwistMotion:
    """Robots whose speed and yaw rate go to their commands with a lag and within their limits.

    Attributes:
        poses: x, y, yaw of the reference points, shape (n, 3).
        speeds: Signed forward speeds [m/s], shape (n,).
        yaw_rates: Yaw rates [rad/s], shape (n,).

    Args:
        spec: The model, with limits and response.
        start: Poses x, y, yaw, shape (n, 3).
        tick_s: Length of a tick [s].
        substep_s: Greatest integration step [s].
    """

    def __init__(
        self, spec: TwistSpec | DifferentialDrive, start: FloatArray, tick_s: float, substep_s: float = 1 / 120
    ) -> None:
        self.poses = np.array(start, dtype=np.float64)
        self.speeds = np.zeros(len(start))
        self.yaw_rates = np.zeros(len(start))
        self._n_substeps = max(1, math.ceil(tick_s / substep_s - 1e-9))
        self._substep_s = tick_s / self._n_substeps
        limits, response = spec.limits, spec.response
        self._model = _Model(
            max_speed=limits.max_speed_mps,
            max_yaw_rate=limits.max_yaw_rate_radps,
            accel=limits.max_accel_mps2,
            brake=limits.max_brake_mps2,
            yaw_accel=limits.max_yaw_accel_radps2,
            rim=limits.max_rim_mps,
            lever=limits.lever_m,
            speed_gain=response.speed_gain,
            speed_lag=response.speed_lag_s,
            yaw_gain=response.yaw_gain,
            yaw_lag=response.yaw_lag_s,
        )

    def step(self, commands: FloatArray) -> None:
        """Advance one tick.

        Args:
            commands: Signed speed [m/s] and yaw rate [rad/s], shape (n, 2); cut to the limits.
        """
        _drive(self.poses, self.speeds, self.yaw_rates, commands, self._n_substeps, self._substep_s, self._model)

    def put(self, robot: int, pose: FloatArray) -> None:
        """Let a robot stand at a pose x, y, yaw, shape (3,)."""
        self.poses[robot] = pose
        self.speeds[robot] = self.yaw_rates[robot] = 0.0

    def push(self, robot: int, dx_m: float, dy_m: float, dyaw_rad: float) -> None:
        """Displace a robot."""
        self.poses[robot] += (dx_m, dy_m, dyaw_rad)

    def save(self) -> tuple[FloatArray, ...]:
        """Copies of all that decides how robots move on."""
        return self.poses.copy(), self.speeds.copy(), self.yaw_rates.copy()

    def load(self, snapshot: tuple[FloatArray, ...]) -> None:
        """Return to a saved state."""
        self.poses[:], self.speeds[:], self.yaw_rates[:] = snapshot


@njit(cache=True)
def limited(speed: float, yaw_rate: float, m: _Model) -> tuple[float, float]:
    """A command cut to the limits; speed and yaw rate keep their ratio where rims or the yaw rate limit them."""
    speed = min(max(speed, -m.max_speed), m.max_speed)
    factor = shared(speed, yaw_rate, m.max_yaw_rate, m.rim, m.lever)
    return factor * speed, factor * yaw_rate


@njit(cache=True)
def _toward(value: float, target: float, share: float, rise: float, fall: float) -> float:
    """A value that goes a share of the way to its target, within the limits of a step."""
    change = share * (target - value)
    most = rise if abs(target) > abs(value) and target * value >= 0.0 else fall
    return value + min(max(change, -most), most)


@njit(cache=True)
def _drive(
    poses: FloatArray,
    speeds: FloatArray,
    yaw_rates: FloatArray,
    commands: FloatArray,
    n_substeps: int,
    dt: float,
    m: _Model,
) -> None:
    """Integrate all robots over a tick; places along the chord of each step's arc."""
    speed_share = 1.0 - math.exp(-dt / m.speed_lag) if m.speed_lag > 0.0 else 1.0
    yaw_share = 1.0 - math.exp(-dt / m.yaw_lag) if m.yaw_lag > 0.0 else 1.0
    for i in range(len(poses)):
        speed, rate = limited(commands[i, 0], commands[i, 1], m)
        speed, rate = m.speed_gain * speed, m.yaw_gain * rate
        for _ in range(n_substeps):
            v0, w0 = speeds[i], yaw_rates[i]
            speeds[i] = _toward(v0, speed, speed_share, m.accel * dt, m.brake * dt)
            yaw_rates[i] = _toward(w0, rate, yaw_share, m.yaw_accel * dt, m.yaw_accel * dt)
            way, angle = 0.5 * (v0 + speeds[i]) * dt, 0.5 * (w0 + yaw_rates[i]) * dt
            if way == 0.0 and angle == 0.0:
                continue
            middle = poses[i, 2] + 0.5 * angle
            chord = way * (1.0 - angle * angle / 24.0)
            poses[i, 0] += chord * math.cos(middle)
            poses[i, 1] += chord * math.sin(middle)
            poses[i, 2] += angle
