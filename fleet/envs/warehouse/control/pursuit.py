"""Pursuit: the classical way to drive what a car observes: pure pursuit of its route, and a stop at its end."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.envs.warehouse.rows import NEAR_M, STOP_AT, STOP_M, Rows

AT_GOAL_M = 0.4
"""Nearer to its goal than this a car steers for a point beyond it, so that it ends straight [m]."""
THERE_M = 0.01
"""Nearer to the end of its way than this a car stands [m]."""
CRUISE_MPS, BACK_MPS, GAIN_PER_S = 0.9, 0.3, 1.5
"""Speed on the way, back to a stop that was passed, and per metre that is left to go."""
LEAST_TURN_M2 = 0.04
"""Square of the least distance of the point that is steered for [m^2]."""
_GOAL, _TURN, _LOADS, _UNLOADS, _AHEAD, _WAY = 6, 8, 11, 13, 15, 19  # entries of a car's observation


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
