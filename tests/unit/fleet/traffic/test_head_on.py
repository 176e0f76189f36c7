"""HeadOn: of two cars that want to go where the other stands, the one that cannot step aside goes first."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.traffic.head_on import PATIENCE_S, HeadOn
from fleet.traffic.open_lanes import OpenLanes
from maps.lane_graph import build_lane_graph
from maps.site import Site, load_site, site_from_plan
from planners.mapf.distance_table import DistanceTable

DRAWING = """
###############
_.....###....._
AP.K..###..K.DA
_....xxxxx...._
#..K..###..K..#
#.....###.....#
###############
""".strip().split("\n")
LATER_S = PATIENCE_S + 1.0


class Floor:
    """A car in the dock at the end of a lane, and one below it that backs up into the dock."""

    def __init__(self, site: Site) -> None:
        graph = build_lane_graph(site)
        dock = next(station.dock for station in site.stations if station.name == "drop_1")
        self.dock = graph.state_at(dock.cell, dock.heading)
        self.below = graph.state_at(dock.cell + site.grid.cols, dock.heading)
        parking = site.parking[-1]
        self.away = int(np.flatnonzero(graph.state_cell == parking)[0])
        self.ways = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_))
        self.head_on = HeadOn(OpenLanes(graph))

    def first(self, goals: list[int], states: list[int], still_s: float = LATER_S, *, fixed: bool = False) -> list[int]:
        arrays = np.array(goals, dtype=np.int32), np.array(states, dtype=np.int32)
        return self.head_on.first(*arrays, self.ways, np.full(2, still_s), np.array([fixed, False]))


@pytest.fixture
def floor() -> Floor:
    return Floor(site_from_plan(DRAWING, name="corridor", allow_reverse=True))


def test_who_cannot_step_aside_goes_first(floor: Floor) -> None:
    assert floor.first([floor.dock, floor.away], [floor.below, floor.dock]) == [1]
    assert floor.first([floor.away, floor.dock], [floor.dock, floor.below]) == [0]


def test_it_stays_first_until_it_is_there(floor: Floor) -> None:
    floor.first([floor.dock, floor.away], [floor.below, floor.dock])
    assert floor.first([floor.dock, floor.away], [floor.dock, floor.below], 0.0) == [1]
    assert floor.first([floor.dock, floor.away], [floor.dock, floor.away], 0.0) == []


def test_another_goal_ends_it(floor: Floor) -> None:
    floor.first([floor.dock, floor.away], [floor.below, floor.dock])
    assert floor.first([floor.dock, floor.below], [floor.below, floor.dock], 0.0) == []


def test_they_may_part_by_themselves_first(floor: Floor) -> None:
    assert floor.first([floor.dock, floor.away], [floor.below, floor.dock], PATIENCE_S - 1.0) == []


def test_who_cannot_move_met_nobody(floor: Floor) -> None:
    assert floor.first([floor.dock, floor.away], [floor.below, floor.dock], fixed=True) == []


def test_one_way_lanes_are_left_alone() -> None:
    floor = Floor(load_site("small"))
    assert floor.first([floor.dock, floor.below], [floor.below, floor.dock]) == []
