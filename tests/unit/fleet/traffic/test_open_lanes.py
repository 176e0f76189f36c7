"""OpenLanes: lanes are driven backwards where something has cut them for good, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.traffic.open_lanes import OpenLanes
from maps.lane_graph import LaneGraph, build_lane_graph
from maps.site import load_site

SITE = load_site("small")
DOCK = SITE.stations[0].dock


@pytest.fixture
def graph() -> LaneGraph:
    return build_lane_graph(SITE)


def blocked(graph: LaneGraph, *cells: int) -> np.ndarray:
    found = np.zeros(graph.n_cells, dtype=np.bool_)
    found[list(cells)] = True
    return found


def ahead_of_dock(graph: LaneGraph) -> int:
    """The cell that a car enters when it leaves the first dock."""
    state = graph.state_at(DOCK.cell, DOCK.heading)
    (move,) = graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]]
    return int(graph.state_cell[graph.move_to[move]])


def test_where_nothing_is_blocked_lanes_are_those_of_the_site(graph: LaneGraph) -> None:
    lanes = OpenLanes(graph)
    assert lanes.planned is lanes.granted is graph
    assert not lanes.block(blocked(graph))
    assert lanes.n_changes == 0


def test_a_dock_with_a_blocked_exit_is_left_backwards(graph: LaneGraph) -> None:
    lanes = OpenLanes(graph)
    assert lanes.block(blocked(graph, ahead_of_dock(graph)))
    dock = graph.state_at(DOCK.cell, DOCK.heading)
    outs = lanes.planned.out_move[lanes.planned.out_ptr[dock] : lanes.planned.out_ptr[dock + 1]]
    cells = {int(graph.state_cell[lanes.planned.move_to[move]]) for move in outs}
    assert cells > {ahead_of_dock(graph)}


def test_it_leads_out_of_a_dead_end_and_the_way_in_does_not(graph: LaneGraph) -> None:
    lanes = OpenLanes(graph)
    lanes.block(blocked(graph, ahead_of_dock(graph)))
    dock, parking = graph.state_at(DOCK.cell, DOCK.heading), int(graph.first_states(SITE.parking[:1])[0])
    both = np.array([dock, parking])
    assert [leaves.tolist() for leaves in lanes.leave(both, both[::-1])] == [[True, False]]


def test_lanes_are_one_way_again_when_all_is_open(graph: LaneGraph) -> None:
    lanes = OpenLanes(graph)
    lanes.block(blocked(graph, ahead_of_dock(graph)))
    assert lanes.block(blocked(graph))
    assert lanes.planned is graph
    assert lanes.leave(np.arange(3), np.arange(3) + 1) == []


def test_moves_keep_their_numbers_from_change_to_change(graph: LaneGraph) -> None:
    lanes = OpenLanes(graph)
    lanes.block(blocked(graph, ahead_of_dock(graph)))
    first = lanes.granted
    lanes.block(blocked(graph))
    lanes.block(blocked(graph, ahead_of_dock(graph), SITE.stations[2].dock.cell))
    n = first.n_moves
    np.testing.assert_array_equal(lanes.granted.move_from[:n], first.move_from)
    np.testing.assert_array_equal(lanes.granted.move_to[:n], first.move_to)


def test_what_is_walled_off_is_joined_to_nothing(graph: LaneGraph) -> None:
    lanes = OpenLanes(graph)
    dock = graph.state_at(DOCK.cell, DOCK.heading)
    lanes.block(blocked(graph, DOCK.cell))
    parking = graph.first_states(SITE.parking[:2])
    assert lanes.joins(parking, np.array([dock, parking[0]])).tolist() == [False, True]
