"""Ways: kernels that follow cars along their ways, and look ahead on them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray

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
def look_ahead(ways: WayLines, ahead_m: FloatArray, found: FloatArray) -> None:  # pragma: no cover - compiled
    """Write points of all ways at arc lengths ahead of the cars, at most the ends of the ways.

    Args:
        ways: The ways of n cars.
        ahead_m: Ascending, shape (k,).
        found: Filled in with x, y, shape (n, k, 2).
    """
    points, s, counts, cursor, progress, _ = ways
    for car in range(len(found)):
        k = cursor[car]
        for p in range(len(ahead_m)):
            at = progress[car] + ahead_m[p]
            while k + 2 < counts[car] and s[car, k + 1] < at:
                k += 1
            t, onward = 0.0, k
            if k + 1 < counts[car]:
                t = min(max((at - s[car, k]) / max(s[car, k + 1] - s[car, k], 1e-9), 0.0), 1.0)
                onward = k + 1
            for axis in range(2):
                found[car, p, axis] = points[car, k, axis] + t * (points[car, onward, axis] - points[car, k, axis])


@njit(cache=True)
def meeting(
    own: FloatArray, other: FloatArray, ahead_m: FloatArray, near_m: float
) -> tuple[float, float]:  # pragma: no cover - compiled
    """Where two ways first come near each other.

    Args:
        own: Points of the one at the arc lengths `ahead_m`, shape (k, 2).
        other: Points of the other, shape (k, 2).
        ahead_m: Shape (k,).
        near_m: How near that is.

    Returns:
        Arc lengths of both up to there [m], of the one the least, then of the other; infinite if they do not.
    """
    for i in range(len(ahead_m)):
        for j in range(len(ahead_m)):
            dx, dy = own[i, 0] - other[j, 0], own[i, 1] - other[j, 1]
            if dx * dx + dy * dy < near_m * near_m:
                return ahead_m[i], ahead_m[j]
    return math.inf, math.inf
