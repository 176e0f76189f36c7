"""Places: where cars can be sent, by name: docks, chargers, parking places, and cells of lanes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fleet.stations.station import Station
from fleet.tasks.place_names import PlaceNames
from fleet.traffic.replanning import Traffic
from maps.lane_graph import LaneGraph
from maps.site import Site
from planners.mapf.distance_table import UNREACHABLE

NOT_BOOKED = -1
"""Number of a place in a lane, which nobody books: who stands there goes on soon."""


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a car can be sent."""

    name: str
    states: tuple[int, ...]
    """Lane-graph states of a car that has come there; one for each way in."""
    number: int
    """Number among the places that are booked, or `NOT_BOOKED`."""


class Places:
    """All places of a site. Those that are booked are numbered: stations as their arms, then chargers, then parking.

    Args:
        site: The site.
        graph: Its lane graph.
        stations: In the order of the arms.
        traffic: Gives distances on the lane graph.
    """

    def __init__(self, site: Site, graph: LaneGraph, stations: Sequence[Station], traffic: Traffic) -> None:
        self.chargers: tuple[int, ...] = tuple(graph.first_states(site.chargers).tolist())
        """Lane-graph state of each charger."""
        self.parking: tuple[int, ...] = tuple(graph.first_states(site.parking).tolist())
        """Lane-graph state of each parking place."""
        self._states = [*(station.dock_state for station in stations), *self.chargers, *self.parking]
        self.cells: tuple[int, ...] = tuple(graph.state_cell[self._states].tolist())
        """Cell of each place that is booked."""
        self.charger_numbers = range(len(stations), len(stations) + len(self.chargers))
        """Numbers of the chargers among the places that are booked."""
        self._site = site
        self._graph = graph
        self._traffic = traffic
        self._number_of = {cell: number for number, cell in enumerate(self.cells)}
        self._places: dict[str, Place] = {}

    def named(self, name: str) -> Place:
        """The place that an order names."""
        if name not in self._places:
            cell = self._names.cell(name)
            number = self._number_of[cell] if self._names.is_bay(name) else NOT_BOOKED
            states = self._graph.states_of_cell(cell).tolist() if number == NOT_BOOKED else [self._states[number]]
            self._places[name] = Place(name=name, states=tuple(states), number=number)
        return self._places[name]

    @cached_property
    def _names(self) -> PlaceNames:
        return PlaceNames(self._site)

    def moves(self, place: Place, states: npt.NDArray[np.int32]) -> npt.NDArray[np.float64]:
        """Moves from each of some states to a place, `UNREACHABLE` where there is no way, shape of `states`."""
        rows = [self._traffic.tables.to(goal)[states] for goal in place.states]
        return np.minimum.reduce(rows).astype(np.float64)

    def nearest_state(self, place: Place, state: int) -> int:
        """The state in which a car comes to a place soonest."""
        return min(place.states, key=lambda goal: (int(self._traffic.tables.to(goal)[state]), goal))

    def reachable(self, place: Place, state: int) -> bool:
        """Whether there is a way to a place past all that is blocked."""
        return any(int(self._traffic.tables.to(goal)[state]) < UNREACHABLE for goal in place.states)
