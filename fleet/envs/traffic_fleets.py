"""The fleets whose right of way agents decide: one interface for all fidelities, and the grid behind it."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from fleet.envs.grid_fleet import FleetSite, GridFleet
from fleet.envs.grid_kernel import Counts, Ints
from fleet.envs.right_of_way import RightOfWay
from fleet.envs.traffic_view import TrafficView
from fleet.tasks.order import Delivery
from fleet.world.protocol import FloatArray


class TrafficFleet(Protocol):
    """One episode of a fleet whose moves are decided from outside."""

    counts: Counts
    """What has happened since `forget`."""

    def view(self) -> TrafficView:
        """The fleet now; holds until the next `move`."""

    def poses(self) -> FloatArray:
        """Where the cars are, x, y, yaw, shape (n_cars, 3)."""

    def move(self, wanted: Ints) -> npt.NDArray[np.bool_]:
        """Let a timestep pass.

        Args:
            wanted: State that each car wishes to go to, its own to wait, shape (n_cars,).

        Returns:
            True for each car that may go where it wished to, shape (n_cars,).
        """

    def forget(self) -> None:
        """Begin to count anew."""

    def copy(self) -> TrafficFleet | None:
        """A fleet at the same moment that goes on alike; None if only running again is exact."""

    def close(self) -> None:
        """Free what the fleet holds; calling twice is harmless."""


class GridTraffic:
    """A `TrafficFleet` on the grid: each ready task goes to the nearest free car, and arms take their mean time.

    Args:
        place: The site.
        n_cars: Number of cars.
        orders: Deliveries, ascending in release.
    """

    def __init__(self, place: FleetSite, n_cars: int, orders: Sequence[Delivery]) -> None:
        self.grid = GridFleet(place, n_cars, orders, seed=0)
        self.counts = self.grid.counts
        self._right_of_way = RightOfWay(place.graph.state_cell, place.graph.n_cells)
        self.grid.assign_nearest()

    def view(self) -> TrafficView:
        """See `TrafficFleet`."""
        grid, cars = self.grid, self.grid.cars
        return TrafficView(
            state=cars.state,
            goal=cars.goal,
            phase=cars.phase,
            held=cars.held,
            locked=grid.locked,
            priority=grid.priority,
        )

    def poses(self) -> FloatArray:
        """See `TrafficFleet`."""
        poses: FloatArray = self.grid.place.graph.state_pose[self.grid.cars.state]
        return poses

    def move(self, wanted: Ints) -> npt.NDArray[np.bool_]:
        """See `TrafficFleet`."""
        grid = self.grid
        after = self._right_of_way.resolve(grid.cars.state, wanted, grid.priority, grid.locked)
        granted: npt.NDArray[np.bool_] = after == wanted
        grid.move(after)
        grid.assign_nearest()
        return granted

    def forget(self) -> None:
        """See `TrafficFleet`."""
        self.grid.forget()

    def copy(self) -> GridTraffic:
        """See `TrafficFleet`."""
        twin = copy.copy(self)
        twin.grid = self.grid.copy()
        twin.counts = twin.grid.counts
        return twin

    def close(self) -> None:
        """See `TrafficFleet`."""
