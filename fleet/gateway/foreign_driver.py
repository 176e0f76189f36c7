"""ForeignDriver: grants become the base of foreign vehicles, and what they have passed is what our cars have driven."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from fleet.arrays import BoolArray, CellArray, FloatArray
from fleet.gateway.foreign_vehicles import ForeignVehicles
from fleet.traffic.drivers import StateDriver
from fleet.vda5050.growing_order import GrowingOrder, Waypoint
from fleet.world.protocol import World
from maps.lane_graph import LaneGraph


class ForeignDriver(StateDriver):
    """Lets a car of the grid world make a move when the vehicle that it stands for has passed the end of that move.

    So cells are given back late if at all, and nobody is granted one that a vehicle may still be in.

    Args:
        graph: Lane graph.
        start_states: State of each car, shape (n_cars,).
        states: Tells the state of each car of the world.
        vehicles: The vehicles, in the order of the cars.
        node_names: Name of the node of each state.
        map_id: Name of the map that nodes lie on.
    """

    def __init__(
        self,
        graph: LaneGraph,
        start_states: npt.NDArray[np.int32],
        states: Callable[[], npt.NDArray[np.int64]],
        vehicles: ForeignVehicles,
        node_names: list[str],
        map_id: str,
    ) -> None:
        super().__init__(graph, start_states, states)
        self._vehicles = vehicles
        self._names, self._map_id = node_names, map_id
        self._n_moved = np.zeros(len(start_states), dtype=np.int64)
        self._now_s = 0.0
        for car, state in enumerate(start_states.tolist()):
            vehicles.books[car] = GrowingOrder(f"car_{car}", self._waypoint(state))

    def append(self, cars: CellArray, moves: CellArray) -> None:
        """Release the ends of granted moves; see `Driver`."""
        super().append(cars, moves)
        for car, state in zip(cars.tolist(), self._graph.move_to[moves].tolist(), strict=True):
            self._book(car).extend(self._waypoint(state))

    def commands(self, world: World) -> FloatArray:
        """Hear the vehicles, and send what was released since; see `Driver`."""
        self._vehicles.hear()
        commands = super().commands(world)
        self._vehicles.speak(self._now_s)
        self._now_s += world.tick_s
        return commands

    def _stand(self, done: CellArray, world: World) -> BoolArray:
        self._n_moved[done] += 1
        passed = np.array([self._book(car).n_passed for car in range(len(self._n_moved))])
        return super()._stand(done, world) | (passed <= self._n_moved)

    def _book(self, car: int) -> GrowingOrder:
        book = self._vehicles.books[car]
        if book is None:
            raise AssertionError(f"car_{car} has an order book")
        return book

    def _waypoint(self, state: int) -> Waypoint:
        x, y, _ = self._graph.state_pose[state].tolist()
        return Waypoint(name=self._names[state], x=round(x, 4), y=round(y, 4), map_id=self._map_id)
