"""Bodies of cars on free lanes: which moves and places they take from each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from maps.lane_graph import Floats
from maps.vehicle import Footprint

SAMPLE_M = 0.1
"""A body is looked at after every so many metres of a move."""
MARGIN_M = 0.1
"""Kept round each body, for what cars drive beside their lines and between two samples [m]."""


def touching(paths: Sequence[Floats], body: Footprint) -> npt.NDArray[np.bool_]:
    """Which bodies touch each other anywhere on their paths, whenever each is where.

    Args:
        paths: Poses x, y, yaw of each path, shape (k, 3), one or more.
        body: Of all cars, with a margin round it.

    Returns:
        Shape (n, n), symmetric.
    """
    half = (body.front_m + body.rear_m) / 2 + MARGIN_M, body.half_width_m + MARGIN_M
    shift, reach = (body.front_m - body.rear_m) / 2, 2 * math.hypot(*half)
    frames = [_frames(path, shift) for path in paths]
    low = np.array([frame[:, :2].min(axis=0) for frame in frames])
    high = np.array([frame[:, :2].max(axis=0) for frame in frames])
    found = np.eye(len(frames), dtype=np.bool_)
    for i, frame in enumerate(frames):
        near = ((low[i] - reach < high) & (low < high[i] + reach)).all(axis=1)
        for j in np.flatnonzero(near[:i]).tolist():
            found[i, j] = found[j, i] = _touch(frame, frames[j], half, reach)
    return found


def sampled(points: Floats, s: Floats) -> Floats:
    """The poses of a path that are looked at, both ends included."""
    n = max(2, math.ceil(s[-1] / SAMPLE_M) + 1)
    at = np.linspace(0.0, s[-1], n)
    return np.column_stack([np.interp(at, s, points[:, axis]) for axis in range(3)])


def _frames(path: Floats, shift: float) -> Floats:
    """Middles of bodies and the directions of their noses, shape (k, 4)."""
    ahead = np.column_stack((np.cos(path[:, 2]), np.sin(path[:, 2])))
    return np.hstack((path[:, :2] + shift * ahead, ahead))


def _touch(these: Floats, those: Floats, half: tuple[float, float], reach: float) -> bool:
    """Whether one of some rectangles touches one of others: no side of either parts them."""
    apart = those[None, :, :2] - these[:, None, :2]
    i, j = np.nonzero((apart**2).sum(axis=2) < reach * reach)
    apart, ci, cj = apart[i, j], these[i, 2:], those[j, 2:]
    cos, sin = np.abs((ci * cj).sum(axis=1)), np.abs(ci[:, 0] * cj[:, 1] - ci[:, 1] * cj[:, 0])
    parted = np.zeros(len(i), dtype=np.bool_)
    for along in (ci, cj):
        ahead = np.abs((apart * along).sum(axis=1))
        aside = np.abs(along[:, 0] * apart[:, 1] - along[:, 1] * apart[:, 0])
        parted |= ahead > half[0] * (1 + cos) + half[1] * sin
        parted |= aside > half[1] * (1 + cos) + half[0] * sin
    return bool((~parted).any())
