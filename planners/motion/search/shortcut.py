"""Deterministic shortening of a free path by random shortcuts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planners.motion import checks
from planners.motion.arrays import Chance, FloatArray, Int
from planners.motion.chance import uniform
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.scene_kernel import SceneArrays, edge_free
from planners.motion.kernel import kernel

_IDLE_ROUNDS = 4
"""So many rounds without a gain end the shortening."""
_MOST_ROUNDS = 1_000_000
_LEAST_GAIN = 0.005
"""A cut is tried only if it saves this share of the path."""


@kernel
def _gap(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for k in range(a.shape[0]):
        total += (a[k] - b[k]) ** 2
    return float(np.sqrt(total))


@kernel
def _move(path: FloatArray, first: Int, end: Int, by: Int) -> None:
    """Move the corners first..end-1 by some rows, up or down."""
    for h in range(end - first):
        row = end - 1 - h if by > 0 else first + h
        for k in range(path.shape[1]):
            path[row + by, k] = path[row, k]


@kernel
def _shorten(path: FloatArray, n: int, rounds: int, random: Chance, scene: SceneArrays) -> int:
    """Shorten `path` (capacity, dof) of n corners in place; returns the new number of corners."""
    along = np.empty(path.shape[0])
    a = np.empty(path.shape[1])
    b = np.empty(path.shape[1])
    changed = True
    idle = 0
    for _ in range(rounds):
        # Drop every corner that is not needed, then cut between two random points.
        i = 1
        while changed and i < n - 1:
            if edge_free(path[i - 1], path[i + 1], scene):
                _move(path, i + 1, n, -1)
                n -= 1
            else:
                i += 1
        idle = 0 if changed else idle + 1
        changed = False
        if n < 3 or idle == _IDLE_ROUNDS:
            break
        for _ in range(10):
            along[0] = 0.0
            for k in range(1, n):
                along[k] = along[k - 1] + _gap(path[k - 1], path[k])
            first = uniform(random) * along[n - 1]
            last = uniform(random) * along[n - 1]
            if first > last:
                first, last = last, first
            i = 0
            while along[i + 1] < first:
                i += 1
            j = i
            while along[j + 1] < last:
                j += 1
            if i == j or n + 1 > path.shape[0]:
                continue
            u = (first - along[i]) / (along[i + 1] - along[i])
            v = (last - along[j]) / (along[j + 1] - along[j])
            for k in range(path.shape[1]):
                a[k] = path[i, k] + (path[i + 1, k] - path[i, k]) * u
                b[k] = path[j, k] + (path[j + 1, k] - path[j, k]) * v
            if _gap(a, b) > last - first - _LEAST_GAIN * along[n - 1] or not edge_free(a, b, scene):
                continue
            # The rests of the cut edges are checked anew, so that every edge of the result passes the edge check.
            if not (edge_free(path[i], a, scene) and edge_free(b, path[j + 1], scene)):
                continue
            # Corners i+1..j give way to a and b.
            changed = True
            grow = 2 - (j - i)
            _move(path, j + 1, n, grow)
            n += grow
            for k in range(path.shape[1]):
                path[i + 1, k] = a[k]
                path[i + 2, k] = b[k]
    return n


def shorten(path: npt.ArrayLike, checker: CollisionChecker, *, rounds: int, seed: int) -> FloatArray:
    """Shorten a free piecewise straight path; the ends stay.

    Each round drops the corners that are not needed and tries ten cuts between random points of the path.

    Args:
        path: Corners [rad], shape (k, n), free.
        checker: The scene the path was planned in.
        rounds: Number of rounds, >= 0.
        seed: Seed of the random points.

    Returns:
        A free path that is not longer, shape (m, n).

    Raises:
        PlanningError: Malformed input.

    Source: Geraerts and Overmars, Creating high-quality paths for motion planning, IJRR 2007 (shortcuts).
    """
    corners = checks.rows("shorten: path", path, checker.model.n_joints)
    checks.whole("shorten: rounds", rounds, 0, _MOST_ROUNDS)
    checks.whole("shorten: seed", seed, 0, 2**64 - 1)
    buffer = np.empty((len(corners) + 10 * rounds + 2, corners.shape[1]))
    buffer[: len(corners)] = corners
    n = _shorten(buffer, len(corners), rounds, np.array([seed], dtype=np.uint64), checker.scene)
    return buffer[:n].copy()
