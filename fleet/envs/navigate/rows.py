"""Rows: the kernel that fills the observations of `NavigationEnv`, and what their entries are."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.envs.navigate.ways import WayLines, look_ahead, meeting

WAY_POINTS_M: FloatArray = np.array([0.3, 0.6, 1.0, 1.5, 2.2, 3.0])
"""Distances ahead at which a car is told where its way leads [m]."""
SAMPLES_M: FloatArray = np.linspace(0.0, 3.0, 13)
"""Distances ahead at which ways are compared [m]."""
AIM = 4
"""Number of the sample that others are told of: 1 m ahead."""
MEET_M = 0.4
"""Ways nearer than this to each other meet [m]: bodies are 0.28 m wide."""
NEAR_M = 4.0
"""Range in which other cars are seen [m]."""
HORIZON_S = 3.0
"""Time within which a collision is foretold [s]."""
CLOSE_M = 0.5
"""Middles of cars nearer than this are a collision foretold [m]: about the length of a body."""
N_OWN = 7
"""Numbers that a car is told of itself, before the points of its way."""
N_OTHERS = 4
"""Other cars that are seen at most."""
N_PER_OTHER = 16
"""Numbers told of each; the first is 1, or 0 if there is none."""
FIRST_OTHER = N_OWN + 2 * len(WAY_POINTS_M)
"""Entry at which they begin."""
N_CAR_NUMBERS = FIRST_OTHER + N_OTHERS * N_PER_OTHER
"""Numbers in an observation."""

Rows = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]


class CarsSeen(NamedTuple):
    """What cars are told of themselves and of each other; n cars."""

    poses: FloatArray
    """x, y, yaw, shape (n, 3)."""
    speeds: FloatArray
    steering: FloatArray
    """As shares of the limits, shape (n,)."""
    left_m: FloatArray
    """Way left to the place [m], shape (n,)."""
    places: FloatArray
    """The place that each drives to, x, y, shape (n, 2)."""
    in_tow: Bools
    """Whether a car is out of its agent's hands, shape (n,)."""
    body: FloatArray
    """Of every car: from the rear axle to the middle, half its length and half its width [m], shape (3,)."""
    max_speed_mps: float
    time_left: float
    """Share of the episode that is left."""


class Seen(NamedTuple):
    """What `observe` fills in; n cars."""

    rows: Rows
    """Observations, shape (n, N_CAR_NUMBERS)."""
    touches: Bools
    """Whether a car touches another, shape (n,)."""


@njit(cache=True)
def _parted(
    gap: tuple[float, float], axis: tuple[float, float], turn: tuple[float, float], length: float, width: float
) -> bool:  # pragma: no cover - compiled
    """Whether an axis of the first of two equal rectangles parts them (separating axes)."""
    dx, dy = gap
    cos, sin = axis
    turn_cos, turn_sin = turn
    u, v = cos * dx + sin * dy, cos * dy - sin * dx
    return (
        abs(u) > length + abs(turn_cos) * length + abs(turn_sin) * width
        or abs(v) > width + abs(turn_sin) * length + abs(turn_cos) * width
    )


@njit(cache=True)
def _find_touches(
    poses: FloatArray, body: FloatArray, gaps: FloatArray, touches: Bools
) -> None:  # pragma: no cover - compiled
    """Write the distances of all rear axles, infinite to oneself, and which cars touch another."""
    touches[:] = False
    for car in range(len(poses)):
        gaps[car, car] = math.inf
        cos, sin = math.cos(poses[car, 2]), math.sin(poses[car, 2])
        for other in range(car + 1, len(poses)):
            dx, dy = poses[other, 0] - poses[car, 0], poses[other, 1] - poses[car, 1]
            gaps[car, other] = gaps[other, car] = math.hypot(dx, dy)
            if gaps[car, other] > 1.0:
                continue
            other_cos, other_sin = math.cos(poses[other, 2]), math.sin(poses[other, 2])
            middle = dx + body[0] * (other_cos - cos), dy + body[0] * (other_sin - sin)
            turn = (cos * other_cos + sin * other_sin, cos * other_sin - sin * other_cos)
            if not (
                _parted(middle, (cos, sin), turn, body[1], body[2])
                or _parted(middle, (other_cos, other_sin), turn, body[1], body[2])
            ):
                touches[car] = touches[other] = True


