"""Obstacles of an arm in its base frame: boxes, capsules and spheres, all kept as boxes with rounded edges."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arrays import FloatArray, IntArray

ROW = 17
"""Columns of an obstacle in `rounded_boxes`."""
_SHORT_M = 1e-9


def _no_points() -> FloatArray:
    return np.empty((0, 3))


def _no_numbers() -> FloatArray:
    return np.empty(0)


def _no_frames() -> IntArray:
    return np.empty(0, dtype=np.int64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxes:
    """Upright boxes in the arm's base frame: turned about z only."""

    centre: FloatArray = field(default_factory=_no_points)
    """Box centres [m], shape (k, 3)."""
    half: FloatArray = field(default_factory=_no_points)
    """Half edge lengths [m], shape (k, 3)."""
    yaw: FloatArray = field(default_factory=_no_numbers)
    """Rotations about z [rad], shape (k,)."""
    min_frame: IntArray = field(default_factory=_no_frames)
    """Spheres on link frames below this are not tested (the base may stand on the floor), shape (k,)."""

    def __post_init__(self) -> None:
        for name in ("centre", "half", "yaw", "min_frame"):
            checks.is_array(f"Boxes.{name}", getattr(self, name))
        k = len(self.yaw)
        if self.centre.shape != (k, 3) or self.half.shape != (k, 3) or self.min_frame.shape != (k,):
            raise PlanningError(
                f"Boxes: centre {self.centre.shape}, half {self.half.shape}, yaw {self.yaw.shape}, "
                f"min_frame {self.min_frame.shape}; valid: (k, 3), (k, 3), (k,), (k,)"
            )
        if not np.all(self.half > 0) or not all(np.isfinite(x).all() for x in (self.centre, self.half, self.yaw)):
            finite = np.isfinite(np.column_stack([self.centre, self.half, self.yaw])).all(axis=1)
            bad = int(np.argmin(finite & (self.half > 0).all(axis=1)))
            centre, half, yaw = (rows[bad].tolist() for rows in (self.centre, self.half, self.yaw))
            raise PlanningError(f"Boxes: centre {centre}, half {half}, yaw {yaw}; valid: finite numbers, and half > 0")

    @classmethod
    def one(cls, centre: npt.ArrayLike, half: npt.ArrayLike, *, yaw: float = 0.0, min_frame: int = 0) -> Boxes:
        """A single box: centre (3,) and half edge lengths (3,) [m], yaw [rad]."""
        return cls(
            centre=checks.floats("Boxes: centre", centre).reshape(1, -1).copy(),
            half=checks.floats("Boxes: half", half).reshape(1, -1).copy(),
            yaw=checks.floats("Boxes: yaw", [yaw]),
            min_frame=np.array([min_frame], dtype=np.int64),
        )

    @classmethod
    def join(cls, *parts: Boxes) -> Boxes:
        """All boxes of several sets, in order."""
        if not parts:
            return cls()
        return cls(
            centre=np.concatenate([p.centre for p in parts]),
            half=np.concatenate([p.half for p in parts]),
            yaw=np.concatenate([p.yaw for p in parts]),
            min_frame=np.concatenate([p.min_frame for p in parts]),
        )

    def __len__(self) -> int:
        return len(self.yaw)


@dataclass(frozen=True, kw_only=True, eq=False)
class Capsules:
    """Line segments with a radius, in any direction; a sphere is a segment without length."""

    start: FloatArray = field(default_factory=_no_points)
    """One end of each segment [m], shape (k, 3)."""
    end: FloatArray = field(default_factory=_no_points)
    """The other end [m], shape (k, 3)."""
    radius: FloatArray = field(default_factory=_no_numbers)
    """Radii [m], shape (k,)."""
    min_frame: IntArray = field(default_factory=_no_frames)
    """Spheres on link frames below this are not tested, shape (k,)."""

    def __post_init__(self) -> None:
        for name in ("start", "end", "radius", "min_frame"):
            checks.is_array(f"Capsules.{name}", getattr(self, name))
        k = len(self.radius)
        if self.start.shape != (k, 3) or self.end.shape != (k, 3) or self.min_frame.shape != (k,):
            raise PlanningError(
                f"Capsules: start {self.start.shape}, end {self.end.shape}, radius {self.radius.shape}, "
                f"min_frame {self.min_frame.shape}; valid: (k, 3), (k, 3), (k,), (k,)"
            )
        if not np.all(self.radius > 0) or not all(np.isfinite(x).all() for x in (self.start, self.end, self.radius)):
            finite = np.isfinite(np.column_stack([self.start, self.end, self.radius])).all(axis=1)
            bad = int(np.argmin(finite & (self.radius > 0)))
            start, end, radius = (rows[bad].tolist() for rows in (self.start, self.end, self.radius))
            raise PlanningError(
                f"Capsules: start {start}, end {end}, radius {radius}; valid: finite numbers, and radius > 0"
            )

    @classmethod
    def one(cls, start: npt.ArrayLike, end: npt.ArrayLike, radius_m: float, *, min_frame: int = 0) -> Capsules:
        """A single capsule: ends (3,) and radius [m]."""
        return cls(
            start=checks.floats("Capsules: start", start).reshape(1, -1).copy(),
            end=checks.floats("Capsules: end", end).reshape(1, -1).copy(),
            radius=checks.floats("Capsules: radius", [radius_m]),
            min_frame=np.array([min_frame], dtype=np.int64),
        )

    @classmethod
    def spheres(cls, centre: npt.ArrayLike, radius_m: npt.ArrayLike) -> Capsules:
        """Spheres, such as those of another arm at rest: centres (k, 3) and radii (k,) [m]."""
        middle, radius = checks.spheres("Capsules: spheres", (centre, radius_m))
        return cls(start=middle, end=middle, radius=radius, min_frame=np.zeros(len(radius), dtype=np.int64))

    @classmethod
    def join(cls, *parts: Capsules) -> Capsules:
        """All capsules of several sets, in order."""
        if not parts:
            return cls()
        return cls(
            start=np.concatenate([p.start for p in parts]),
            end=np.concatenate([p.end for p in parts]),
            radius=np.concatenate([p.radius for p in parts]),
            min_frame=np.concatenate([p.min_frame for p in parts]),
        )

    def __len__(self) -> int:
        return len(self.radius)


def rounded_boxes(boxes: Boxes, capsules: Capsules) -> FloatArray:
    """All obstacles as boxes with a rounding radius, which is what the kernels test.

    Returns:
        Centre (3), half extents (3), the three axes of the box (9), rounding radius, lowest frame; shape (k, 17).
    """
    rows = np.zeros((len(boxes) + len(capsules), ROW))
    k = len(boxes)
    cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
    rows[:k, 0:3], rows[:k, 3:6] = boxes.centre, boxes.half
    rows[:k, 6], rows[:k, 7] = cos, sin
    rows[:k, 9], rows[:k, 10] = -sin, cos
    rows[:k, 14] = 1.0
    rows[:k, 16] = boxes.min_frame
    rows[k:, 0:3] = (capsules.start + capsules.end) / 2
    along = capsules.end - capsules.start
    length = np.linalg.norm(along, axis=1)
    rows[k:, 5] = length / 2
    for row, way, size in zip(rows[k:], along, length, strict=True):
        z = way / size if size > _SHORT_M else np.array([0.0, 0.0, 1.0])
        x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
        x /= np.linalg.norm(x)
        row[6:15] = np.concatenate([x, np.cross(z, x), z])
    rows[k:, 15] = capsules.radius
    rows[k:, 16] = capsules.min_frame
    return rows
