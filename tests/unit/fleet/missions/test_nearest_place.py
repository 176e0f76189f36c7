"""The nearest of some places by moves, found from where a car stands, as distances from all of them tell."""

import numpy as np

from fleet.missions.nearest_place import NOWHERE, PlaceSearch
from maps.lane_graph import build_lane_graph
from maps.site import load_site
from planners.mapf.distance_table import UNREACHABLE, DistanceTable


def test_it_is_the_nearest_and_the_smallest_of_equally_near_ones() -> None:
    graph = build_lane_graph(load_site("small"))
    draw = np.random.default_rng(0)
    n_ties = n_none = 0
    for _ in range(200):
        blocked = draw.random(graph.n_cells) < 0.1
        wanted = draw.random(graph.n_states + 1) < 0.03
        wanted[-1] = False
        state = int(draw.integers(graph.n_states))
        tables, places = DistanceTable(graph, blocked), np.flatnonzero(wanted)
        moves = np.array([int(tables.to(int(place))[state]) for place in places])
        found = PlaceSearch(graph, blocked).nearest(state, wanted)
        if not len(places) or moves.min() >= UNREACHABLE:
            assert found == NOWHERE
            n_none += 1
            continue
        assert found == places[moves.argmin()]
        n_ties += (moves == moves.min()).sum() > 1
    assert n_ties > 0
    assert n_none > 0
