"""Dubins curves: the shortest way forwards from one pose to another with bends of one radius.

Source: L. E. Dubins, "On curves of minimal length with a constraint on average curvature, and with prescribed initial
and terminal positions and tangents", American Journal of Mathematics 79(3), 1957. The formulas of the six words are
those of A. M. Shkel and V. Lumelsky, "Classification of the Dubins set", Robotics and Autonomous Systems 34(4), 2001.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from maps.free_lanes.line import STEP_M, LaneLine
from maps.lane_graph import Floats

Pose = tuple[float, float, float]
Leg = tuple[int, float]
"""Side of a bend, 1 left, -1 right, 0 straight; and its length, in radii."""

_WHOLE = math.tau
_ROUND = 1e-9
"""A bend this little short of a whole turn is none."""


def dubins_legs(start: Pose, end: Pose, radius_m: float) -> tuple[Leg, Leg, Leg]:
    """The three legs of the shortest way.

    Args:
        start: x, y [m], yaw [rad].
        end: The same.
        radius_m: Of its bends.
    """
    dx, dy = end[0] - start[0], end[1] - start[1]
    far, towards = math.hypot(dx, dy) / radius_m, math.atan2(dy, dx)
    words = _words(far, start[2] - towards, end[2] - towards)
    return min(words, key=lambda legs: sum(length for _, length in legs))


def dubins_line(start: Pose, end: Pose, radius_m: float) -> LaneLine:
    """The shortest way, by its points."""
    at, parts, lengths = np.array(start), [np.array([start])], [np.zeros(1)]
    driven = 0.0
    for side, length in dubins_legs(start, end, radius_m):
        length_m = length * radius_m
        if length_m < _ROUND:
            continue
        s = np.linspace(0.0, length_m, max(2, math.ceil(length_m / STEP_M) + 1))[1:]
        parts.append(_leg(at, side / radius_m, s))
        lengths.append(driven + s)
        at, driven = parts[-1][-1], driven + length_m
    return LaneLine(points=np.concatenate(parts), s=np.concatenate(lengths))


def _leg(at: Floats, bend: float, s: Floats) -> Floats:
    """Poses along a leg of one bend [1/m]."""
    yaw = at[2] + bend * s
    if not bend:
        x, y = s * math.cos(at[2]), s * math.sin(at[2])
    else:
        x, y = (np.sin(yaw) - math.sin(at[2])) / bend, (math.cos(at[2]) - np.cos(yaw)) / bend
    return np.column_stack((at[0] + x, at[1] + y, yaw))


def _words(d: float, a: float, b: float) -> Iterator[tuple[Leg, Leg, Leg]]:
    """The ways there are, in radii, in a frame in which the end lies so far ahead."""
    sa, sb, ca, cb = math.sin(a), math.sin(b), math.cos(a), math.cos(b)
    for side in (1, -1):  # left, straight, left; and mirrored
        square = 2 + d * d - 2 * math.cos(a - b) + 2 * side * d * (sa - sb)
        turn = math.atan2(side * (cb - ca), d + side * (sa - sb))
        if square >= 0.0:
            yield (side, _angle(side * (turn - a))), (0, math.sqrt(square)), (side, _angle(side * (b - turn)))
    for side in (1, -1):  # left, straight, right; and mirrored
        square = -2 + d * d + 2 * math.cos(a - b) + 2 * side * d * (sa + sb)
        if square >= 0.0:
            straight = math.sqrt(square)
            turn = math.atan2(-side * (ca + cb), d + side * (sa + sb)) + side * math.atan2(2.0, straight)
            yield (side, _angle(side * (turn - a))), (0, straight), (-side, _angle(side * (turn - b)))
    for side in (1, -1):  # left, right, left; and mirrored
        cosine = (6.0 - d * d + 2 * math.cos(a - b) - 2 * side * d * (sa - sb)) / 8.0
        if abs(cosine) <= 1.0:
            middle = _WHOLE - math.acos(cosine)
            first = _angle(side * (math.atan2(side * (cb - ca), d + side * (sa - sb)) - a) + middle / 2)
            yield (side, first), (-side, middle), (side, _angle(side * (b - a) - first + middle))


def _angle(value: float) -> float:
    """The angle from 0 to a whole turn."""
    angle = value % _WHOLE
    return 0.0 if _WHOLE - angle < _ROUND else angle
