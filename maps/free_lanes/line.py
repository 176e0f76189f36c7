"""LaneLine: the line that a rear axle follows along an edge of a layout, by its arc length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maps.lane_graph import Floats
from maps.layouts.layout import Point

STEP_M = 0.02
"""About the distance between neighbouring points of a line [m]."""
_CONIC = math.sqrt(0.5)
"""Weight of the middle point of a conic that is a quarter circle."""
_SAME_M = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneLine:
    """A line that is driven forwards."""

    points: Floats
    """x, y [m], yaw [rad], yaw continuous, shape (k, 3)."""
    s: Floats
    """Arc length [m], ascending from 0, shape (k,)."""

    @property
    def length_m(self) -> float:
        """Arc length of the whole."""
        return float(self.s[-1])

    @property
    def radius_m(self) -> float:
        """Radius of its tightest bend, inf of a straight line [m]."""
        # Bends are measured over a tenth of a metre: between neighbouring points they are noise.
        n = max(1, round(0.1 / (self.length_m / (len(self.s) - 1))))
        n = min(n, len(self.s) - 1)
        turned = np.abs(self.points[n:, 2] - self.points[:-n, 2])
        bend = float((turned / (self.s[n:] - self.s[:-n])).max())
        return 1.0 / bend if bend > _SAME_M else math.inf

    def poses(self, s_m: Floats) -> Floats:
        """Poses at some arc lengths, shape (n, 3)."""
        return np.column_stack([np.interp(s_m, self.s, self.points[:, axis]) for axis in range(3)])

    def pose(self, s_m: float) -> tuple[float, float, float]:
        """The pose at one arc length."""
        x, y, yaw = self.poses(np.array([s_m]))[0].tolist()
        return x, y, yaw

    def beside(self, right_m: float) -> LaneLine:
        """The line so far to the right of this one."""
        if not right_m:
            return self
        yaw = self.points[:, 2]
        return line_through(self.points[:, :2] + right_m * np.column_stack((np.sin(yaw), -np.cos(yaw))), yaw)


def line_through(xy: Floats, yaw: Floats | None = None) -> LaneLine:
    """A line through points.

    Args:
        xy: Shape (k, 2), at least two places.
        yaw: Tangents, shape (k,); None = found from the points.
    """
    apart = np.hypot(*np.diff(xy, axis=0).T)
    kept = np.concatenate(([True], apart > _SAME_M))
    xy, apart = xy[kept], apart[kept[1:]]
    s = np.concatenate(([0.0], np.cumsum(apart)))
    if yaw is None:
        ahead = np.unwrap(np.arctan2(*np.diff(xy, axis=0).T[::-1]))
        middle = (ahead[1:] + ahead[:-1]) / 2
        # At its ends a line goes on bending as it does beside them.
        first, last = (
            (ahead[0], ahead[-1])
            if len(ahead) < 2
            else (1.5 * ahead[0] - 0.5 * ahead[1], 1.5 * ahead[-1] - 0.5 * ahead[-2])
        )
        angles = np.concatenate(([first], middle, [last]))
    else:
        angles = np.unwrap(yaw[kept])
    return LaneLine(points=np.column_stack((xy, angles)), s=s)


def line_of_curve(curve: Sequence[Sequence[Point]]) -> LaneLine:
    """A line along the pieces of a curve, see `maps.layouts.layout.LayoutEdge.curve`.

    Args:
        curve: Pieces that follow each other, of some length.
    """
    parts = [_sampled(np.array(piece, dtype=np.float64)) for piece in curve]
    return line_through(np.concatenate([part if not k else part[1:] for k, part in enumerate(parts)]))


def _sampled(piece: Floats) -> Floats:
    """Points on a piece, both ends included."""
    n = max(2, math.ceil(np.hypot(*np.diff(piece, axis=0).T).sum() / STEP_M) + 1)
    t = np.linspace(0.0, 1.0, n)[:, None]
    if len(piece) == 2:
        return np.asarray((1 - t) * piece[0] + t * piece[1])
    if len(piece) == 3:
        weights = np.hstack(((1 - t) ** 2, 2 * _CONIC * t * (1 - t), t**2))
        return np.asarray(weights @ piece / weights.sum(axis=1, keepdims=True))
    return np.asarray(np.hstack(((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3)) @ piece)
