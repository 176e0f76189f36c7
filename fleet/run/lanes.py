"""Lanes: the lane graph of a site for the cars of a run, and whether their bodies fit into it."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fleet.arrays import BoolArray
from fleet.config import USUAL_MODEL
from fleet.errors import ConfigError
from fleet.robots.cars.models import CarModels
from fleet.robots.spec import CarSpec
from maps.lane_graph import LaneGraph, build_lane_graph, side_by_side
from maps.site import Site


def lanes_for(site: Site, models: CarModels) -> LaneGraph:
    """Build the lane graph that all cars of a run drive on, in which each model has states and moves of its own.

    Args:
        site: The site.
        models: Models of the cars.

    Raises:
        ConfigError: The body of a model fits no lane to a station or parking place.
    """
    graphs = []
    for kind in models.kinds:
        # A pod is higher than arms hang over their docks.
        closed = [] if kind.lifts is None else [station.dock.cell for station in site.stations]
        footprint = None if kind.name == USUAL_MODEL else kind.footprint
        graphs.append(build_lane_graph(site, footprint=footprint, closed=closed))
        if kind.name != USUAL_MODEL:
            _require_ways(site, graphs[-1], kind)
        if kind.lifts is not None:
            _require_ways_to_pods(site, graphs[-1], kind)
    return side_by_side(graphs)


def _require_ways(site: Site, graph: LaneGraph, kind: CarSpec) -> None:
    """Refuse a model that cannot drive between all places where its cars have to come."""
    joined = _largest_part(graph, np.ones(graph.n_states, dtype=np.bool_))
    if kind.lifts is None:
        places = [(f"station {station.name}", station.dock.cell) for station in site.stations]
    else:
        places = [(f"the storage place at {site.grid.words(cell)}", cell) for cell in site.storage]
    parking = [(f"the parking place at {site.grid.words(cell)}", cell) for cell in site.parking]
    for name, cell in (*places, *parking):
        if not joined[graph.states_of_cell(cell)].any():
            length_m, width_m = kind.front_m + kind.rear_m, 2 * kind.half_width_m
            turns = f"in {kind.footprint.turn_radius_m:.2f} m" if kind.steers else "on the spot"
            raise ConfigError(
                f"model {kind.name}: its body of {length_m:.2f} x {width_m:.2f} m, which turns {turns}, "
                f"fits no lane to {name} of site {site.name}; "
                "valid: a model that does, or a site with wider lanes"
            )


def _require_ways_to_pods(site: Site, graph: LaneGraph, kind: CarSpec) -> None:
    """Refuse a site on which the ways to a pod, or from it, lead past where others stand: those are in the way."""
    for cell in site.storage:
        others = np.isin(graph.state_cell, [other for other in site.storage if other != cell])
        if not _largest_part(graph, ~others)[graph.states_of_cell(cell)].any():
            raise ConfigError(
                f"model {kind.name}: the storage place at {site.grid.words(cell)} of site {site.name} is behind "
                "another one, in which a pod stands; valid: storage places beside lanes"
            )


def _largest_part(graph: LaneGraph, usable: BoolArray) -> BoolArray:
    """Which states are in the largest part of the lanes in which ways over usable states lead from each to all."""
    both = usable[graph.move_from] & usable[graph.move_to]
    ends = np.stack((graph.move_from, graph.move_to))[:, both]
    moves = coo_array((np.ones(ends.shape[1], dtype=np.int8), ends), shape=(graph.n_states, graph.n_states))
    part_of = connected_components(moves, directed=True, connection="strong")[1]
    return np.asarray(part_of == np.bincount(part_of).argmax())
