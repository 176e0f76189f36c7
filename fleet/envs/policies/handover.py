"""First come, first served: the scripted policy of the hand-over environment."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.envs.handover.rows import (
    CLOSE_M,
    FIRST_CAR,
    FIRST_PARCEL,
    FIRST_SLOT,
    FIRST_TRAY,
    N_CARS_SEEN,
    N_OWN,
    N_PARCELS,
    N_PER_CAR,
    N_PER_PARCEL,
    N_PER_STATION,
    N_PER_TRAY,
    N_STATIONS,
    N_TRAYS,
    NEAR_M,
    POINT_M,
    REACH_M,
    SIGHT_M,
    TIP_M,
    TURN_RAD,
    WAY_M,
    Rows,
)
from fleet.envs.warehouse.control.hands import N_TIP, TIP_MPS, TIP_RADPS
from fleet.robots.cars.models import usual_car

_CRUISE, _CREEP = 0.9, 0.12
"""Greatest and least speed of a car, as shares of the full one."""
_LATERAL_MPS2, _BRAKE_MPS2 = 2.6, 1.5
"""Sideways acceleration in curves and planned deceleration of cars [m/s^2]."""
_CORRIDOR_M, _GAP_M = 0.35, 0.75
"""Half width of the strip ahead in which another car is waited for, and the way that is kept to its rear axle [m]."""
_THERE_M = 0.02
"""A car that is so near to its stop stands [m]."""
_CLEAR_M = 0.15
"""A car leaves when no tool is lower than this above the floor of its tray [m]."""
_GAIN_PER_S = 4.0
_TRAVEL_M, _HOVER_M, _REST_M = 0.5, 0.12, (0.40, 0.62)
"""Height of a tip with a parcel, its height above a parcel that it comes for, and where it waits: out and up [m]."""
_OVER_M, _TOUCH_M = 0.015, 0.01
"""So near to the axis of what it comes for a tip goes down, and so near to its place a parcel is let go [m]."""
_SLOW_MPS = 0.35
"""Trays that are faster than this are left alone [m/s]."""


class FirstCome:
    """Cars go to the nearest arm that has what they need and wait there in a line; arms serve who is in reach.

    It decides by what agents see. An empty car goes to a pick arm at which parcels wait, a loaded one to a drop arm.

    Args:
        seed: Not used; every policy of the table takes one.
    """

    def __init__(self, seed: int = 0) -> None:
        del seed
        car = usual_car()
        self._car = np.array([car.wheelbase_m, car.max_steering_rad])

    def act(self, env: Any, observations: Mapping[str, npt.NDArray[np.float32]]) -> dict[str, Any]:
        """See `fleet.envs.policies.policy.Policy`."""
        cars = [agent for agent in observations if agent.startswith("car_")]
        arms = [agent for agent in observations if agent.startswith("arm_")]
        of_cars, of_arms = np.zeros((len(cars), 2)), np.zeros((len(arms), N_TIP + 1))
        if cars:
            _drive(np.stack([observations[car] for car in cars]), self._car, env.config.speed_mps, of_cars)
        if arms:
            _serve(np.stack([observations[arm] for arm in arms]), of_arms)
        told = dict(zip(cars, of_cars.astype(np.float32), strict=True))
        return told | dict(zip(arms, of_arms.astype(np.float32), strict=True))


@njit(cache=True)
def _drive(rows: Rows, limits: FloatArray, full_mps: float, out: FloatArray) -> None:  # pragma: no cover - compiled
    """Fill in the actions of cars: pure pursuit of the way to the arm that is chosen, and a stop at its end."""
    for car in range(len(rows)):
        row = rows[car].astype(np.float64)
        at = _station(row)
        left = row[at + 1] * WAY_M
        x, y = row[at + 2] * POINT_M, row[at + 3] * POINT_M
        curvature = 2.0 * y / max(x * x + y * y, 0.04)
        speed = min(_CRUISE * full_mps, math.sqrt(_LATERAL_MPS2 / max(abs(curvature), 1e-6)), 1.5 * max(left, 0.0))
        for rank in range(N_CARS_SEEN):
            one = FIRST_CAR + rank * N_PER_CAR
            ahead, aside = row[one + 1] * NEAR_M, row[one + 2] * NEAR_M
            crosses = row[one + 3] < 0.5 and row[one + 7] == 0.0
            if row[one] > 0.0 and ahead > 0.0 and abs(aside) < _CORRIDOR_M and not (crosses and ahead > _GAP_M):
                speed = min(speed, math.sqrt(2.0 * _BRAKE_MPS2 * max(ahead - _GAP_M, 0.0)))
        if speed > 0.01:
            speed = max(speed, _CREEP * full_mps)
        if abs(left) < _THERE_M or _is_over(row):
            speed = 0.0
        elif left < 0.0:  # it has gone a little too far
            speed, curvature = -_CREEP * full_mps, 0.0
        out[car, 0] = min(max(math.atan(limits[0] * curvature) / limits[1], -1.0), 1.0)
        out[car, 1] = min(max(speed / full_mps, -1.0), 1.0)


@njit(cache=True)
def _station(row: FloatArray) -> int:  # pragma: no cover - compiled
    """Entry at which what is told of the arm begins that a car is to go to."""
    kind = 1 if row[2] > 0.0 else 0
    first = N_OWN + kind * N_STATIONS * N_PER_STATION
    for rank in range(N_STATIONS):
        at = first + rank * N_PER_STATION
        if row[at] > 0.0 and row[at + 11] > 0.0:
            return at
    return first


@njit(cache=True)
def _is_over(row: FloatArray) -> bool:  # pragma: no cover - compiled
    """Whether a tool is at work in a car's tray."""
    for k in range(2 * N_STATIONS):
        at = N_OWN + k * N_PER_STATION
        aside = math.hypot(row[at + 13], row[at + 14]) * TIP_M
        if row[at] > 0.0 and aside < 0.2 and row[at + 15] * TIP_M < _CLEAR_M:
            return True
    return False


