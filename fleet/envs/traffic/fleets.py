"""The fleets whose right of way agents decide: one interface for all fidelities, and the grid behind it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from fleet.abstract.fleet import FleetSite, GridFleet
from fleet.abstract.kernel import Ints
from fleet.envs.layers.fleets import Fleet, FleetOnGrid
from fleet.envs.traffic.view import TrafficView
from fleet.tasks.order import Delivery


class TrafficFleet(Fleet, Protocol):
    """One episode of a fleet whose moves are decided from outside."""

    def view(self) -> TrafficView:
        """The fleet now; holds until the next `move`."""

    def move(self, wanted: Ints) -> Ints:
        """Let a timestep pass.

        Args:
            wanted: State that each car wishes to go to, its own to wait, shape (n_cars,).

        Returns:
            State that each car is sent to, its own to wait, shape (n_cars,).
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
            proposed=grid.proposed().copy(),
        )

    def move(self, wanted: Ints) -> Ints:
        """See `TrafficFleet`."""
        grid = self.grid
        after = grid.planned(wanted.astype(np.int32)).copy()
        grid.move(after)
        grid.assign_nearest()
        return after
