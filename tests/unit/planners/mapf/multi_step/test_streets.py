"""Streets: rows and columns that are open get directions in turn."""

from __future__ import annotations

import numpy as np
import pytest

from maps.grid import GridMap
from maps.lane_graph import TURN, grid_lane_graph
from planners.errors import PlanningError
from planners.mapf.multi_step.streets import street_costs, street_share


def floor(*rows: str) -> GridMap:
    return GridMap(np.array([[letter == "." for letter in row] for row in rows], dtype=np.bool_))


AISLES = floor(".......", ".@@.@@.", ".......", ".@@.@@.", ".......")
"""Three rows and three columns, with racks between them."""


def cheap_moves(grid: GridMap, motion: str = "pebble") -> set[tuple[int, int]]:
    """Cells that a cheap move leads from and to."""
    graph = grid_lane_graph(grid, motion)  # type: ignore[arg-type]
    cost = street_costs(grid, graph, against=9)
    assert set(cost.tolist()) <= {1, 9}
    cells = np.column_stack((graph.state_cell[graph.move_from], graph.state_cell[graph.move_to]))
    return {(int(a), int(b)) for a, b in cells[cost == 1] if a != b}


def test_rows_and_columns_alternate() -> None:
    cheap = cheap_moves(AISLES)
    for row, east in ((0, True), (2, False), (4, True)):
        for column in range(6):
            cell = 7 * row + column
            assert ((cell, cell + 1) in cheap) is east
            assert ((cell + 1, cell) in cheap) is not east
    for column, south in ((0, True), (3, False), (6, True)):
        for row in range(4):
            cell = 7 * row + column
            assert ((cell, cell + 7) in cheap) is south
            assert ((cell + 7, cell) in cheap) is not south


def test_rows_between_pillars_are_no_streets() -> None:
    """Every second row is half free, and nobody drives along it: it must not take a direction from the next one."""
    pillars = floor("......", ".@.@.@", "......", ".@.@.@", "......")
    cheap = cheap_moves(pillars)
    assert ((0, 1) in cheap, (13, 12) in cheap, (24, 25) in cheap) == (True, True, True)


def test_turns_cost_one_and_headings_do_not_matter() -> None:
    graph = grid_lane_graph(AISLES, "rotating")
    assert (street_costs(AISLES, graph, against=5)[graph.move_kind == TURN] == 1).all()
    assert cheap_moves(AISLES, "rotating") == cheap_moves(AISLES)


def test_a_cave_has_hardly_any_streets_and_a_warehouse_nothing_else() -> None:
    assert street_share(AISLES) == 1.0
    cave = GridMap(np.random.default_rng(0).random((40, 40)) < 0.5)
    assert street_share(cave) < 0.05


@pytest.mark.parametrize("rows", [("@@@",), ("@",)])
def test_a_floor_without_free_cells_has_no_streets(rows: tuple[str, ...]) -> None:
    assert street_share(floor(*rows)) == 0.0


@pytest.mark.parametrize("against", [0, -3, 1001])
def test_a_cost_out_of_range_is_refused(against: int) -> None:
    graph = grid_lane_graph(AISLES, "pebble")
    with pytest.raises(PlanningError, match=f"against = {against}; valid: whole numbers from 1 to 1000"):
        street_costs(AISLES, graph, against=against)
