"""Charging: which task a car has the charge for, which car charges where, and how long it stays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.robots.battery import Batteries
from fleet.stations.booking import Bookings
from fleet.stations.service_time import Direction, ServiceTimes
from fleet.stations.station import Station
from fleet.traffic import Traffic
from fleet.world.protocol import FloatArray
from planners.mapf.distance_table import UNREACHABLE

MOVE_M = 1.0
"""Length of a move: one cell [m]."""
SLOW_MOVE_S = 3.3
"""Time of a move in dense traffic, three times that without [s]; what is not used stays in the battery."""


class Charging:
    """Chargers as places with room for one car each.

    The rule that a task must leave enough charge to reach a charger is that of Open-RMF (rmf_ros2, pull request 423).

    Args:
        batteries: State of charge of the cars.
        states: Lane-graph state of each charger.
        first_place: Number of the first charger among the places that are booked.
        bookings: Who has which place.
        traffic: Gives distances on the lane graph.
        service_times: How long stations take.
    """

    def __init__(
        self,
        batteries: Batteries,
        states: tuple[int, ...],
        first_place: int,
        bookings: Bookings,
        traffic: Traffic,
        service_times: ServiceTimes,
    ) -> None:
        self.batteries = batteries
        self.states = states
        self.sessions_n = 0
        """How often a car began to charge."""
        self._first = first_place
        self._bookings = bookings
        self._traffic = traffic
        self._service_times = service_times

    def is_low(self, car: int) -> bool:
        """Below the first threshold."""
        return bool(self.batteries.charge[car] < self.batteries.config.low)

    def is_critical(self, car: int) -> bool:
        """Below the second threshold."""
        return bool(self.batteries.charge[car] < self.batteries.config.critical)

    def has_enough(self, car: int) -> bool:
        """Whether a charging car may be given a task, or make room."""
        return bool(self.batteries.charge[car] >= self.batteries.config.enough)

    def is_full(self, car: int) -> bool:
        """Whether there is nothing more to wait for at the charger."""
        return bool(self.batteries.charge[car] >= self.batteries.config.full)

    def allows(
        self, cars: list[int], to_pick: FloatArray, pick: Station, drop: Station, load_kg: float
    ) -> npt.NDArray[np.bool_]:
        """Which cars could do a task and still reach a charger.

        Args:
            cars: The cars.
            to_pick: Moves of each to the pick station, shape (k,).
            pick: Where the parcel is.
            drop: Where it goes.
            load_kg: Its mass.

        Returns:
            The verdict on each car, shape (k,).
        """
        loaded_n = self._moves(pick, drop)
        served_s = self._service_times.of(pick.arm, Direction.TO_CAR).p90_s
        # At the drop station those before it are served first.
        served_s += self._bookings.caps[drop.arm] * self._service_times.of(drop.arm, Direction.FROM_CAR).p90_s
        home_n = float(self.moves_home(np.array([drop.dock_state]))[0])
        empty = self.batteries.share(MOVE_M * (to_pick + home_n), SLOW_MOVE_S * (to_pick + home_n))
        loaded = self.batteries.share(MOVE_M * loaded_n, SLOW_MOVE_S * loaded_n + served_s, load_kg)
        spare = self.batteries.charge[cars] - empty - loaded
        return np.asarray(spare >= self.batteries.config.margin)

    def moves_home(self, states: npt.NDArray[np.int_]) -> FloatArray:
        """Moves to the nearest charger, occupied or not, inf where there is no way, shape of `states`."""
        moves = np.full(len(states), np.inf)
        for goal in self.states:
            row = self._traffic.tables.to(goal)[states].astype(np.float64)
            moves = np.minimum(moves, np.where(row >= UNREACHABLE, np.inf, row))
        return moves

    def free_charger(self, state: int) -> int | None:
        """The nearest charger that is free and can be reached from a state, as a place; None if there is none."""
        best, best_n = None, UNREACHABLE
        for k, goal in enumerate(self.states):
            moves_n = int(self._traffic.tables.to(goal)[state])
            if moves_n < best_n and self._bookings.room(self._first + k) > 0:
                best, best_n = self._first + k, moves_n
        return best

    def state_of(self, place: int) -> int:
        """Lane-graph state of a charger."""
        return self.states[place - self._first]

    def by_need(self, cars: list[int]) -> list[int]:
        """Cars, emptiest first."""
        return sorted(cars, key=lambda car: (float(self.batteries.charge[car]), car))

    def _moves(self, start: Station, goal: Station) -> float:
        moves_n = int(self._traffic.tables.to(goal.dock_state)[start.dock_state])
        return float("inf") if moves_n >= UNREACHABLE else float(moves_n)