@njit(cache=True)
def time_to_collision(dx: float, dy: float, vx: float, vy: float) -> float:  # pragma: no cover - compiled
    """Time until two discs whose middles are at (dx, dy) are within `CLOSE_M`, at a constant relative velocity [s]."""
    outside = dx * dx + dy * dy - CLOSE_M * CLOSE_M
    if outside <= 0.0:
        return 0.0
    closing = -(dx * vx + dy * vy)
    speed2 = vx * vx + vy * vy
    under = closing * closing - speed2 * outside
    if closing <= 0.0 or under < 0.0 or speed2 <= 0.0:  # the square of a very small speed is 0
        return math.inf
    return (closing - math.sqrt(under)) / speed2


@njit(cache=True)
def observe(cars: CarsSeen, ways: WayLines, seen: Seen) -> None:  # pragma: no cover - compiled
    """Write all observations, and which cars touch another."""
    poses, body = cars.poses, cars.body
    rows, touches = seen
    n_cars, n_points = len(poses), len(WAY_POINTS_M)
    gaps = np.empty((n_cars, n_cars))
    _find_touches(poses, body, gaps, touches)
    points, samples = np.empty((n_cars, n_points, 2)), np.empty((n_cars, len(SAMPLES_M), 2))
    look_ahead(ways, WAY_POINTS_M, points)
    look_ahead(ways, SAMPLES_M, samples)
    for car in range(n_cars):
        x, y = poses[car, 0], poses[car, 1]
        cos, sin = math.cos(poses[car, 2]), math.sin(poses[car, 2])
        row = rows[car]
        row[:] = 0.0
        row[0], row[1] = cars.speeds[car], cars.steering[car]
        row[2], row[3] = ways.aside[car], cars.left_m[car] / 10.0
        row[4] = cars.time_left
        row[5], row[6] = touches[car], cars.in_tow[car]
        for p in range(n_points):
            px, py = points[car, p, 0] - x, points[car, p, 1] - y
            row[N_OWN + 2 * p], row[N_OWN + 2 * p + 1] = (cos * px + sin * py) / 3.0, (cos * py - sin * px) / 3.0
        for rank in range(min(N_OTHERS, n_cars - 1)):
            other = int(np.argmin(gaps[car]))
            if gaps[car, other] > NEAR_M:
                break
            gaps[car, other] = math.inf
            at = FIRST_OTHER + rank * N_PER_OTHER
            _tell(cars, car, other, row[at : at + N_PER_OTHER])
            px, py = samples[other, AIM, 0] - x, samples[other, AIM, 1] - y
            row[at + 9], row[at + 10] = (cos * px + sin * py) / NEAR_M, (cos * py - sin * px) / NEAR_M
            own_m, other_m = meeting(samples[car], samples[other], SAMPLES_M, MEET_M)
            row[at + 13] = min(own_m / SAMPLES_M[-1], 1.0)
            row[at + 14] = min(other_m / SAMPLES_M[-1], 1.0)
        for k in range(len(row)):
            row[k] = min(max(row[k], np.float32(-1.0)), np.float32(1.0))


@njit(cache=True)
def _tell(cars: CarsSeen, car: int, other: int, out: Rows) -> None:  # pragma: no cover - compiled
    """Write what a car is told of another, but for its way; shape (N_PER_OTHER,)."""
    poses, top = cars.poses, cars.max_speed_mps
    cos, sin = math.cos(poses[car, 2]), math.sin(poses[car, 2])
    turn_cos = math.cos(poses[other, 2] - poses[car, 2])
    turn_sin = math.sin(poses[other, 2] - poses[car, 2])
    dx, dy = poses[other, 0] - poses[car, 0], poses[other, 1] - poses[car, 1]
    ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
    own_mps, other_mps = cars.speeds[car] * top, cars.speeds[other] * top
    vx, vy = other_mps * turn_cos - own_mps, other_mps * turn_sin
    out[0] = 1.0
    out[1], out[2] = ahead / NEAR_M, left / NEAR_M
    out[3], out[4] = turn_cos, turn_sin
    out[5], out[6] = vx / (2.0 * top), vy / (2.0 * top)
    out[7] = -(ahead * vx + left * vy) / max(math.hypot(ahead, left), 1e-9) / (2.0 * top)
    shift = cars.body[0]
    soon_s = time_to_collision(ahead + shift * (turn_cos - 1.0), left + shift * turn_sin, vx, vy)
    out[8] = max(0.0, 1.0 - soon_s / HORIZON_S)
    gx, gy = cars.places[other, 0] - poses[car, 0], cars.places[other, 1] - poses[car, 1]
    out[11], out[12] = (cos * gx + sin * gy) / 10.0, (cos * gy - sin * gx) / 10.0
    out[15] = 1.0 if other < car else 0.0
