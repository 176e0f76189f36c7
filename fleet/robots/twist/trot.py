"""Trot: foot paths of a four-legged robot for a speed and a yaw rate, and the joint angles that put feet there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.robots.differential import TrotConfig

LEGS = ("FR", "FL", "RR", "RL")
"""Order of the legs; each has a roll joint at the hip, a pitch joint at the hip and a knee, in this order."""
_SIDES = np.array([-1.0, 1.0, -1.0, 1.0])
_ENDS = np.array([1.0, 1.0, -1.0, -1.0])
_PHASES = np.array([0.0, 0.5, 0.5, 0.0])
"""Share of a cycle by which each leg is ahead: diagonal legs step together."""
_DUTY = 0.5
"""Share of a cycle in which a foot is on the floor."""


class _Gait(NamedTuple):
    """What is kept of each robot."""

    phase: FloatArray
    """Share of the cycle, shape (n,)."""
    idle: FloatArray
    """Cycles since the robot was told to go, infinite while it stands on four feet, shape (n,)."""
    feet: FloatArray
    """Where feet are beside their places x, y [m], shape (n, 4, 2)."""
    left: FloatArray
    """Where each left the floor, shape (n, 4, 2)."""


class _Numbers(NamedTuple):
    link: float
    side: float
    place_x: float
    place_y: float
    height: float
    lift: float
    frequency: float
    speed_gain: float
    yaw_gain: float


class Trot:
    """The gaits of several robots.

    Feet that stand move back under the body with the speed of the floor there. Feet that swing go to where the middle
    of their stand will be under their place, as the robot is told at present. A robot that is told to stand brings all
    its feet home in a cycle more, and then stands on four.

    Args:
        config: Legs and gait.
        n_robots: Number of robots.
        step_s: Time between two calls of `joint_targets` [s].

    Source: M. H. Raibert, "Legged Robots That Balance", MIT Press 1986, chapters 2 and 4: feet placed by speed,
    diagonal legs as one.
    """

    def __init__(self, config: TrotConfig, n_robots: int, step_s: float) -> None:
        self._gait = _Gait(
            phase=np.zeros(n_robots),
            idle=np.full(n_robots, np.inf),
            feet=np.zeros((n_robots, 4, 2)),
            left=np.zeros((n_robots, 4, 2)),
        )
        self._step_s = step_s
        self._numbers = _Numbers(
            config.link_m,
            config.hip_m,
            config.foot_x_m,
            config.foot_y_m,
            config.height_m,
            config.lift_m,
            config.frequency_hz,
            config.speed_gain,
            config.yaw_gain,
        )
        self._targets = np.empty((n_robots, 12))

    def stand(self, robot: int) -> None:
        """Let a robot stand on four feet at once."""
        self._gait.phase[robot], self._gait.idle[robot] = 0.0, np.inf
        self._gait.feet[robot] = self._gait.left[robot] = 0.0

    def joint_targets(self, commands: FloatArray) -> FloatArray:
        """Go on by a step, and say where the joints should be.

        Args:
            commands: Speeds ahead and to the left [m/s] and yaw rates [rad/s], shape (n, 3).

        Returns:
            Angles of roll, pitch and knee of each leg in the order of `LEGS` [rad], shape (n, 12).
        """
        _trot(self._gait, commands, self._targets, self._step_s, self._numbers)
        return self._targets


def standing_angles(config: TrotConfig) -> FloatArray:
    """Angles of the joints of a robot that stands, in the order of `LEGS` [rad], shape (12,)."""
    return np.array([0.0, *two_links(config.link_m, 0.0, config.height_m)] * 4)


@njit(cache=True)
def two_links(link: float, x: float, down: float) -> tuple[float, float]:
    """Angles of hip and knee that put a foot `x` ahead of the hip and `down` below it [m]; knees bend backwards.

    Beyond its reach the leg is all but straight.
    """
    reach = min(math.hypot(x, down), 2.0 * link - 1e-4)
    knee = 2.0 * math.asin(reach / (2.0 * link))
    return math.atan2(-x, down) + 0.5 * (math.pi - knee), knee - math.pi


@njit(cache=True)
def _swung(share: float, begin: float, end: float, slope: float) -> float:
    """A foot's way through its swing: it leaves and meets the floor as fast as the floor goes (a Hermite cubic)."""
    rest = 1.0 - share
    return (
        (1.0 + 2.0 * share) * rest * rest * begin
        + share * share * (3.0 - 2.0 * share) * end
        + share * rest * (rest - share) * slope
    )


@njit(cache=True)
def _trot(
    gait: _Gait,
    commands: FloatArray,
    targets: FloatArray,
    step: float,
    numbers: _Numbers,
) -> None:
    link, side, place_x, place_y, height, lift, frequency, speed_gain, yaw_gain = numbers
    phases, idle, feet, left = gait
    stand_s = _DUTY / frequency
    for i in range(len(phases)):
        vx, vy, rate = commands[i, 0] / speed_gain, commands[i, 1] / speed_gain, commands[i, 2] / yaw_gain
        before = phases[i]
        if vx != 0.0 or vy != 0.0 or rate != 0.0:
            if idle[i] == np.inf:
                before = 0.0
            idle[i] = 0.0
        elif idle[i] < np.inf:
            idle[i] += step * frequency
        phase = (before + step * frequency) % 1.0
        if idle[i] > 1.0 and (phase < before or before < _DUTY <= phase):
            idle[i] = np.inf
        phases[i] = phase if idle[i] < np.inf else 0.0
        for leg in range(4):
            foot, from_x, from_y, up = feet[i, leg], left[i, leg, 0], left[i, leg, 1], 0.0
            if idle[i] < np.inf:
                floor_x = vx - rate * (_SIDES[leg] * place_y + foot[1])
                floor_y = vy + rate * (_ENDS[leg] * place_x + foot[0])
                own = (phase + _PHASES[leg]) % 1.0
                if own <= _DUTY + 1e-9:  # up to its last moment on the floor
                    foot[0] -= floor_x * step
                    foot[1] -= floor_y * step
                    left[i, leg, 0], left[i, leg, 1] = foot[0], foot[1]
                else:
                    share = (own - _DUTY) / (1.0 - _DUTY)
                    up = lift * math.sin(math.pi * share)
                    to_x = 0.5 * stand_s * floor_x
                    to_y = 0.5 * stand_s * floor_y
                    foot[0] = _swung(share, from_x, to_x, -floor_x * stand_s)
                    foot[1] = _swung(share, from_y, to_y, -floor_y * stand_s)
            down, out = height - up, _SIDES[leg] * side
            leg_m = math.sqrt(max(down * down + (out + foot[1]) ** 2 - out * out, 0.0))
            hip, knee = two_links(link, foot[0], leg_m)
            targets[i, 3 * leg] = math.atan2(out + foot[1], down) - math.atan2(out, leg_m)
            targets[i, 3 * leg + 1] = hip
            targets[i, 3 * leg + 2] = knee
