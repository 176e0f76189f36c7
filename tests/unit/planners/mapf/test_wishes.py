"""A timestep of PIBT in which agents have wishes of their own."""

from __future__ import annotations

import numpy as np
import pytest

from maps.grid import GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.mapf.distance_table import DistanceTable
from planners.mapf.pibt import Stepper
from planners.mapf.problem import Plan
from planners.precedence.dependency_graph import DependencyGraph
from planners.status import Status

FLOOR = grid_lane_graph(GridMap(np.ones((3, 4), dtype=np.bool_)), "pebble")
"""Cells 0 1 2 3 / 4 5 6 7 / 8 9 10 11; a state is its cell."""
ROW = grid_lane_graph(GridMap(np.ones((1, 4), dtype=np.bool_)), "pebble")
NONE = -1


def stepped(
    graph: LaneGraph,
    now: list[int],
    goals: list[int],
    wished: list[int] | None,
    *,
    locked: tuple[int, ...] = (),
    seed: int = 0,
) -> list[int]:
    """Return where everybody goes; who comes first decides first."""
    nothing = np.zeros(graph.n_cells, dtype=np.bool_)
    distances, row = DistanceTable(graph, nothing).rows(np.array(goals, dtype=np.int32))
    n = len(now)
    after = np.empty(n, dtype=np.int32)
    Stepper(graph, nothing, seed=seed).step(
        np.array(now, dtype=np.int32),
        after,
        distances=distances,
        row=row,
        order=np.arange(n, dtype=np.int32),
        locked=np.isin(np.arange(n), locked),
        allow_rotation=False,
        wished=None if wished is None else np.array(wished, dtype=np.int32),
    )
    return after.tolist()


def test_a_free_cell_that_is_wished_for_is_entered_whatever_the_goal() -> None:
    assert stepped(FLOOR, [5], [7], None) == [6]
    assert stepped(FLOOR, [5], [7], [NONE]) == [6]
    for wish in (1, 4, 5, 9):
        assert stepped(FLOOR, [5], [7], [wish]) == [wish]


def test_who_has_no_goal_or_is_there_may_have_a_wish_too() -> None:
    assert stepped(FLOOR, [5, 10], [NONE, 10], [1, 11]) == [1, 11]


def test_one_who_stands_in_the_way_is_pushed_and_goes_where_it_wishes() -> None:
    assert stepped(ROW, [0, 1], [3, 1], [1, 1]) == [1, 2], "it wished to stay"
    assert stepped(FLOOR, [4, 5], [7, NONE], [5, 9]) == [5, 9]
    assert stepped(FLOOR, [4, 5], [7, NONE], [5, 1]) == [5, 1]


def test_one_who_has_decided_to_wait_is_not_pushed() -> None:
    assert stepped(ROW, [1, 0], [1, 3], [1, 1]) == [1, 0]


def test_a_wish_that_cannot_be_granted_gives_way_to_the_next_best() -> None:
    assert stepped(ROW, [1, 2], [3, 2], [2, 2], locked=(1,)) == [1, 2]
    assert stepped(FLOOR, [5, 6], [7, 6], [6, 6], locked=(1,))[0] in (1, 5, 9)
    assert stepped(ROW, [0, 1], [3, 0], [1, 0]) == [1, 2], "nobody swaps"


def test_a_wish_for_a_state_that_no_move_leads_to_is_none() -> None:
    assert stepped(FLOOR, [5], [7], [11]) == [6]


def random_floor(seed: int) -> tuple[LaneGraph, np.random.Generator, list[int], list[int]]:
    """Return a crowded floor: graph, source of chance, states and goals."""
    graph = grid_lane_graph(GridMap(np.ones((5, 6), dtype=np.bool_)), "pebble")
    rng = np.random.default_rng(seed)
    return graph, rng, rng.permutation(30)[:22].tolist(), rng.permutation(30)[:22].tolist()


def test_everybody_s_wish_counts() -> None:
    graph = grid_lane_graph(GridMap(np.ones((5, 6), dtype=np.bool_)), "pebble")
    now = [6 * row + col for row in range(5) for col in (0, 2, 4)]
    aside = [state + 1 for state in now]
    for goals in (now, [29 - state for state in now], [NONE] * 15):
        assert stepped(graph, now, goals, aside) == aside


@pytest.mark.parametrize("seed", range(5))
def test_who_wishes_for_what_pibt_does_is_granted_it(seed: int) -> None:
    graph, _, now, goals = random_floor(seed)
    planned = stepped(graph, now, goals, None, seed=seed)
    assert stepped(graph, now, goals, planned, seed=seed) == planned
    assert stepped(graph, now, goals, [NONE] * len(now), seed=seed) == planned


@pytest.mark.parametrize("seed", range(5))
def test_whatever_is_wished_for_can_be_executed(seed: int) -> None:
    graph, rng, now, goals = random_floor(seed)
    n_granted = 0
    for step in range(60):
        wished = list(now)
        for agent, here in enumerate(now):
            ways = graph.move_to[graph.out_move[graph.out_ptr[here] : graph.out_ptr[here + 1]]]
            wished[agent] = int(rng.choice([here, *ways]))
        after = stepped(graph, now, goals, wished, locked=(0, 1), seed=step)
        assert after[:2] == now[:2]
        # The dependency graph refuses every conflict, swap and ring.
        DependencyGraph(graph, np.array(now, dtype=np.int32)).extend(
            Plan(states=np.array([now, after], dtype=np.int32), status=Status.FEASIBLE, iterations=1)
        )
        n_granted += sum(to == wish != here for to, wish, here in zip(after, wished, now, strict=True))
        now = after
    assert n_granted > 100
