"""Moves that agents wish for become moves that can be made together."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.envs.traffic.right_of_way import RightOfWay
from maps.grid import GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.mapf.problem import Plan
from planners.precedence.dependency_graph import DependencyGraph
from planners.status import Status

FLOOR = grid_lane_graph(GridMap(np.ones((3, 4), dtype=np.bool_)), "pebble")
"""Cells 0 1 2 3 / 4 5 6 7 / 8 9 10 11; a state is its cell."""


def resolved(
    state: list[int], wanted: list[int], priority: list[float] | None = None, locked: tuple[int, ...] = ()
) -> list[int]:
    """Return where everybody goes."""
    n = len(state)
    rank = np.zeros(n) if priority is None else np.array(priority, dtype=np.float64)
    return (
        RightOfWay(FLOOR.state_cell, FLOOR.n_cells)
        .resolve(np.array(state, dtype=np.int32), np.array(wanted), rank, np.isin(np.arange(n), locked))
        .tolist()
    )


def test_the_higher_priority_enters_and_of_equal_ones_the_lower_index() -> None:
    assert resolved([0, 2, 5], [1, 1, 1]) == [1, 2, 5]
    assert resolved([0, 2, 5], [1, 1, 1], [1.0, 3.0, 2.0]) == [0, 1, 5]


def test_a_follower_goes_only_if_the_one_ahead_goes() -> None:
    assert resolved([0, 1, 2], [1, 2, 3]) == [1, 2, 3]
    assert resolved([0, 1, 2], [1, 2, 2]) == [0, 1, 2]
    assert resolved([0, 1, 2], [1, 2, 3], locked=(2,)) == [0, 1, 2]


def test_who_loses_a_cell_holds_up_those_behind_him() -> None:
    # 5 and 1 want cell 2 by way of 6 and directly; 0 follows the loser.
    assert resolved([0, 1, 6], [1, 2, 2], [9.0, 1.0, 2.0]) == [0, 1, 2]


def test_nobody_swaps_and_rings_stay() -> None:
    assert resolved([0, 1], [1, 0]) == [0, 1]
    ring = [0, 1, 5, 4]
    assert resolved(ring, [1, 5, 4, 0]) == ring
    assert resolved([*ring, 8], [1, 5, 4, 0, 4], [0, 0, 0, 0, 5.0])[4] == 8, "he waits for a ring that waits"


def test_the_one_who_wins_a_cell_opens_a_ring() -> None:
    # Car 4 takes cell 5 away from car 1 in the ring only if car 2, in cell 5, goes on, which it cannot.
    assert resolved([0, 1, 5, 4, 6], [1, 5, 4, 0, 5], [0, 0, 0, 0, 5.0]) == [0, 1, 5, 4, 6]
    assert resolved([0, 1, 5, 4], [1, 5, 9, 0]) == [1, 5, 9, 0]


@pytest.mark.parametrize("seed", range(5))
def test_whatever_is_wished_for_can_be_executed(seed: int) -> None:
    graph: LaneGraph = grid_lane_graph(GridMap(np.ones((5, 6), dtype=np.bool_)), "pebble")
    rng = np.random.default_rng(seed)
    state = rng.permutation(graph.n_states)[:22].astype(np.int32)
    right_of_way = RightOfWay(graph.state_cell, graph.n_cells)
    n_moved = 0
    for _ in range(60):
        wanted = state.copy()
        for car, here in enumerate(state):
            ways = graph.move_to[graph.out_move[graph.out_ptr[here] : graph.out_ptr[here + 1]]]
            wanted[car] = rng.choice([here, *ways])
        after = right_of_way.resolve(state, wanted, rng.integers(3, size=len(state)).astype(np.float64), state < 2)
        assert ((after == state) | (after == wanted)).all()
        # The dependency graph refuses every conflict, swap and ring.
        DependencyGraph(graph, state).extend(
            Plan(states=np.stack((state, after)), status=Status.FEASIBLE, iterations=1)
        )
        n_moved += int((after != state).sum())
        state = after
    assert n_moved > 100
