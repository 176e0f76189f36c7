"""Traffic assignment: streams are conserved, opposing ones part, and what is odd is refused or comes out as nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from maps.grid import GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.errors import PlanningError
from planners.mapf.distance_table import DistanceTable
from planners.mapf.multi_step.guidance import Errands
from planners.mapf.multi_step.traffic_assignment import UNIT, AssignmentConfig, Streams, assign_traffic

ROUND_ABOUT = GridMap(
    np.array([[letter == "." for letter in row] for row in ("..........", ".@@@@@@@@.", "..........")], dtype=np.bool_)
)
TO_AND_FRO = Errands(ptr=np.array([0, 2], dtype=np.int32), cell=np.array([10, 19], dtype=np.int32))
"""Tasks from the middle of the left side to the middle of the right one, and the way back."""


def assigned(grid: GridMap = ROUND_ABOUT, errands: Errands = TO_AND_FRO, **settings: Any) -> tuple[LaneGraph, Streams]:
    graph = grid_lane_graph(grid, "pebble")
    first = 1 + (np.arange(graph.n_moves) % 2).astype(np.int32)
    config = AssignmentConfig(**({"goals": 20} | settings))
    return graph, assign_traffic(grid, graph, errands, 10, first_cost=first, config=config)


def through(graph: LaneGraph, flow: np.ndarray, origin: int, target: int) -> float:
    cells = graph.state_cell[graph.move_from], graph.state_cell[graph.move_to]
    return float(flow[(cells[0] == origin) & (cells[1] == target)].sum())


def test_all_robots_are_on_their_way() -> None:
    _, traffic = assigned()
    assert traffic.flow.sum() == pytest.approx(10.0)
    assert (traffic.flow >= 0).all()


def test_what_drives_into_a_cell_drives_out_of_it() -> None:
    graph, traffic = assigned(rounds=1)
    into = np.bincount(graph.move_to, weights=traffic.flow, minlength=graph.n_states)
    out = np.bincount(graph.move_from, weights=traffic.flow, minlength=graph.n_states)
    between = ~np.isin(graph.state_cell, TO_AND_FRO.cell)
    assert into[between] == pytest.approx(out[between])


def test_opposing_streams_take_different_aisles() -> None:
    graph, traffic = assigned()
    upper = through(graph, traffic.flow, 4, 5), through(graph, traffic.flow, 5, 4)
    lower = through(graph, traffic.flow, 24, 25), through(graph, traffic.flow, 25, 24)
    assert (upper[0] > upper[1]) == (lower[1] > lower[0])
    assert max(upper) > 4 * min(upper)
    assert max(lower) > 4 * min(lower)
    assert through(graph, traffic.cost, 4, 5) != through(graph, traffic.cost, 5, 4)


def test_without_a_price_on_meeting_every_move_costs_one() -> None:
    _, traffic = assigned(meeting=0.0)
    assert (traffic.cost == UNIT).all()


def test_costs_are_capped() -> None:
    _, traffic = assigned(meeting=1000.0, most=7)
    assert traffic.cost.max() == 8 * UNIT
    assert traffic.cost.dtype == np.int32


def test_crowds_make_a_neighbourhood_dearer_and_not_an_aisle() -> None:
    """Everybody drives through the upper of two neighbouring aisles: both get dearer, the far one hardly."""
    rows = ["." * 30] + ["." + "@" * 28 + "."] + ["." * 30] + ["." + "@" * 28 + "."] * 20 + ["." * 30]
    grid = GridMap(np.array([[letter == "." for letter in row] for row in rows], dtype=np.bool_))
    graph = grid_lane_graph(grid, "pebble")
    errands = Errands(ptr=np.array([0, 2], dtype=np.int32), cell=np.array([0, 29], dtype=np.int32))
    config = AssignmentConfig(meeting=0.0, crowding=2.0, around=5, rounds=1, goals=10)
    traffic = assign_traffic(grid, graph, errands, 50, config=config)
    near, next_one, far = (through(graph, traffic.cost, 30 * row + 14, 30 * row + 15) for row in (0, 2, 23))
    assert near == next_one > far == UNIT


def test_costs_are_halved_until_the_longest_way_can_be_held() -> None:
    """A serpentine of 4,000 cells, whose ways against a dear direction no table could hold."""
    n, width = 80, 100
    free = np.zeros((n, width), dtype=np.bool_)
    free[::2] = True
    free[1::4, -1] = free[3::4, 0] = True
    grid = GridMap(free)
    graph = grid_lane_graph(grid, "pebble")
    ends = np.array([0, (n - 2) * width + (width - 1)], dtype=np.int32)
    errands = Errands(ptr=np.array([0, 2], dtype=np.int32), cell=ends)
    own = np.where(graph.move_to > graph.move_from, 1, 24).astype(np.int32)
    config = AssignmentConfig(meeting=0.0, rounds=1, goals=5)
    traffic = assign_traffic(grid, graph, errands, 5, own_cost=own, config=config)
    assert 2 <= traffic.cost.max() < 24 * UNIT
    table = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_), move_costs=traffic.cost)
    for state in range(0, graph.n_states, 500):
        table.to(state)


def test_ways_of_the_same_cost_share_a_stream() -> None:
    """Two robots' worth of traffic around a square, half of it either way."""
    square = GridMap(np.array([[True, True], [True, True]]))
    errands = Errands(ptr=np.array([0, 2], dtype=np.int32), cell=np.array([0, 3], dtype=np.int32))
    graph = grid_lane_graph(square, "pebble")
    traffic = assign_traffic(square, graph, errands, 2, config=AssignmentConfig(rounds=1, goals=40))
    assert through(graph, traffic.flow, 0, 1) == pytest.approx(through(graph, traffic.flow, 0, 2))


def test_the_same_seed_assigns_the_same() -> None:
    first, again = assigned()[1], assigned()[1]
    assert (first.flow == again.flow).all()


def test_goals_out_of_reach_draw_no_stream() -> None:
    parted = GridMap(np.array([[True, True, False, True, True]]))
    errands = Errands(ptr=np.array([0, 2], dtype=np.int32), cell=np.array([0, 4], dtype=np.int32))
    graph = grid_lane_graph(parted, "pebble")
    traffic = assign_traffic(parted, graph, errands, 3, config=AssignmentConfig(rounds=2, goals=5))
    assert traffic.flow.sum() == 0.0


def test_a_floor_of_one_cell_has_no_moves() -> None:
    cell = GridMap(np.array([[True]]))
    graph = grid_lane_graph(cell, "pebble")
    errands = Errands(ptr=np.array([0, 1], dtype=np.int32), cell=np.array([0], dtype=np.int32))
    assert assign_traffic(cell, graph, errands, 1).flow.shape == (0,)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("rounds", 0),
        ("goals", 0),
        ("meeting", -1.0),
        ("meeting", 1001.0),
        ("most", -1),
        ("most", 1000),
        ("memory", 1.0),
    ],
)
def test_settings_out_of_range_are_refused(setting: str, value: float) -> None:
    with pytest.raises(PlanningError, match=f"traffic assignment: {setting} = {value}"):
        AssignmentConfig(**{setting: value})  # type: ignore[arg-type]
