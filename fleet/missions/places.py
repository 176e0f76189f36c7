"""Places: where cars can be sent, by name: docks, chargers, parking places, and cells of lanes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fleet.stations.stations import Stations
from fleet.tasks.place_names import PlaceNames
from maps.lane_graph import LaneGraph
from maps.site import Site
from maps.waiting_cells import waiting_cells

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
    """All places of a site. Those that are booked are numbered: stations as their arms, then chargers, parking, and
    storage.

    Args:
        site: The site.
        graph: Its lane graph.
        stations: The stations.
    """

    def __init__(self, site: Site, graph: LaneGraph, stations: Stations) -> None:
        self.chargers: tuple[int, ...] = tuple(graph.first_states(site.chargers).tolist())
        """Lane-graph state of each charger."""
        self.parking: tuple[int, ...] = tuple(graph.first_states(site.parking).tolist())
        """Lane-graph state of each parking place."""
        self.storage: tuple[int, ...] = tuple(graph.first_states(site.storage).tolist())
        """Lane-graph state of each storage place, below the pod of that number."""
        self.waiting = np.flatnonzero(np.isin(graph.state_cell[: graph.n_places], waiting_cells(site, graph)))
        """Lane-graph states in which cars may wait when all parking places are taken, ascending."""
        self._states = [*(station.dock_state for station in stations), *self.chargers, *self.parking, *self.storage]
        self.cells: tuple[int, ...] = tuple(graph.state_cell[self._states].tolist())
        """Cell of each place that is booked."""
        self.charger_numbers = range(len(stations), len(stations) + len(self.chargers))
        """Numbers of the chargers among the places that are booked."""
        self._site = site
        self._graph = graph
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
