"""SearchTree: what a sampling planner has looked at, for people who want to see why a path is as it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchTree:
    """Vertices and edges of one search, solved or not."""

    vertices: npt.NDArray[np.float64]
    """Configurations [rad], shape (v, n)."""
    edges: npt.NDArray[np.int64]
    """Pairs of vertices, shape (e, 2)."""


@runtime_checkable
class GrowsTrees(Protocol):
    """A planner that keeps its trees on request."""

    trees: list[SearchTree] | None
    """Where the tree of every search goes; None = they are not kept."""
