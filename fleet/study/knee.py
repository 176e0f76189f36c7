"""Knee: the size from which more of it brings clearly less."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

SENSITIVITY = 1.0
"""How many average steps the curve must fall below its lead before the knee counts; the authors' advice is 1."""


def find_knee(sizes: Sequence[float], gains: Sequence[float]) -> int | None:
    """Find the knee of a curve that rises and flattens.

    Both axes are scaled to 0..1; where the scaled curve leads the diagonal most there is a knee, provided that the lead
    falls by `SENSITIVITY` average steps afterwards. Of several the one with the greatest lead is taken. The means are
    taken as they are, without the spline by which the authors smooth.

    Args:
        sizes: Strictly ascending, at least one.
        gains: What each size achieves.

    Returns:
        Index of the knee; None if the curve has none: a straight line, or one that rises to the end.

    Source: V. Satopaa, J. Albrecht, D. Irwin, B. Raghavan, "Finding a 'Kneedle' in a Haystack: Detecting Knee Points in
    System Behavior", ICDCS Workshops 2011.
    """
    x, y = np.asarray(sizes, dtype=np.float64), np.asarray(gains, dtype=np.float64)
    if len(x) < 3 or y.max() <= y.min() or int(np.argmax(y)) == 0:
        return None
    x = (x - x[0]) / (x[-1] - x[0])
    y = (y - y.min()) / (y.max() - y.min())
    lead = y - x
    drop = SENSITIVITY * float(np.mean(np.diff(x)))
    knee = None
    for k in range(1, len(x) - 1):
        is_top = lead[k] >= lead[k - 1] and lead[k] >= lead[k + 1]
        if not is_top or (knee is not None and lead[k] <= lead[knee]):
            continue
        higher = np.flatnonzero(lead[k + 1 :] > lead[k])
        until = k + 1 + int(higher[0]) if len(higher) else len(x)
        if lead[k + 1 : until].min(initial=np.inf) < lead[k] - drop:
            knee = k
    return knee
