"""Fleets for whose cars agents decide: what those of every layer can do, and what is alike on the grid."""

from __future__ import annotations

import copy
from typing import Any, Protocol, Self

from fleet.abstract.fleet import GridFleet
from fleet.abstract.kernel import Counts
from fleet.arrays import FloatArray


class Fleet(Protocol):
    """One episode of a fleet for which agents decide."""

    counts: Counts
    """What has happened since `forget`."""

    def poses(self) -> FloatArray:
        """Where the cars are, x, y, yaw, shape (n_cars, 3)."""

    def forget(self) -> None:
        """Begin to count anew."""

    def copy(self) -> Any:
        """A fleet at the same moment that goes on alike; None if only running again is exact."""

    def close(self) -> None:
        """Free what the fleet holds; calling twice is harmless."""


class FleetOnGrid:
    """A `Fleet` on the grid.

    Args:
        grid: Its cars, tasks and stations.
    """

    def __init__(self, grid: GridFleet) -> None:
        self.grid = grid
        self.counts = grid.counts

    def poses(self) -> FloatArray:
        """See `Fleet`."""
        poses: FloatArray = self.grid.place.graph.state_pose[self.grid.cars.state]
        return poses

    def forget(self) -> None:
        """See `Fleet`."""
        self.counts.forget()

    def copy(self) -> Self:
        """See `Fleet`."""
        twin = copy.copy(self)
        twin.grid = self.grid.copy()
        twin.counts = twin.grid.counts
        return twin

    def close(self) -> None:
        """See `Fleet`."""
