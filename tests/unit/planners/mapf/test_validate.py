"""The referee is tested on plans that are broken by hand, one rule at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from maps.lane_graph import LaneGraph
from planners.mapf.pibt import Pibt
from planners.mapf.problem import Plan
from planners.mapf.validate import Conflict, _moving, _standing, breaches, conflicts, suspicious
from planners.status import Status
from tests.unit.planners.mapf.lanes import (
    graph_of,
    instance_of,
    king_grid,
    one_way_grid,
    one_way_loop,
    open_grid,
    random_starts,
)


def plan_of(*rows: Sequence[int]) -> Plan:
    return Plan(states=np.array(rows, dtype=np.int32), status=Status.FEASIBLE, iterations=0)


def judge(
    graph: LaneGraph, *rows: Sequence[int], rotation: bool = False, blocked: Sequence[int] = ()
) -> list[Conflict]:
    closed = np.zeros(graph.n_cells, dtype=np.bool_)
    closed[list(blocked)] = True
    return conflicts(graph, plan_of(*rows), allow_rotation=rotation, blocked=closed)


def test_a_following_chain_is_legal() -> None:
    assert judge(open_grid(1, 4), (0, 1, 2), (1, 2, 3)) == []


def test_two_agents_in_one_cell_are_a_vertex_conflict() -> None:
    assert judge(open_grid(1, 3), (0, 2), (1, 1)) == [Conflict(kind="vertex", timestep=1, agents=(0, 1), where=1)]


def test_entering_the_cell_of_a_waiting_agent_is_a_vertex_conflict() -> None:
    assert judge(open_grid(1, 2), (0, 1), (1, 1)) == [Conflict(kind="vertex", timestep=1, agents=(0, 1), where=1)]


def test_two_states_of_one_cell_are_a_vertex_conflict() -> None:
    graph = graph_of([0, 1, 2, 2], [(0, 2), (1, 3)])
    assert judge(graph, (0, 1), (2, 3)) == [Conflict(kind="vertex", timestep=1, agents=(0, 1), where=2)]


def test_a_swap_is_an_edge_conflict_even_where_rings_are_legal() -> None:
    for rotation in (False, True):
        found = judge(open_grid(1, 2), (0, 1), (1, 0), rotation=rotation)
        assert found == [Conflict(kind="edge", timestep=0, agents=(0, 1), where=0)]


def test_a_ring_is_a_rotation_conflict_unless_allowed() -> None:
    graph = one_way_loop(4)
    rows = (0, 1, 2, 3), (1, 2, 3, 0)
    assert judge(graph, *rows) == [Conflict(kind="rotation", timestep=0, agents=(0, 1, 2, 3), where=0)]
    assert judge(graph, *rows, rotation=True) == []


def test_a_ring_with_a_gap_is_no_rotation() -> None:
    assert judge(one_way_loop(4), (0, 1, 2), (1, 2, 3)) == []


def test_a_step_the_graph_has_no_move_for_is_illegal() -> None:
    assert judge(one_way_loop(4), (1,), (0,)) == [Conflict(kind="illegal_move", timestep=0, agents=(0,), where=0)]


def test_a_move_that_sweeps_the_cell_of_a_waiting_agent_is_a_swept_conflict() -> None:
    graph = graph_of([0, 1, 2], [(0, 2)], sweeps={(0, 2): (1,)})
    assert judge(graph, (0, 1), (2, 1)) == [Conflict(kind="swept", timestep=0, agents=(0, 1), where=1)]


def test_a_move_that_sweeps_a_cell_being_vacated_is_a_swept_conflict() -> None:
    graph = graph_of([0, 1, 2, 3], [(0, 2), (1, 3)], sweeps={(0, 2): (1,)})
    assert judge(graph, (0, 1), (2, 3)) == [Conflict(kind="swept", timestep=0, agents=(0, 1), where=1)]


def test_two_moves_that_sweep_one_cell_are_a_swept_conflict() -> None:
    graph = graph_of([0, 1, 2, 3], [(0, 2), (1, 3)], sweeps={(0, 2): (4,), (1, 3): (4,)}, n_cells=5)
    assert judge(graph, (0, 1), (2, 3)) == [Conflict(kind="swept", timestep=0, agents=(0, 1), where=4)]


def test_a_blocked_cell_may_be_left_but_not_entered() -> None:
    graph = one_way_loop(4)
    assert judge(graph, (0,), (0,), (1,), blocked=(0,)) == []
    assert judge(graph, (3,), (0,), blocked=(0,)) == [Conflict(kind="blocked", timestep=0, agents=(0,), where=0)]


def test_conflicts_of_all_timesteps_are_listed() -> None:
    found = judge(open_grid(1, 3), (0, 1), (1, 0), (1, 0), (0, 1))
    assert [(conflict.kind, conflict.timestep) for conflict in found] == [("edge", 0), ("edge", 2)]


def test_breaches_names_what_the_instance_forbids() -> None:
    graph = open_grid(1, 8)
    instance = instance_of(graph, [0, 2, 4, 6], [0, 2, 4, 6], stay=[False, True, False, False], fixed=[0, 0, 1, 0])
    found = breaches(instance, plan_of((0, 2, 4, 7), (0, 3, 5, 7)))
    assert [(breach.kind, breach.agents) for breach in found] == [("stay", (1,)), ("fixed", (2,)), ("start", (3,))]


def everything_wrong(graph: LaneGraph, states: np.ndarray, rotation: bool, blocked: np.ndarray) -> list[int]:
    """Rows with something wrong, each row judged alone by the explicit rules."""
    sweeps = {}
    for move in range(graph.n_moves):
        ends = int(graph.move_from[move]), int(graph.move_to[move])
        sweeps[ends] = set(graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]].tolist())
    closed = set(np.flatnonzero(blocked).tolist())
    rows = []
    for t in range(len(states)):
        found = _standing(graph, t, states[t].tolist())
        if t + 1 < len(states):
            found += _moving(graph, t, states[t].tolist(), states[t + 1].tolist(), sweeps, closed, rotation)
        if found:
            rows.append(t)
    return rows


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("grid", [open_grid, king_grid, one_way_grid])
def test_the_quick_look_overlooks_nothing(grid: Callable[[int, int], LaneGraph], seed: int) -> None:
    """Random steps, most of them legal one by one: every kind of conflict turns up in some row."""
    rng = np.random.default_rng(seed)
    graph = grid(4, 6)
    n, rows = int(rng.integers(1, 10)), 60
    states = np.empty((rows, n), dtype=np.int32)
    states[0] = random_starts(graph, n, rng)
    for t in range(1, rows):
        for agent in range(n):
            state = int(states[t - 1, agent])
            choices = [state, *graph.move_to[graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]]].tolist()]
            states[t, agent] = rng.choice(choices) if rng.random() < 0.99 else rng.integers(graph.n_states)
        if rng.random() < 0.7 and len(set(graph.state_cell[states[t]].tolist())) < n:
            states[t] = states[t - 1]
    blocked = rng.random(graph.n_cells) < 0.05
    rotation = bool(seed % 2)
    expected = everything_wrong(graph, states, rotation, blocked)
    looked_at = suspicious(graph, states, allow_rotation=rotation, blocked=blocked).tolist()
    assert set(expected) <= set(looked_at)
    assert len(looked_at) <= len(expected) + 2
    judged = conflicts(graph, plan_of(*states.tolist()), allow_rotation=rotation, blocked=blocked)
    assert sorted({conflict.timestep for conflict in judged}) == expected


@pytest.mark.parametrize("rotation", [False, True])
def test_a_thousand_agents_for_a_thousand_timesteps_take_seconds(rotation: bool) -> None:
    graph = one_way_grid(60, 60)
    rng = np.random.default_rng(0)
    instance = replace(
        instance_of(graph, random_starts(graph, 1000, rng), allow_rotation=rotation, horizon=1000),
        goals=rng.integers(graph.n_states, size=1000).astype(np.int32),
    )
    plan = Pibt().plan(instance)
    begin = time.process_time()
    assert breaches(instance, plan) == []
    assert time.process_time() - begin < 5.0
