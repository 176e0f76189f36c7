"""Pursuit: the classical way to drive what a car observes: it follows its route, and stops at the end."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import FloatArray, IntArray
from fleet.envs.warehouse.rows import NEAR_M, STOP_AT, STOP_M, WAY_POINTS_M, Rows
from fleet.robots.cars.models import CarModels

AT_GOAL_M = 0.4
"""Nearer to its goal than this a car steers for a point beyond it, so that it ends straight [m]."""
THERE_M = 0.01
"""Nearer to the end of its way than this a car stands [m]."""
CRUISE_MPS, BACK_MPS, GAIN_PER_S = 0.9, 0.3, 1.5
"""Speed on the way, back to a stop that was passed, and per metre that is left to go."""
LEAST_TURN_M2 = 0.04
"""Square of the least distance of the point that is steered for [m^2]."""
CORNER_M, CORNER_RAD = 0.03, 0.1
"""Nearer to a corner than this a car that turns on the spot has come to it, and turned from its way by less it may go
on."""
ASKEW_RAD, STRAIGHT_RAD = 0.3, 0.03
"""Elsewhere it turns on the spot where it is turned from its way by more than the one, at its stop by more than the
other."""
CROSS_PER_M2, HEADING_PER_M, TURN_PER_S = 6.0, 5.0, 2.5
"""Curvature against a metre beside the route and against a radian from it: errors die out over 0.4 m, without
overshoot. On the spot, yaw rate per radian."""
LEAST_MPS = 0.05
"""Speed that errors count with at least [m/s]."""
_GOAL, _TURN, _LOADS, _UNLOADS, _AHEAD, _BESIDE, _DIRECTION, _WAY = 6, 8, 11, 13, 15, 16, 17, 19  # entries


class Wheel(NamedTuple):
    """What an action of a car stands for."""

    diagonal_m: float
    """Of the floor, by which goals are scaled."""
    wheelbase_m: float
    max_steering_rad: float
    """At full action."""
    max_speed_mps: float
    """At full action."""
    dead_band: float
    """Commands of a smaller share of the full speed are brakes."""


class Twist(NamedTuple):
    """What an action of a car stands for that is told a yaw rate."""

    diagonal_m: float
    max_yaw_rate: float
    max_speed_mps: float
    dead_band: float
    """Commands of a smaller share are brakes, of a yaw rate where the speed is one."""
    gain_per_s: float
    """Speed per metre that is left to go, so that its brakes hold."""
    there_m: float
    """As `THERE_M`, but no less than the robot sways."""
    straight_rad: float
    """As `STRAIGHT_RAD`, the same way."""


class Pursuit:
    """Drives cars of any models as the classical fleet does, by what they observe.

    Args:
        models: Models of the cars.
        size_m: Of the floor.
        speed_mps: Of a car at full action, as far as its model goes so fast.
        dead_band: Commands of a smaller share of the full speed are brakes.
    """

    def __init__(self, models: CarModels, size_m: tuple[float, float], speed_mps: float, dead_band: float) -> None:
        self._kind_of = models.kind_of
        self._wheels: list[Wheel | Twist] = []
        diagonal_m = math.hypot(*size_m)
        for kind in models.kinds:
            fastest_mps = min(speed_mps, kind.max_speed_mps)
            drive = kind.differential
            if drive is None:
                self._wheels.append(
                    Wheel(
                        diagonal_m=diagonal_m,
                        wheelbase_m=kind.wheelbase_m,
                        max_steering_rad=kind.max_steering_rad,
                        max_speed_mps=fastest_mps,
                        dead_band=dead_band,
                    )
                )
            else:
                self._wheels.append(
                    Twist(
                        diagonal_m=diagonal_m,
                        max_yaw_rate=kind.max_turn,
                        max_speed_mps=fastest_mps,
                        dead_band=dead_band,
                        gain_per_s=min(GAIN_PER_S, kind.max_brake_mps2 / kind.max_speed_mps),
                        there_m=max(THERE_M, 3.0 * drive.follower.stop_tolerance_m),
                        straight_rad=max(STRAIGHT_RAD, 2.0 * drive.follower.turn_tolerance_rad),
                    )
                )

    def actions(self, rows: Rows, cars: IntArray) -> FloatArray:
        """Actions of some cars, in [-1, 1], shape (n, 2).

        Args:
            rows: What they observe, shape (n, >= N_CAR_NUMBERS).
            cars: Which cars these are, shape (n,).
        """
        actions = np.zeros((len(rows), 2))
        for kind, wheel in enumerate(self._wheels):
            own = np.flatnonzero(self._kind_of[cars] == kind)
            if not len(own):
                continue
            found = np.empty((len(own), 2))
            if isinstance(wheel, Wheel):
                pursue(rows[own], wheel, found)
            else:
                twist(rows[own], wheel, found)
            actions[own] = found
        return actions


@njit(cache=True)
def pursue(rows: Rows, wheel: Wheel, out: FloatArray) -> None:  # pragma: no cover - compiled
    """Fill in the actions of cars that pursue their routes.

    Args:
        rows: Observations, shape (n, >= N_CAR_NUMBERS).
        wheel: What the actions stand for.
        out: Steering and speed in [-1, 1], shape (n, 2).

    Source: R. C. Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992.
    """
    creep = 1.05 * wheel.dead_band * wheel.max_speed_mps
    for car in range(len(rows)):
        row = rows[car].astype(np.float64)
        goal_x, goal_y = row[_GOAL] * wheel.diagonal_m, row[_GOAL + 1] * wheel.diagonal_m
        at_goal = math.hypot(goal_x, goal_y) < AT_GOAL_M
        if at_goal:
            x, y = goal_x + AT_GOAL_M * row[_TURN], goal_y + AT_GOAL_M * row[_TURN + 1]
            left = row[STOP_AT] * STOP_M
        else:
            x, y = row[_WAY] * NEAR_M, row[_WAY + 1] * NEAR_M
            left = row[_AHEAD] * NEAR_M
        steering = math.atan(2.0 * wheel.wheelbase_m * y / max(x * x + y * y, LEAST_TURN_M2))
        speed = 0.0
        if row[_LOADS] <= 0.0 and row[_UNLOADS] <= 0.0 and abs(left) >= THERE_M:
            speed = min(max(GAIN_PER_S * left, -BACK_MPS), CRUISE_MPS)
            if abs(speed) < creep:
                speed = creep if left > 0.0 else -creep
        out[car, 0] = min(max(steering / wheel.max_steering_rad, -1.0), 1.0)
        out[car, 1] = min(max(speed / wheel.max_speed_mps, -1.0), 1.0)


@njit(cache=True)
def twist(rows: Rows, wheel: Twist, out: FloatArray) -> None:  # pragma: no cover - compiled
    """Fill in the actions of cars that follow their routes and turn on the spot at corners.

    Args:
        rows: Observations, shape (n, >= N_CAR_NUMBERS).
        wheel: What the actions stand for.
        out: Yaw rate and speed in [-1, 1], shape (n, 2).

    Source: the law is that of `fleet.robots.twist.follower`, by Y. Kanayama and others, ICRA 1990,
    https://doi.org/10.1109/ROBOT.1990.126006.
    """
    creep = 1.05 * wheel.dead_band * wheel.max_speed_mps
    slow = 1.05 * wheel.dead_band * wheel.max_yaw_rate
    for car in range(len(rows)):
        row = rows[car].astype(np.float64)
        beside, cos, sin = row[_BESIDE], row[_DIRECTION], row[_DIRECTION + 1]
        error = math.atan2(sin, cos)
        left = row[_AHEAD] * NEAR_M
        # The way-point lies ahead along the route, and beside it where there is a corner before it.
        x, y = row[_WAY] * NEAR_M, row[_WAY + 1] * NEAR_M
        to_corner, across = cos * x + sin * y, cos * y - sin * x + beside
        has_corner = abs(across) > CORNER_M and left > to_corner + CORNER_M
        allowed = ASKEW_RAD
        if has_corner and to_corner < CORNER_M:
            error += math.copysign(0.5 * math.pi, across)
            error = math.atan2(math.sin(error), math.cos(error))
            left, beside, allowed = left - to_corner, 0.0, CORNER_RAD
        elif has_corner:
            left = to_corner
        elif math.hypot(row[_GOAL], row[_GOAL + 1]) * wheel.diagonal_m < WAY_POINTS_M[0]:
            left = row[STOP_AT] * STOP_M
            if abs(left) < wheel.there_m:
                error, allowed = math.atan2(row[_TURN + 1], row[_TURN]), wheel.straight_rad
        speed, rate = 0.0, 0.0
        if row[_LOADS] > 0.0 or row[_UNLOADS] > 0.0:
            out[car, 0] = out[car, 1] = 0.0
            continue
        if abs(error) > allowed:
            rate = TURN_PER_S * error
            if abs(rate) < slow:
                rate = math.copysign(slow, error)
        elif abs(left) >= wheel.there_m:
            speed = min(max(wheel.gain_per_s * left, -BACK_MPS), CRUISE_MPS)
            if abs(speed) < creep:
                speed = creep if left > 0.0 else -creep
            # In reverse errors of place turn the other way.
            rate = HEADING_PER_M * max(abs(speed), LEAST_MPS) * error - CROSS_PER_M2 * speed * beside
        out[car, 0] = min(max(rate / wheel.max_yaw_rate, -1.0), 1.0)
        out[car, 1] = min(max(speed / wheel.max_speed_mps, -1.0), 1.0)
