"""SingleFile: a dead end is driven into by one car at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from fleet.traffic.open_lanes import OpenLanes
from fleet.traffic.single_file import NEAR_MOVES, PATIENCE_S, SingleFile
from maps.lane_graph import LaneGraph, build_lane_graph
from maps.site import Site, load_site
from maps.warehouse import generate_warehouse
from planners.mapf.distance_table import DistanceTable

SITE = load_site("small")
DEEP_SITE = generate_warehouse(rows=9, cols=17, pick=1, drop=1, parking=6)
DEEP_WRECKS = ((3, 10), (3, 14))
"""The way into the dock is longer than that far from it a car has to wait."""


class Floor:
    """A floor whose last dock is entered from behind only, since a wreck stands before it.

    Args:
        site: The site.
        wrecks: Rows and columns of further cells with a wreck.
    """

    def __init__(self, site: Site = SITE, wrecks: Sequence[tuple[int, int]] = ()) -> None:
        graph: LaneGraph = build_lane_graph(site)
        dock = site.stations[1].dock
        self.dock = graph.state_at(dock.cell, dock.heading)
        blocked = np.zeros(graph.n_cells, dtype=np.bool_)
        into = graph.in_move[graph.in_ptr[self.dock] : graph.in_ptr[self.dock + 1]]
        blocked[graph.state_cell[graph.move_from[into]]] = not wrecks
        blocked[[row * site.grid.cols + col for row, col in wrecks]] = True
        self.lanes = OpenLanes(graph)
        self.lanes.block(blocked)
        self.ways = DistanceTable(self.lanes.planned, blocked)
        self.file = SingleFile(self.lanes)
        left = self.ways.to(self.dock).astype(np.int64)
        inside = self.lanes.dead_ends[0]
        outside = [int(state) for state in np.argsort(left, kind="stable") if inside[state] < 0]
        self.near = [outside[0], next(state for state in outside if left[state] > left[outside[0]])]
        """Two states before the dead end, the nearer one first."""
        self.far = int(np.argmax(np.where(left < 1000, left, -1)))

    def goals(self, states: list[int], goals: list[int], still_s: list[float], now_s: float = 0.0) -> list[int]:
        arrays = np.array(goals, dtype=np.int32), np.array(states, dtype=np.int32)
        stay = arrays[0] == self.dock
        return self.file.goals(*arrays, stay, self.ways, np.array(still_s), now_s).tolist()


@pytest.fixture
def floor() -> Floor:
    return Floor()


def test_the_nearest_goes_first_and_the_next_one_waits(floor: Floor) -> None:
    a, b = floor.near
    assert floor.goals([b, a], [floor.dock] * 2, [0.0, 0.0]) == [b, floor.dock]
    assert floor.file.first == [1]


def test_who_is_far_away_drives_on(floor: Floor) -> None:
    states = [floor.near[0], floor.far]
    assert floor.goals(states, [floor.dock] * 2, [0.0, 0.0]) == [floor.dock] * 2


def test_nobody_goes_in_while_somebody_is_there(floor: Floor) -> None:
    states = [floor.near[0], floor.dock]
    assert floor.goals(states, [floor.dock, floor.far], [0.0, 0.0]) == [floor.near[0], floor.far]
    assert floor.file.first == []


def test_nobody_goes_in_while_somebody_stands_in_the_dock(floor: Floor) -> None:
    a = floor.near[0]
    assert floor.goals([a, floor.dock], [floor.dock] * 2, [0.0, 0.0]) == [a, floor.dock]
    assert floor.file.first == []


def test_nobody_goes_into_a_deep_dead_end_behind_another() -> None:
    floor = Floor(DEEP_SITE, DEEP_WRECKS)
    a, b = (floor.lanes.planned.state_at(DEEP_SITE.grid.cols + col, 0) for col in (9, 8))
    assert floor.ways.to(floor.dock)[a] > NEAR_MOVES
    assert floor.goals([b, a], [floor.dock] * 2, [0.0, 0.0]) == [b, floor.dock]


def test_who_cannot_move_lets_the_next_one_go(floor: Floor) -> None:
    a, b = floor.near
    assert floor.goals([a, b], [floor.dock] * 2, [0.0, 0.0]) == [floor.dock, b]
    later_s = PATIENCE_S + 1.0
    assert floor.goals([a, b], [floor.dock] * 2, [later_s, 0.0], later_s) == [a, floor.dock]


def test_who_waits_outside_an_outer_dead_end_has_no_turn_at_one_within() -> None:
    """Else he waits for whoever is in the outer one, and is waited for there."""
    site = generate_warehouse(rows=13, cols=29, pick=3, drop=3, parking=12)
    graph = build_lane_graph(site)
    blocked = np.zeros(graph.n_cells, dtype=np.bool_)
    blocked[[row * site.grid.cols + col for row, col in ((1, 24), (1, 25), (5, 2), (6, 2), (9, 1))]] = True
    lanes = OpenLanes(graph)
    lanes.block(blocked)
    ways, file = DistanceTable(lanes.planned, blocked), SingleFile(lanes)
    outside, between = graph.state_at(9 * site.grid.cols + 2, 2), graph.state_at(4 * site.grid.cols + 2, 3)
    docks = [graph.state_at(site.bays()[name], 1) for name in ("pick_2", "pick_1")]
    outer, inner = lanes.dead_ends
    assert outer[outside] < 0 <= outer[between] == outer[docks].max()
    assert inner[between] != inner[docks[0]] == inner[docks[1]] >= 0

    def goals(*wanted: int) -> list[int]:
        cars = np.array(wanted), np.array([outside, between]), np.ones(2, dtype=np.bool_)
        return file.goals(*cars, ways, np.zeros(2), 0.0).tolist()

    assert goals(docks[0], -1) == [docks[0], -1]
    assert goals(*docks) == [outside, docks[1]]


def test_without_dead_ends_all_drive_as_they_are_sent() -> None:
    graph = build_lane_graph(SITE)
    file = SingleFile(OpenLanes(graph))
    goals = np.array([3, 4], dtype=np.int32)
    ways = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_))
    assert file.goals(goals, goals, np.ones(2, dtype=np.bool_), ways, np.zeros(2), 0.0) is goals
