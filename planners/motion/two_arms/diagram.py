"""Coordination diagram: where two arms on their paths keep apart.

It has the progress of one arm along one axis and that of the other along the other; a cell is free if the arms do not
meet there, during the half steps before and after both its samples.

Source: O'Donnell and Lozano-Perez, Deadlock-free and collision-free coordination of two robot manipulators, ICRA 1989.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planners.errors import PlanningError
from planners.motion.arrays import BoolArray, FloatArray, IntArray
from planners.motion.kernel import kernel
from planners.motion.two_arms.swept import SweptArm

MARGIN_M = 0.01
"""Distance kept between arms unless said otherwise [m]: a physical arm follows its set-points to some millimetres."""


class _Room(NamedTuple):
    """A `SweptArm` as the kernels see it."""

    centre: FloatArray
    radius: FloatArray
    parts: IntArray
    change: FloatArray


def _room(arm: SweptArm) -> _Room:
    return _Room(centre=arm.centre, radius=arm.radius, parts=arm.parts, change=arm.change)


def apart_in_step(a: SweptArm, b: SweptArm, margin_m: float = MARGIN_M) -> bool:
    """Whether two arms keep their distance when neither waits for the other; who is done first rests at its end.

    One diagonal of the coordination diagram, and the cells beside it: it also holds if the clocks of the arms differ by
    up to a step.
    """
    return bool(_in_step(a.centre, a.radius, a.parts, b.centre, b.radius, b.parts, float(margin_m)))


def free_cells(a: SweptArm, b: SweptArm, margin_m: float = MARGIN_M) -> BoolArray:
    """The coordination diagram of two arms.

    Args:
        a: One arm, k samples.
        b: The other, m samples.
        margin_m: Distance kept between them [m], >= 0.

    Returns:
        Where they keep that distance, shape (k, m).

    Raises:
        PlanningError: The margin is negative.
    """
    if not margin_m >= 0:
        raise PlanningError(f"free_cells: margin_m {margin_m}; valid: >= 0")
    free = np.empty((len(a), len(b)), dtype=np.bool_)
    _diagram(_room(a), _room(b), float(margin_m), free)
    return free


@kernel
def _gap(ca: FloatArray, ra: float, cb: FloatArray, rb: float) -> float:
    x = ca[0] - cb[0]
    y = ca[1] - cb[1]
    z = ca[2] - cb[2]
    return float(np.sqrt(x * x + y * y + z * z)) - ra - rb


@kernel
def clearance(
    ca: FloatArray, ra: FloatArray, parts_a: IntArray, cb: FloatArray, rb: FloatArray, parts_b: IntArray, margin: float
) -> float:
    """A lower bound on the distance beyond the margin, or, where there is none, minus the depth of some overlap."""
    least = np.inf
    for p in range(parts_a.shape[0] - 1, -1, -1):  # tips first: they meet most
        hull_a = parts_a[p, 0]
        for m in range(parts_b.shape[0] - 1, -1, -1):
            hull_b = parts_b[m, 0]
            gap = _gap(ca[hull_a], ra[hull_a], cb[hull_b], rb[hull_b]) - margin
            if gap > 0.0:
                least = min(least, gap)
                continue
            for s in range(parts_a[p, 1], parts_a[p, 2]):
                for t in range(parts_b[m, 1], parts_b[m, 2]):
                    gap = _gap(ca[s], ra[s], cb[t], rb[t]) - margin
                    if gap < 0.0:
                        return gap
                    least = min(least, gap)
    return least


@kernel
def _diagram(a: _Room, b: _Room, margin: float, free: BoolArray) -> None:
    """Fill `free`; a cell near one whose clearance is known is settled without looking, if it cannot have changed."""
    ca, ra, parts_a, change_a = a.centre, a.radius, a.parts, a.change
    cb, rb, parts_b, change_b = b.centre, b.radius, b.parts, b.change
    slack = np.zeros(cb.shape[0])  # clearance, at least, of the row above; minus depth, at most, where arms overlap
    for i in range(ca.shape[0]):
        left = 0.0
        for j in range(cb.shape[0]):
            known = 0.0
            if i > 0:
                known = _carried(slack[j], change_a[i - 1])
            if j > 0:
                beside = _carried(left, change_b[j - 1])
                if abs(beside) > abs(known):
                    known = beside
            if abs(known) < 1e-9:
                known = clearance(ca[i], ra[i], parts_a, cb[j], rb[j], parts_b, margin)
            free[i, j] = known >= 0.0
            slack[j] = known
            left = known


@kernel
def _in_step(
    ca: FloatArray, ra: FloatArray, parts_a: IntArray, cb: FloatArray, rb: FloatArray, parts_b: IntArray, margin: float
) -> bool:
    k, m = ca.shape[0], cb.shape[0]
    for step in range(max(k, m)):
        for slip in range(-1, 2):
            i = min(step, k - 1)
            j = min(max(step + slip, 0), m - 1)
            if clearance(ca[i], ra[i], parts_a, cb[j], rb[j], parts_b, margin) < 0.0:
                return False
    return True


@kernel
def _carried(known: float, change: float) -> float:
    """What is left of a clearance or a depth after a change; 0 = nothing is known."""
    if known > 0.0:
        return max(0.0, known - change)
    return min(0.0, known + change)
