"""Prioritised planning: legal by the referee, and each agent as early as exhaustion says it can be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from maps.grid import GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.distance_table import DistanceTable
from planners.mapf.problem import Instance, Plan
from planners.mapf.sipp import safe_intervals
from planners.mapf.sipp.safe_intervals import Reservations
from planners.mapf.sipp.sipp import Sipp, SippConfig
from planners.mapf.validate import breaches
from planners.status import Status
from tests.unit.planners.mapf.brute_force import earliest_finish
from tests.unit.planners.mapf.lanes import (
    graph_of,
    instance_of,
    king_grid,
    one_way_grid,
    one_way_loop,
    open_grid,
    random_starts,
)


def turning_grid(rows: int, cols: int) -> LaneGraph:
    return grid_lane_graph(GridMap(np.ones((rows, cols), dtype=np.bool_)), "rotating")


GRIDS: dict[str, Callable[[int, int], LaneGraph]] = {
    "pebble": open_grid,
    "rotating": turning_grid,
    "carlike": one_way_grid,
    "diagonal": king_grid,
}


def crowd(seed: int, n: int, grid: str, *, aimless: float = 0.1) -> Instance:
    """Distinct goal cells, a share of them left out, some agents that stay, one closed cell."""
    rng = np.random.default_rng(seed)
    graph = GRIDS[grid](4, 6)
    starts = random_starts(graph, n, rng)
    goals = [goal if rng.random() >= aimless else -1 for goal in random_starts(graph, n, rng)]
    used = set(graph.state_cell[[*starts, *(goal for goal in goals if goal >= 0)]].tolist())
    unused = [cell for cell in range(graph.n_cells) if cell not in used]
    return instance_of(
        graph,
        starts,
        goals,
        priorities=rng.random(n).tolist(),
        stay=(rng.random(n) < 0.5).tolist(),
        blocked=unused[:1] if grid != "carlike" else (),
        allow_rotation=bool(seed % 2),
        horizon=200,
    )


def arrived(plan: Plan) -> np.ndarray:
    """Timestep from which each agent stands still."""
    away = plan.states != plan.states[-1]
    return np.where(away.any(axis=0), len(away) - np.argmax(away[::-1], axis=0), 0)


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("seed", range(20))
def test_a_crowd_gets_there_legally(grid: str, seed: int) -> None:
    instance = crowd(seed, 8, grid)
    plan = Sipp(seed=seed).plan(instance)
    assert breaches(instance, plan) == []
    if plan.status is Status.FEASIBLE:
        assert ((plan.states[-1] == instance.goals) | (instance.goals < 0)).all()
    else:
        assert plan.states.tolist() == [instance.starts.tolist()]


@pytest.mark.parametrize("grid", GRIDS)
def test_most_crowds_are_solved(grid: str) -> None:
    ends = [Sipp().plan(crowd(seed, 5, grid)).status for seed in range(40)]
    assert ends.count(Status.FEASIBLE) >= 36


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("seed", range(30))
def test_the_last_agent_is_as_early_as_exhaustion_says(grid: str, seed: int) -> None:
    instance = replace(crowd(seed, 7, grid, aimless=0.0), priorities=-np.arange(7.0))
    plan = Sipp(SippConfig(orders=1)).plan(instance)
    if plan.status is Status.FEASIBLE:
        assert arrived(plan)[6] == earliest_finish(instance, 6, plan.states.tolist())


@pytest.mark.parametrize("grid", ["pebble", "rotating", "carlike"])
def test_an_agent_that_finds_no_way_has_none(grid: str) -> None:
    """In a full corner of the floor; the first six do not know of the seventh."""
    failures = 0
    for seed in range(60):
        instance = replace(crowd(seed, 7, grid, aimless=0.0), priorities=-np.arange(7.0))
        first_six = replace(
            instance,
            **{name: getattr(instance, name)[:6] for name in ("starts", "goals", "priorities", "stay", "fixed")},
        )
        rest = Sipp(SippConfig(orders=1)).plan(first_six)
        plan = Sipp(SippConfig(orders=1)).plan(instance)
        if rest.status is Status.FEASIBLE and plan.status is Status.TIMEOUT:
            failures += 1
            assert earliest_finish(instance, 6, [(*row, 0) for row in rest.states.tolist()]) is None
    assert failures > 0


def test_an_agent_passes_its_goal_and_comes_back_unless_it_stays() -> None:
    """A corridor with a bay beyond the goal: the only way to let the other one by."""
    graph = graph_of(range(6), [*((k, k + 1) for k in range(4)), *((k + 1, k) for k in range(4)), (2, 5), (5, 2)])
    for stay in (False, True):
        instance = instance_of(graph, [1, 4], [2, 0], priorities=[0, 1], stay=[stay, False], horizon=40)
        plan = Sipp(SippConfig(orders=1)).plan(instance)
        assert plan.status is (Status.TIMEOUT if stay else Status.FEASIBLE)
        assert breaches(instance, plan) == []


def test_who_found_no_way_goes_first() -> None:
    """A one-way lane, with a bay beside its second cell: whoever goes last must not be behind."""
    graph = graph_of(range(5), [(0, 1), (1, 2), (2, 3), (1, 4), (4, 1)])
    instance = instance_of(graph, [1, 0], [2, 3], priorities=[1.0, 0.0], horizon=40)
    assert Sipp(SippConfig(orders=1)).plan(instance).status is Status.TIMEOUT
    plan = Sipp(SippConfig(orders=2)).plan(instance)
    assert (plan.status, breaches(instance, plan)) == (Status.FEASIBLE, [])
    assert plan.states[:, 0].tolist() == [1, 4, 1, 2]


@pytest.mark.parametrize(
    ("starts", "goals", "fixed"),
    [
        ([0, 1], [3, 2], [True, False]),
        ([0, 1], [-1, 0], [True, False]),
        ([0, 1], [3, 3], [False, False]),
        ([0, 1], [7, 3], [False, False]),
    ],
    ids=["fixed elsewhere", "fixed in a goal", "one goal for two", "no way"],
)
def test_what_is_proved_hopeless(starts: list[int], goals: list[int], fixed: list[bool]) -> None:
    graph = graph_of(range(8), [*((k, (k + 1) % 7) for k in range(7)), (7, 0)])
    plan = Sipp().plan(instance_of(graph, starts, goals, fixed=fixed))
    assert plan.status is Status.INFEASIBLE
    assert plan.states.tolist() == [starts]


def test_a_ring_turns_only_where_rings_are_legal() -> None:
    for rotation in (False, True):
        instance = instance_of(one_way_loop(4), [0, 1, 2, 3], [1, 2, 3, 0], allow_rotation=rotation)
        plan = Sipp().plan(instance)
        assert breaches(instance, plan) == []
        assert plan.status is (Status.FEASIBLE if rotation else Status.TIMEOUT)


def test_neighbours_do_not_swap_even_where_rings_are_legal() -> None:
    instance = instance_of(open_grid(1, 2), [0, 1], [1, 0], allow_rotation=True)
    assert Sipp().plan(instance).status is Status.TIMEOUT


def test_the_horizon_cuts_the_plan_and_not_the_search() -> None:
    instance = instance_of(open_grid(1, 8), [0], [7], horizon=3)
    plan = Sipp().plan(instance)
    assert (plan.status, plan.states.ravel().tolist()) == (Status.FEASIBLE, [0, 1, 2, 3])


def test_the_budget_counts_searches() -> None:
    instance = crowd(0, 5, "pebble")
    for budget in range(6):
        plan = Sipp().plan(instance, None, Deadline(budget))
        assert plan.status is (Status.TIMEOUT if budget < 5 else Status.FEASIBLE)
        assert plan.iterations == budget


def test_many_paths_grow_the_book() -> None:
    """Back and forth, path after path, until the first room for entries is long used up."""
    graph = open_grid(3, 3)
    reservations = Reservations(graph, np.ones(graph.n_moves, dtype=np.bool_), np.array([8]), allow_rotation=False)
    move = {(int(a), int(b)): k for k, (a, b) in enumerate(zip(graph.move_from, graph.move_to, strict=True))}
    there_and_back = np.array([0, 1] * 30 + [0], dtype=np.int32)
    reservations.add(there_and_back, np.array([move[0, 1], move[1, 0]] * 30, dtype=np.int32))
    found = reservations.earliest_path(8, 1, DistanceTable(graph, np.zeros(9, dtype=np.bool_)).to(1), stay=False)
    assert found is not None
    assert found[0].tolist()[-1] == 1
    assert len(found[1]) == 60  # in as the other one leaves for the last time


def test_two_sweep_over_a_cell_one_right_after_the_other() -> None:
    graph = graph_of(range(5), [(0, 1), (2, 3)], sweeps={(0, 1): (4,), (2, 3): (4,)})
    reservations = Reservations(graph, np.ones(2, dtype=np.bool_), np.array([0, 2]), allow_rotation=False)
    reservations.add(np.array([0, 1], dtype=np.int32), np.array([0], dtype=np.int32))
    found = reservations.earliest_path(2, 3, DistanceTable(graph, np.zeros(5, dtype=np.bool_)).to(3), stay=False)
    assert found is not None
    assert found[0].tolist() == [2, 2, 3]


def test_a_search_that_runs_out_of_memory_gets_more(monkeypatch: pytest.MonkeyPatch) -> None:
    instance = crowd(1, 8, "rotating")
    expected = Sipp().plan(instance)
    monkeypatch.setattr(safe_intervals, "FIRST_ROOM", 2)
    np.testing.assert_array_equal(Sipp().plan(instance).states, expected.states)


@pytest.mark.parametrize(("graph", "arrival"), [(open_grid(1, 3), 2), (turning_grid(1, 3), 4)], ids=["step", "turn"])
def test_who_is_not_planned_yet_has_time_to_turn_and_leave(graph: LaneGraph, arrival: int) -> None:
    """Two turns and the way is free; the one behind follows in the third timestep."""
    start, other, goal = (int(graph.state_index[cell, 0]) for cell in range(3))
    starts = np.array([start, other])
    reservations = Reservations(graph, np.ones(graph.n_moves, dtype=np.bool_), starts, allow_rotation=False)
    distance = DistanceTable(graph, np.zeros(3, dtype=np.bool_)).to(goal)
    found = reservations.earliest_path(start, goal, distance, stay=False)
    assert found is not None
    assert len(found[1]) == arrival


@pytest.mark.parametrize("orders", [0, -1])
def test_no_orders_at_all_are_refused(orders: int) -> None:
    with pytest.raises(PlanningError, match=f"orders = {orders}; valid: an integer >= 1"):
        SippConfig(orders=orders)
