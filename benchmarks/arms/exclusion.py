"""What two arms must lose at least because they cannot be over one tray at once, whatever plans them.

Each arm comes, rests and goes on within its joint limits, through any obstacle. If two postures over the tray exclude
each other, one arm has to leave before the other arrives. How soon one can follow the other is bounded by spheres: a
joint that starts from rest turns by at most half of its acceleration times the time squared, and moves no sphere by
more than that times the sphere's greatest distance from its axis; the same holds for an arm that comes to rest, back
from its arrival. In between, every two spheres that overlap in the postures have to be apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.motion.two_arms.asynchronous import least_times_s
from planners.motion.two_arms.diagram import MARGIN_M
from planners.motion.two_arms.swept import SweptArm, cover
from planners.motion.two_arms.together import Trip

FloatArray = npt.NDArray[np.float64]


def least_makespans_s(trips: Sequence[Trip]) -> tuple[float, float]:
    """Lower bounds on the makespan of two trips of one rest each, over one tray.

    Returns:
        One that is blind to the other arm, and one that is not [s].
    """
    come, leave, over, push = [], [], [], []
    for trip in trips:
        limits = trip.max_velocity, trip.max_acceleration
        tray, end = trip.stops
        come.append(least_times_s(tray, trip.start[None], *limits) + trip.dwell_s)
        leave.append(least_times_s(tray, end, *limits))
        over.append(cover(trip.arm, tray, np.zeros_like(tray), np.ones(len(tray), dtype=np.bool_)))
        push.append(trip.arm.lever @ trip.max_acceleration)
    blind_s = np.maximum((come[0] + leave[0])[:, None], (come[1] + leave[1])[None, :])
    best_s = np.inf
    for cell in np.argsort(blind_s, axis=None, kind="stable"):
        i, j = np.unravel_index(cell, blind_s.shape)
        if blind_s[i, j] >= best_s:
            break
        gap_s = _least_gap_s(over[0], int(i), push[0], over[1], int(j), push[1])
        found_s = float(blind_s[i, j])
        if gap_s > 0.0:
            dwell_s = trips[0].dwell_s, trips[1].dwell_s
            after = come[0][i] + gap_s + dwell_s[1] + leave[1][j], come[1][j] + gap_s + dwell_s[0] + leave[0][i]
            found_s = max(found_s, float(min(after)))
        best_s = min(best_s, found_s)
    return float(blind_s.min()), float(best_s)


def _least_gap_s(a: SweptArm, i: int, push_a: FloatArray, b: SweptArm, j: int, push_b: FloatArray) -> float:
    """Least time from when one arm leaves until the other arrives; 0 if both postures go together."""
    n, m = a.parts[:, 2].max(), b.parts[:, 2].max()
    return float(_least_gap(a.centre[i, :n], a.radius[i, :n], push_a[:n], b.centre[j, :m], b.radius[j, :m], push_b[:m]))


@njit(cache=True)
def _least_gap(ca, ra, push_a, cb, rb, push_b):
    """`push` is how much acceleration a sphere may have at most, shape (s,)."""
    longest = 0.0
    for s in range(ca.shape[0]):
        for t in range(cb.shape[0]):
            away = np.sqrt(np.sum((ca[s] - cb[t]) ** 2))
            depth = ra[s] + rb[t] + MARGIN_M - away
            if depth > 0.0:
                # Least of push_a t^2 / 2 + push_b (gap - t)^2 / 2 over t has to be the depth.
                both = push_a[s] * push_b[t] / (push_a[s] + push_b[t])
                longest = max(longest, np.sqrt(2.0 * depth / both))
    return longest
