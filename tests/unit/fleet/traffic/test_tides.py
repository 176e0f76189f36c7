"""Tides: narrow aisles are found, and entered by one direction at a time."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.traffic.narrow_aisles import narrow_aisles
from fleet.traffic.tides import TIDE_S, Tides
from maps.lane_graph import build_lane_graph
from maps.site import Site, load_site, site_from_plan
from planners.mapf.distance_table import DistanceTable

WITH_A_LOOP = """
####################
_...===========...._
AP..====xxx====...DA
_.xxxxxxxxxxxxxxxx._
#...===========....#
####################
""".strip().split("\n")
TWO_AISLES = """
###############
#...=====.....#
_.xxxxxxxxxx.._
AP..=====....DA
_.xxxxxxxxxx.._
#...=====.....#
###############
""".strip().split("\n")


def two_way(lines: list[str]) -> Site:
    return site_from_plan(lines, name="drawn", allow_reverse=True)


def aisle_cells(site: Site) -> list[set[tuple[int, int]]]:
    number = narrow_aisles(build_lane_graph(site))
    return [
        {(int(cell) // site.grid.cols, int(cell) % site.grid.cols) for cell in np.flatnonzero(number == k)}
        for k in range(number.max() + 1)
    ]


def test_an_aisle_lies_between_the_halls_it_alone_joins() -> None:
    west, east = aisle_cells(load_site("two_way"))
    assert west == {(6, col) for col in range(4, 8)}
    assert east == {(6, col) for col in range(11, 15)}


def test_a_place_to_pass_is_part_of_the_aisle() -> None:
    (aisle,) = aisle_cells(two_way(WITH_A_LOOP))
    assert aisle == {(3, col) for col in range(4, 15)} | {(2, col) for col in range(8, 11)}


def test_two_aisles_side_by_side_are_streets() -> None:
    assert aisle_cells(two_way(TWO_AISLES)) == []


@pytest.mark.parametrize("name", ["small", "medium"])
def test_one_way_lanes_have_none(name: str) -> None:
    assert aisle_cells(load_site(name)) == []


class Aisle:
    """Cars 0 and 1 west of the first aisle of `two_way`, car 2 east of it."""

    def __init__(self) -> None:
        self.site = load_site("two_way")
        self.graph = build_lane_graph(self.site)
        self.ways = DistanceTable(self.graph, np.zeros(self.graph.n_cells, dtype=np.bool_))
        self.tides = Tides(self.graph)
        self.east_goal = self.dock("drop_2")
        self.west_goal = self.dock("pick_2")
        self.west, self.east = self.at(6, 3, 0), self.at(6, 8, 2)

    def dock(self, name: str) -> int:
        dock = self.site.station(name).dock
        return self.graph.state_at(dock.cell, dock.heading)

    def at(self, row: int, col: int, heading: int) -> int:
        state = self.graph.state_at(row * self.site.grid.cols + col, heading)
        assert state >= 0
        return state

    def held(self, states: list[int], goals: list[int], now_s: float, *, stay: bool = True) -> list[int]:
        """Cars that are not sent to their goals."""
        n = len(states)
        wanted, where = np.array(goals, dtype=np.int32), np.array(states, dtype=np.int32)
        nobody, all_stay = np.zeros(n, dtype=np.bool_), np.full(n, stay)
        found = self.tides.goals(wanted, where, all_stay, nobody, self.ways, now_s)
        assert (found[found != wanted] == where[found != wanted]).all(), "who waits stays where it is"
        return np.flatnonzero(found != wanted).tolist()


@pytest.fixture
def aisle() -> Aisle:
    return Aisle()


def test_those_who_meet_take_turns(aisle: Aisle) -> None:
    goals = [aisle.east_goal, aisle.west_goal]
    (held,) = aisle.held([aisle.west, aisle.east], goals, 100.0)
    assert aisle.held([aisle.west, aisle.east], goals, 101.0) == [held]


def test_others_follow_until_the_tide_is_over(aisle: Aisle) -> None:
    inside = aisle.at(6, 5, 0)
    states = [inside, aisle.west, aisle.east]
    goals = [aisle.east_goal, aisle.east_goal, aisle.west_goal]
    assert aisle.held(states, goals, 100.0) == [2]
    assert aisle.tides.first == [0], "who is inside goes first"
    assert aisle.held(states, goals, 101.0 + TIDE_S) == [1, 2], "it empties"
    assert aisle.held([aisle.east_goal, *states[1:]], goals, 102.0 + TIDE_S) == [1], "and turns"


def test_nobody_waits_for_the_other_direction_while_nobody_wants_it(aisle: Aisle) -> None:
    states, goals = [aisle.at(6, 5, 0), aisle.west], [aisle.east_goal] * 2
    assert aisle.held(states, goals, 0.0) == []
    assert aisle.held(states, goals, 10 * TIDE_S) == []


def test_who_has_come_out_is_not_pushed_back(aisle: Aisle) -> None:
    out = aisle.at(6, 8, 0)  # the cell that a car from the east would enter by
    blocked_by_it = aisle.at(6, 9, 2)
    assert aisle.held([out, blocked_by_it], [aisle.east_goal, aisle.west_goal], 0.0) == [1]
    assert aisle.tides.first == [0]


def test_a_far_car_drives_on(aisle: Aisle) -> None:
    states = [aisle.at(6, 5, 0), aisle.east_goal]
    assert aisle.held(states, [aisle.east_goal, aisle.west_goal], 0.0) == []
