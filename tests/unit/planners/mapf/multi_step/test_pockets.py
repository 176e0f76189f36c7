"""Priorities grow until the goal is reached; pockets are found on every kind of graph."""

from __future__ import annotations

import numpy as np

from maps.grid import GridMap
from maps.lane_graph import grid_lane_graph
from planners.mapf.multi_step.pockets import pocket_depth
from planners.mapf.multi_step.priorities import Priorities
from tests.unit.planners.mapf.lanes import one_way_loop, open_grid


def test_a_tail_of_a_ring_is_deeper_with_each_cell() -> None:
    free = np.array([[1, 1, 0, 0], [1, 1, 1, 1]], dtype=np.bool_)
    for motion in ("pebble", "rotating"):
        assert pocket_depth(grid_lane_graph(GridMap(free), motion)).tolist() == [0, 0, 0, 0, 0, 0, 1, 2]


def test_a_bay_with_one_entrance_is_one_pocket() -> None:
    """Below the open floor a square of four cells that one of them connects; the cell above it is the bottleneck."""
    free = np.array([[1, 1, 1, 1], [1, 1, 1, 1], [1, 0, 0, 0], [1, 1, 0, 0], [1, 1, 0, 0]], dtype=np.bool_)
    depth = pocket_depth(grid_lane_graph(GridMap(free), "pebble")).reshape(5, 4)
    assert depth.tolist() == [[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [2, 3, 0, 0], [3, 3, 0, 0]]


def test_loops_have_no_pockets() -> None:
    assert not pocket_depth(one_way_loop(5)).any()
    assert not pocket_depth(open_grid(3, 3)).any()


def test_a_floor_of_one_cell_has_no_pockets() -> None:
    assert pocket_depth(open_grid(1, 1)).tolist() == [0]


def test_each_part_of_the_floor_has_an_open_floor_of_its_own() -> None:
    free = np.array([[1, 1, 0, 1, 1, 1], [1, 1, 0, 1, 1, 0]], dtype=np.bool_)
    assert np.flatnonzero(pocket_depth(grid_lane_graph(GridMap(free), "pebble"))).tolist() == [5]


def test_who_waits_longer_goes_first_until_the_goal_is_reached() -> None:
    priorities = Priorities(open_grid(3, 3), 3, seed=0)
    goals = np.array([5, 8, -1], dtype=np.int32)
    for states in ([0, 8, 2], [1, 8, 2]):
        priorities.advance(np.array(states, dtype=np.int32), goals)
    assert priorities.order()[0] == 0
    assert (priorities.values[1:] < 1).all()
    priorities.advance(np.array([5, 7, 2], dtype=np.int32), goals)
    assert priorities.order()[0] == 1


def test_who_stands_in_a_dead_end_overtakes_who_waits_outside() -> None:
    graph = grid_lane_graph(GridMap(np.array([[1, 1, 0], [1, 1, 1]], dtype=np.bool_)), "pebble")
    priorities = Priorities(graph, 2, seed=0)
    inside, outside = 4, 3
    for _ in range(5):
        priorities.advance(np.array([outside, 0], dtype=np.int32), np.array([inside, 1], dtype=np.int32))
    for _ in range(2):
        priorities.advance(np.array([outside, inside], dtype=np.int32), np.array([inside, 1], dtype=np.int32))
    assert priorities.order().tolist() == [1, 0]
