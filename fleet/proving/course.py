"""Course: a way of straights, curves and turns on the spot that a vehicle drives alone, up to a dock."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.pursuit import PathBuffer
from fleet.robots.twist.path import Piece, arc, straight, turn
from fleet.robots.twist.rejoin import turn_drive_turn

_QUARTER_RAD = math.pi / 2
RADIUS_M = 0.5
"""Of the curves [m]."""


LegKind = Literal["straight", "curve", "turn"]


@dataclass(frozen=True, kw_only=True)
class Leg:
    """One part of a course."""

    kind: LegKind
    size: float
    """Length of a straight [m]; angle of a curve or a turn, positive to the left [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """A course as points.

    It is one path: `line` holds all of it, and leg `k` ends at arc length `ends_s[k]`.
    """

    legs: tuple[Leg, ...]
    pieces: tuple[Piece, ...]
    directions: tuple[int, ...]
    """+1 forward, -1 reverse, one for each piece."""
    line: FloatArray
    """Poses x, y, yaw, shape (n, 3)."""
    line_s: FloatArray
    """Arc length of each [m], shape (n,)."""
    ends_s: FloatArray
    """Shape (n_legs,)."""

    @staticmethod
    def of(legs: tuple[Leg, ...]) -> Course:
        """Lay out legs one behind the other, from the origin along x."""
        pose, pieces = np.zeros(3), []
        for leg in legs:
            if leg.kind == "straight":
                pieces.append(straight(pose, leg.size))
            elif leg.kind == "curve":
                pieces.append(arc(pose, RADIUS_M, leg.size))
            else:
                pieces.append(turn(pose, leg.size))
            pose = pieces[-1][0][-1]
        return _joined(legs, tuple(pieces), (1,) * len(pieces))

    @staticmethod
    def back_to(goal: FloatArray) -> Course:
        """The manoeuvre by which a robot that turns on the spot comes from the origin to a pose x, y, yaw."""
        found = turn_drive_turn(np.zeros(3), goal)
        if found is None:
            raise ValueError(f"no manoeuvre to {goal.tolist()}; valid: a pose that nothing blocks")
        legs = tuple(
            Leg(kind="turn", size=float(points[-1, 2] - points[0, 2]))
            if (points[0, :2] == points[-1, :2]).all()
            else Leg(kind="straight", size=float(s[-1]))
            for points, s in found.pieces
        )
        return _joined(legs, found.pieces, found.directions)

    @property
    def way_m(self) -> float:
        """How far the reference point goes [m]."""
        return float(np.hypot(*np.diff(self.line[:, :2], axis=0).T).sum())

    def paths(self) -> PathBuffer:
        """The course as the path of one vehicle."""
        paths = PathBuffer(1)
        paths.reset(0, self.line[0])
        for (points, s), direction in zip(self.pieces, self.directions, strict=True):
            paths.append(0, points, s, direction)
        return paths

    def leg_at(self, progress_s: float) -> int:
        """The leg that an arc length lies in."""
        return min(int(np.searchsorted(self.ends_s, progress_s)), len(self.legs) - 1)

    def off(self, place: FloatArray, progress_s: float, window_m: float = 0.5) -> float:
        """Distance of a place x, y from the course near an arc length [m]."""
        first = max(int(np.searchsorted(self.line_s, progress_s - window_m)) - 1, 0)
        last = int(np.searchsorted(self.line_s, progress_s + window_m)) + 1
        line = self.line[first : last + 1, :2]
        a, step = line[:-1], np.diff(line, axis=0)
        square = np.maximum((step**2).sum(axis=1), 1e-12)
        share = np.clip(((place - a) * step).sum(axis=1) / square, 0.0, 1.0)
        return float(np.hypot(*(place - a - share[:, None] * step).T).min())


def _joined(legs: tuple[Leg, ...], pieces: tuple[Piece, ...], directions: tuple[int, ...]) -> Course:
    """Pieces one behind the other, the first of which begins at the origin."""
    points, lengths, ends = [np.zeros((1, 3))], [np.zeros(1)], [0.0]
    for piece, s in pieces:
        points.append(piece[1:])
        lengths.append(ends[-1] + s[1:])
        ends.append(ends[-1] + float(s[-1]))
    return Course(
        legs=legs,
        pieces=pieces,
        directions=directions,
        line=np.concatenate(points),
        line_s=np.concatenate(lengths),
        ends_s=np.array(ends[1:]),
    )


def _legs(*told: tuple[LegKind, float]) -> tuple[Leg, ...]:
    return tuple(Leg(kind=kind, size=size) for kind, size in told)


_CURVES = _legs(
    ("straight", 2.0),
    ("curve", _QUARTER_RAD),
    ("straight", 1.0),
    ("curve", -_QUARTER_RAD),
    ("straight", 1.0),
    ("curve", -_QUARTER_RAD),
    ("straight", 1.0),
    ("curve", _QUARTER_RAD),
    ("straight", 2.0),
)
_TURNS = _legs(
    ("turn", _QUARTER_RAD),
    ("straight", 1.0),
    ("turn", -_QUARTER_RAD),
    ("straight", 1.5),
)
CURVES = Course.of(_CURVES)
"""Straights and curves to both sides, for whatever drives; it ends at a dock."""
CURVES_AND_TURNS = Course.of(_CURVES + _TURNS)
"""The same, then turns on the spot to both sides."""
LANES = Course.of(_legs(("straight", 12.5), ("turn", _QUARTER_RAD)) * 4)
"""Fifty metres of lanes round a block, with four corners."""
