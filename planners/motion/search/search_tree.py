"""SearchTree: what a sampling planner has looked at, for people who want to see why a path is as it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from planners.motion.arrays import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchTree:
    """Vertices and edges of one search, solved or not."""

    vertices: FloatArray
    """Configurations [rad], shape (v, n)."""
    edges: IntArray
    """Pairs of vertices, shape (e, 2)."""


@runtime_checkable
class GrowsTrees(Protocol):
    """A planner that keeps its trees on request."""

    trees: list[SearchTree] | None
    """Where the tree of every search goes; None = they are not kept."""
