"""Floor guidance: streets where a floor has them, assigned streams and fewer robots where it has bottlenecks."""

from __future__ import annotations

import numpy as np
import pytest

from maps.grid import GridMap
from maps.lane_graph import grid_lane_graph
from planners.mapf.multi_step.floor_guidance import FloorGuidance, guide_floor
from planners.mapf.multi_step.guidance import Errands


def guided(grid: GridMap, n_robots: int, *, seed: int = 0) -> FloorGuidance:
    """Guidance for tasks between random cells."""
    cells = np.random.default_rng(1).choice(np.flatnonzero(grid.free), 40).astype(np.int32)
    errands = Errands(ptr=np.arange(0, 41, 2, dtype=np.int32), cell=cells)
    return guide_floor(grid, grid_lane_graph(grid, "pebble"), errands, n_robots, seed=seed)


def halls(gap: int) -> GridMap:
    """Two caves that a passage of some cells' width joins."""
    free = np.random.default_rng(0).random((31, 61)) < 0.68
    free[:, 18:43] = False
    free[10 : 10 + gap, 17:44] = True
    return GridMap(free)


def test_racks_get_one_way_streets() -> None:
    free = np.ones((21, 21), dtype=np.bool_)
    free[1::2, 1:-1] = False
    graph = grid_lane_graph(GridMap(free), "pebble")
    guidance = guided(GridMap(free), 30)
    origin, target = graph.state_cell[graph.move_from], graph.state_cell[graph.move_to]
    east, west = target - origin == 1, target - origin == -1
    first_row, next_row = origin // 21 == 0, origin // 21 == 2
    assert guidance.cost[first_row & west].min() > 5 * guidance.cost[first_row & east].max()
    assert guidance.cost[next_row & east].min() > 5 * guidance.cost[next_row & west].max()
    assert guidance.share == 1.0


def test_the_fuller_a_cave_the_fewer_of_its_robots_push() -> None:
    few, many, full = (guided(halls(1), n).share for n in (8, 300, 600))
    assert few == 1.0
    assert full < many < 1.0
    assert full * 600 == pytest.approx(many * 300, rel=0.3)


def test_the_same_seed_guides_the_same() -> None:
    first, again = (guided(halls(2), 50, seed=3) for _ in range(2))
    assert (first.cost == again.cost).all()
    assert first.share == again.share
