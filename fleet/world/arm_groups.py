"""Arm groups: which arms stand so near to each other that they work over one floor."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components

from fleet.arrays import FloatArray


def arm_groups(xy: FloatArray, within_m: float) -> list[list[int]]:
    """Group arms that are linked by gaps below a distance.

    Args:
        xy: Where they stand, shape (n_arms, 2) [m].
        within_m: The distance [m].

    Returns:
        Indices of the arms of each group, ascending; groups in the order of their first arms.
    """
    if not len(xy):
        return []
    apart = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    _, label = connected_components(apart < within_m, directed=False)
    groups = [np.flatnonzero(label == k).tolist() for k in range(label.max() + 1)]
    return sorted(groups, key=lambda arms: arms[0])
