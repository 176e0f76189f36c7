"""TableScene: what stands and lies on a table, with arms beside it; plain data for any world."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fleet.arrays import FloatArray
from fleet.world.scene import StaticBox


@dataclass(frozen=True, kw_only=True, eq=False)
class TableObject:
    """A thing that lies on the table."""

    name: str
    """'cube', 'sphere', 'cylinder', or what a file's object is called."""
    size_m: tuple[float, float, float]
    """Edges of its box; a cylinder's axis is z."""
    mass_kg: float
    pose: FloatArray
    """Where it is put, x, y, z, qx, qy, qz, qw, shape (7,)."""
    rgba: tuple[float, float, float, float]
    path: Path | None = None
    """Its description, for an object from a file."""
    scale: float = 1.0
    """Factor on the lengths of the description."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TableScene:
    """A table with arms; z = 0 is its top and the arms' feet."""

    arm: str
    """A key of `fleet.robots.ARMS`."""
    tool: str
    """Name of what the arms hold things with: 'suction' or 'friction'."""
    arm_base: FloatArray
    """Feet of the arms, x, y, z, yaw, shape (m, 4)."""
    boxes: tuple[StaticBox, ...]
    objects: tuple[TableObject, ...]
