"""The referee is tested on plans that are broken by hand, one rule at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maps.lane_graph import LaneGraph
from planners.mapf.problem import Plan
from planners.mapf.validate import Conflict, breaches, conflicts
from planners.status import Status
from tests.unit.planners.mapf.lanes import graph_of, instance_of, one_way_loop, open_grid


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