@njit(cache=True)
def _serve(rows: Rows, out: FloatArray) -> None:  # pragma: no cover - compiled
    """Fill in the actions of arms that go up, around and down."""
    for arm in range(len(rows)):
        row = rows[arm].astype(np.float64)
        holds = row[12] > 0.0
        radius, around, z = row[7] * TIP_M, row[8] * 0.5 * TURN_RAD, row[9] * TIP_M
        at, grip = _target(row, radius), 1.0
        out_mps = around_mps = 0.0
        coming = _coming(row)
        if at < 0 and coming >= 0:
            away, turn, up = 0.0, row[coming + 1] * TURN_RAD, _TRAVEL_M - z
        elif at < 0:
            away, turn, up = (0.0 if holds else _REST_M[0] - radius), -around, _REST_M[1] - z
        else:
            away, arc, up = _offset(row[at : at + 6])
            turn = row[at + 1] * TURN_RAD if abs(row[at + 4]) >= 1.0 else arc / max(radius, 0.1)
            if at < FIRST_SLOT:
                out_mps, around_mps = row[at + 6], row[at + 7]
            if math.hypot(away, arc) >= _OVER_M:
                up = _TRAVEL_M - z if holds else up + _HOVER_M
                if up > 0.05:
                    away, turn, out_mps, around_mps = 0.0, 0.0, 0.0, 0.0
            elif holds and up > -_TOUCH_M:
                grip = -1.0
        out[arm, 0] = (_GAIN_PER_S * away + out_mps) / TIP_MPS
        out[arm, 1] = (_GAIN_PER_S * turn + around_mps / max(radius, 0.1)) / TIP_RADPS
        out[arm, 2] = _GAIN_PER_S * up / TIP_MPS
        out[arm, 4] = grip
        for k in range(3):
            out[arm, k] = min(max(out[arm, k], -1.0), 1.0)


@njit(cache=True)
def _target(row: FloatArray, radius: float) -> int:  # pragma: no cover - compiled
    """Entry at which the offset to what an arm is about begins; -1 if it is about nothing."""
    holds, is_drop = row[12] > 0.0, row[16] < 0.0
    if holds and is_drop:
        return FIRST_SLOT + 1 if row[FIRST_SLOT] > 0.0 else -1
    if holds:
        for rank in range(N_TRAYS):
            at = FIRST_TRAY + rank * N_PER_TRAY
            fits = row[at] > 0.0 and row[at + 11] == 0.0 and row[at + 12] > 0.0
            if fits and math.hypot(row[at + 7], row[at + 8]) < _SLOW_MPS:
                return at + 1
        return -1
    for rank in range(N_PARCELS):
        at = FIRST_PARCEL + rank * N_PER_PARCEL
        reaches = radius + row[at + 1] * SIGHT_M < REACH_M
        if row[at] > 0.0 and reaches and math.hypot(row[at + 7], row[at + 8]) < _SLOW_MPS:
            return at + 1
    return -1


@njit(cache=True)
def _coming(row: FloatArray) -> int:  # pragma: no cover - compiled
    """Entry at which the offset to what an arm turns to begins, out of reach as it is; -1 if there is nothing."""
    holds, is_drop = row[12] > 0.0, row[16] < 0.0
    if is_drop and not holds and row[FIRST_PARCEL] > 0.0:
        return FIRST_PARCEL + 1
    for rank in range(N_TRAYS):
        at = FIRST_TRAY + rank * N_PER_TRAY
        if holds and not is_drop and row[at] > 0.0 and row[at + 11] == 0.0:
            return at + 1
    return -1


@njit(cache=True)
def _offset(told: FloatArray) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """How far out, along the arc and up something is [m], finely where it is near."""
    away = told[3] * CLOSE_M if abs(told[3]) < 1.0 else told[0] * SIGHT_M
    arc = told[4] * CLOSE_M if abs(told[4]) < 1.0 else math.copysign(CLOSE_M, told[4])
    up = told[5] * CLOSE_M if abs(told[5]) < 1.0 else told[2]
    return away, arc, up
