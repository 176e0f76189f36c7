"""Rows: kernels that follow cars along their ways and fill the observations of `NavigationEnv`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray

WAY_POINTS_M = np.array([0.3, 0.6, 1.0, 1.5, 2.2, 3.0])
"""Distances ahead at which a car is told where its way leads [m]."""
NEAR_M = 4.0
"""Range in which other cars are seen [m]."""
N_OTHERS = 3
"""Other cars that are seen at most."""
N_PER_OTHER = 8
"""Numbers told of each."""
N_CAR_NUMBERS = 4 + 2 * len(WAY_POINTS_M) + N_OTHERS * N_PER_OTHER
"""Numbers in an observation."""

Rows = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Int64Array = npt.NDArray[np.int64]


class WayLines(NamedTuple):
    """The ways of all cars, as `PathBuffer` keeps them, and where the cars are beside them; n cars."""

    points: FloatArray
    """x, y, yaw, shape (n, capacity, 3)."""
    s: FloatArray
    """Arc length of each point [m], shape (n, capacity)."""
    counts: Int64Array
    """Points in use, shape (n,)."""
    cursor: Int64Array
    """Point that begins the segment the car is on, shape (n,)."""
    progress: FloatArray
    """Arc length reached so far [m], shape (n,)."""
    aside: FloatArray
    """Distance to the left of the way [m], shape (n,)."""


class CarsSeen(NamedTuple):
    """What cars are told of themselves and of each other; n cars."""

    poses: FloatArray
    """x, y, yaw, shape (n, 3)."""
    speeds: FloatArray
    steering: FloatArray
    """As shares of the limits, shape (n,)."""
    left_m: FloatArray
    """Way left to the place [m], shape (n,)."""
    body: FloatArray
    """Of every car: from the rear axle to the middle, half its length and half its width [m], shape (3,)."""


class Seen(NamedTuple):
    """What `observe` fills in; n cars."""

    rows: Rows
    """Observations, shape (n, N_CAR_NUMBERS)."""
    touches: Bools
    """Whether a car touches another, shape (n,)."""
    aims: FloatArray
    """Points 1 m ahead on the ways, shape (n, 2)."""


@njit(cache=True)
def project(poses: FloatArray, ways: WayLines) -> None:  # pragma: no cover - compiled
    """Find the point of its way nearest to each car, from half a metre behind the last one to a metre ahead of it."""
    points, s, counts, cursor, progress, aside = ways
    for car in range(len(poses)):
        x, y = poses[car, 0], poses[car, 1]
        k = cursor[car]
        while k > 0 and s[car, k] > progress[car] - 0.5:
            k -= 1
        best, best_k, best_s, best_side = math.inf, cursor[car], progress[car], aside[car]
        while k + 1 < counts[car] and s[car, k] <= progress[car] + 1.0:
            ax, ay = points[car, k, 0], points[car, k, 1]
            dx, dy = points[car, k + 1, 0] - ax, points[car, k + 1, 1] - ay
            length2 = dx * dx + dy * dy
            t = 0.0
            if length2 > 0.0:
                t = min(max(((x - ax) * dx + (y - ay) * dy) / length2, 0.0), 1.0)
            gap = math.hypot(x - ax - t * dx, y - ay - t * dy)
            if gap < best:
                best, best_k = gap, k
                best_s = s[car, k] + t * (s[car, k + 1] - s[car, k])
                best_side = gap if dx * (y - ay) - dy * (x - ax) >= 0.0 else -gap
            k += 1
        cursor[car], progress[car], aside[car] = best_k, best_s, best_side


@njit(cache=True)
def _ahead(
    points: FloatArray, s: FloatArray, count: int, k: int, at: float
) -> tuple[float, float]:  # pragma: no cover - compiled
    """Point of a way at an arc length, at most its end."""
    while k + 2 < count and s[k + 1] < at:
        k += 1
    if k + 1 >= count:
        return points[k, 0], points[k, 1]
    t = min(max((at - s[k]) / max(s[k + 1] - s[k], 1e-9), 0.0), 1.0)
    return points[k, 0] + t * (points[k + 1, 0] - points[k, 0]), points[k, 1] + t * (points[k + 1, 1] - points[k, 1])


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
def observe(cars: CarsSeen, ways: WayLines, look_m: FloatArray, seen: Seen) -> None:  # pragma: no cover - compiled
    """Write all observations, and which cars touch another."""
    poses, speeds, body = cars.poses, cars.speeds, cars.body
    points, s, counts, cursor, progress, aside = ways
    rows, touches, aims = seen
    n_cars, n_points = len(poses), len(look_m)
    for car in range(n_cars):
        aims[car, 0], aims[car, 1] = _ahead(points[car], s[car], counts[car], cursor[car], progress[car] + 1.0)
    gaps = np.empty(n_cars)
    for car in range(n_cars):
        x, y = poses[car, 0], poses[car, 1]
        cos, sin = math.cos(poses[car, 2]), math.sin(poses[car, 2])
        row = rows[car]
        row[:] = 0.0
        row[0], row[1], row[2], row[3] = speeds[car], cars.steering[car], aside[car], cars.left_m[car] / 10.0
        for p in range(n_points):
            px, py = _ahead(points[car], s[car], counts[car], cursor[car], progress[car] + look_m[p])
            row[4 + 2 * p] = (cos * (px - x) + sin * (py - y)) / 3.0
            row[5 + 2 * p] = (cos * (py - y) - sin * (px - x)) / 3.0
        touches[car] = False
        for other in range(n_cars):
            gaps[other] = math.inf
            if other == car:
                continue
            dx, dy = poses[other, 0] - x, poses[other, 1] - y
            gaps[other] = math.hypot(dx, dy)
            if gaps[other] > 1.0:
                continue
            other_cos, other_sin = math.cos(poses[other, 2]), math.sin(poses[other, 2])
            mx = dx + body[0] * (other_cos - cos)
            my = dy + body[0] * (other_sin - sin)
            turn = (cos * other_cos + sin * other_sin, cos * other_sin - sin * other_cos)
            if not (
                _parted((mx, my), (cos, sin), turn, body[1], body[2])
                or _parted((mx, my), (other_cos, other_sin), turn, body[1], body[2])
            ):
                touches[car] = True
        for rank in range(min(N_OTHERS, n_cars - 1)):
            other = int(np.argmin(gaps))
            if gaps[other] > NEAR_M:
                break
            gaps[other] = math.inf
            at = 4 + 2 * n_points + rank * N_PER_OTHER
            dx, dy = poses[other, 0] - x, poses[other, 1] - y
            row[at] = 1.0
            row[at + 1], row[at + 2] = (cos * dx + sin * dy) / NEAR_M, (cos * dy - sin * dx) / NEAR_M
            row[at + 3] = math.cos(poses[other, 2] - poses[car, 2])
            row[at + 4] = math.sin(poses[other, 2] - poses[car, 2])
            row[at + 5] = speeds[other]
            dx, dy = aims[other, 0] - x, aims[other, 1] - y
            row[at + 6], row[at + 7] = (cos * dx + sin * dy) / NEAR_M, (cos * dy - sin * dx) / NEAR_M
        for k in range(len(row)):
            row[k] = min(max(row[k], np.float32(-1.0)), np.float32(1.0))
