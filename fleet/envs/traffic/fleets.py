"""The fleets whose right of way agents decide: one interface for all fidelities, and the grid behind it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from fleet.envs.grid.fleet import FleetSite, GridFleet
from fleet.envs.grid.kernel import Ints
from fleet.envs.layers.fleets import Fleet, FleetOnGrid
from fleet.envs.traffic.right_of_way import RightOfWay
from fleet.envs.traffic.view import TrafficView
from fleet.tasks.order import Delivery


class TrafficFleet(Fleet, Protocol):
    """One episode of a fleet whose moves are decided from outside."""

    def view(self) -> TrafficView:
        """The fleet now; holds until the next `move`."""

    def move(self, wanted: Ints) -> npt.NDArray[np.bool_]:
        """Let a timestep pass.

        Args:
            wanted: State that each car wishes to go to, its own to wait, shape (n_cars,).

        Returns:
            True for each car that may go where it wished to, shape (n_cars,).
        """


class GridTraffic(FleetOnGrid):
    """A `TrafficFleet` on the grid: each ready task goes to the nearest free car, and arms take their mean time.

    Args:
        place: The site.
        n_cars: Number of cars.
        orders: Deliveries, ascending in release.
    """

    def __init__(self, place: FleetSite, n_cars: int, orders: Sequence[Delivery]) -> None:
        super().__init__(GridFleet(place, n_cars, orders, seed=0))
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

    def move(self, wanted: Ints) -> npt.NDArray[np.bool_]:
        """See `TrafficFleet`."""
        grid = self.grid
        after = self._right_of_way.resolve(grid.cars.state, wanted, grid.priority, grid.locked)
        granted: npt.NDArray[np.bool_] = after == wanted
        grid.move(after)
        grid.assign_nearest()
        return granted
