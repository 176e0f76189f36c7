"""Window search: its plan is legal, kept, improved without loss to others, and comes loose where thrift alone jams."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from maps.grid import GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.distance_table import DistanceTable
from planners.mapf.multi_step.multi_step_kernel import Wishes
from planners.mapf.multi_step.priorities import Priorities
from planners.mapf.pibt import Pibt
from planners.mapf.planner import MapfPlanner
from planners.mapf.problem import NO_GOAL, Instance, Plan
from planners.mapf.validate import breaches, conflicts
from planners.mapf.window_search.rolling_plan import RollingPlan
from planners.mapf.window_search.steady_plan import SteadyPlan
from planners.mapf.window_search.window_search import WindowSearch, WindowSearchConfig
from planners.status import Status
from tests.unit.planners.mapf.lanes import (
    graph_of,
    instance_of,
    king_grid,
    one_way_grid,
    open_grid,
    random_starts,
    reached,
    rotating_grid,
)
from tests.unit.planners.mapf.test_never_frozen import cluttered

GRAPHS = {"pebble": open_grid, "rotating": rotating_grid, "one_way": one_way_grid, "wide": king_grid}


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"window": 0}, "window = 0; valid: 1 to 100"),
        ({"window": 101}, "window = 101; valid: 1 to 100"),
        ({"nodes": 0}, "nodes = 0; valid: an integer >= 1"),
        ({"impatience": -1.0}, "impatience = -1.0; valid: a number >= 0"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(PlanningError, match=said):
        WindowSearchConfig(**settings)


@pytest.mark.parametrize("allow_rotation", [False, True])
@pytest.mark.parametrize("name", GRAPHS)
def test_crowds_move_legally_from_window_to_window(name: str, allow_rotation: bool) -> None:
    for seed, share in enumerate((0.2, 0.5, 0.8)):
        rng = np.random.default_rng(seed)
        graph = GRAPHS[name](4, 6)
        n = int(share * graph.n_cells)
        planner = WindowSearch(WindowSearchConfig(nodes=500), seed=seed)
        states = random_starts(graph, n, rng)
        for _ in range(12):
            instance = instance_of(
                graph,
                states,
                np.where(rng.random(n) < 0.1, NO_GOAL, rng.integers(graph.n_states, size=n)).tolist(),
                priorities=rng.random(n).tolist(),
                stay=(rng.random(n) < 0.3).tolist(),
                fixed=(rng.random(n) < 0.1).tolist(),
                blocked=np.flatnonzero(rng.random(graph.n_cells) < 0.05).tolist() if seed else (),
                allow_rotation=allow_rotation,
                horizon=4,
            )
            plan = planner.plan(instance)
            assert breaches(instance, plan) == []
            states = plan.states[-1].tolist()


def test_the_plan_goes_on_from_call_to_call() -> None:
    rng = np.random.default_rng(4)
    graph = open_grid(12, 12)
    starts, goals = random_starts(graph, 30, rng), random_starts(graph, 30, rng)
    whole = WindowSearch(seed=1).plan(instance_of(graph, starts, goals, horizon=4))
    planner = WindowSearch(seed=1)
    states = starts
    for row in range(1, 5):
        part = planner.plan(instance_of(graph, states, goals, horizon=1))
        states = part.states[1].tolist()
        assert states == whole.states[row].tolist()


def test_the_same_seed_repeats_the_plan_and_a_deadline_cuts_it() -> None:
    rng = np.random.default_rng(5)
    graph = open_grid(6, 6)
    instance = instance_of(graph, random_starts(graph, 20, rng), random_starts(graph, 20, rng), horizon=10)
    plans = [WindowSearch(seed=seed).plan(instance).states.tolist() for seed in (0, 0, 1)]
    assert plans[0] == plans[1] != plans[2]
    cut = WindowSearch(seed=0).plan(instance, deadline=Deadline(3))
    assert (cut.status, len(cut.states), cut.states.tolist()) == (Status.TIMEOUT, 4, plans[0][:4])


def bay_corridor(length: int, bays: list[int]) -> LaneGraph:
    """Cells 0 .. length - 1 in a row, and one more beside some of them."""
    ends = [(k, k + 1) for k in range(length - 1)] + [(cell, length + k) for k, cell in enumerate(bays)]
    return graph_of(range(length + len(bays)), ends + [(b, a) for a, b in ends])


def test_two_who_meet_pass_at_the_bay_with_the_least_waiting_though_it_is_far_ahead() -> None:
    graph = bay_corridor(9, [4])
    plan = WindowSearch(seed=0).plan(instance_of(graph, [0, 8], [8, 0], horizon=20))
    arrivals = [int(np.flatnonzero(plan.states[:, agent] == goal)[0]) for agent, goal in ((0, 8), (1, 0))]
    assert sum(arrivals) == 8 + 8 + 3  # into the bay, a wait there and out, or a part of that for the other


def test_a_queue_goes_back_to_the_bays_behind_it_to_let_a_longer_one_pass() -> None:
    graph = bay_corridor(18, [4, 5])
    instance = instance_of(graph, [8, 9, 12, 13, 14], [16, 17, 0, 1, 2], priorities=[0, 0, 9, 8, 7], horizon=80)
    plan = WindowSearch(seed=0).plan(instance)
    assert breaches(instance, plan) == []
    assert reached(instance, plan).all()


def test_who_is_held_stays_and_the_others_go_round() -> None:
    graph = open_grid(3, 7)
    instance = instance_of(graph, [7, 10], [13, NO_GOAL], fixed=[False, True], horizon=10)
    plan = WindowSearch(seed=0).plan(instance)
    assert breaches(instance, plan) == []
    assert reached(instance, plan).all()
    assert (plan.states[:, 1] == 10).all()


def lifelong(planner: MapfPlanner, graph: LaneGraph, n: int, steps: int, seed: int) -> list[int]:
    """Goals reached in each timestep when each agent gets a new one at once."""
    rng = np.random.default_rng(seed)
    tables = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_))
    states = random_starts(graph, n, rng)
    goals = rng.integers(graph.n_states, size=n)
    priorities = Priorities(graph, n, seed=seed)
    done = []
    for _ in range(steps):
        instance = instance_of(
            graph, states, goals.tolist(), priorities=priorities.values.tolist(), allow_rotation=True, horizon=1
        )
        row = planner.plan(instance, tables).states[1]
        there = row == goals
        states = row.tolist()
        done.append(int(there.sum()))
        priorities.advance(row, goals.astype(np.int32))
        goals[there] = rng.integers(graph.n_states, size=int(there.sum()))
    return done


def test_on_a_floor_with_some_room_more_is_done_than_by_pibt() -> None:
    rng = np.random.default_rng(0)
    free = np.ones((14, 14), dtype=np.bool_)
    free[2::4, 1:-1] = False
    free[:, 6] |= rng.random(14) < 0.5
    graph = grid_lane_graph(GridMap(free), "pebble")
    ours, pibt = (
        sum(sum(lifelong(make(seed=3), graph, 30, 200, s)) for s in range(2)) for make in (WindowSearch, Pibt)
    )
    assert ours > 1.1 * pibt


def test_a_crowd_that_jams_is_driven_on_by_multi_step_pibt() -> None:
    graph = cluttered(1, side=12)
    done = lifelong(WindowSearch(seed=0), graph, int(0.65 * graph.n_states), 600, 0)
    quarters = [sum(done[k : k + 150]) for k in range(0, 600, 150)]
    assert min(quarters) > 0.6 * max(quarters)


def test_multi_step_pibt_drives_for_two_windows_and_for_twice_as_long_if_the_fleet_jams_again() -> None:
    graph, window = bay_corridor(4, []), 4  # two who meet here never pass
    plan = SteadyPlan(graph, np.zeros(graph.n_cells, dtype=np.bool_), 2, window=window, seed=0)
    distances, row = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_)).rows(np.array([3, 0]))
    nowhere = np.full(2, -1, dtype=np.int32)
    wishes = Wishes(row=row, cell=nowhere, next_row=nowhere, onward=np.zeros(2, dtype=np.int32))
    states, pushing = np.array([1, 2], dtype=np.int32), []
    for _ in range(80):
        plan.begin(states)
        states = plan.step(distances, wishes, np.arange(2, dtype=np.int32), nodes=500, allow_rotation=False)
        pushing.append("p" if plan.is_pushing else " ")
    assert [len(spell) for spell in "".join(pushing).split()][:3] == [2 * window, 4 * window, 8 * window]


def test_search_takes_over_where_the_agents_have_been_pushed_to_in_the_middle_of_a_window() -> None:
    graph = bay_corridor(9, [])  # two who meet here never pass
    planner = WindowSearch(WindowSearchConfig(window=4, nodes=500), seed=0)
    instance = instance_of(graph, [4, 5], [8, 0], priorities=[1.0, 0.0], horizon=60)
    assert breaches(instance, planner.plan(instance)) == []


def rolled(
    graph: LaneGraph, starts: list[int], goals: npt.NDArray[np.int32], *, move_cost: npt.NDArray[np.int32], steps: int
) -> Plan:
    """States along a row of goals for each agent, shape (n, goals), of which the last is never left behind."""
    tables = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_), move_costs=move_cost)
    n = len(starts)
    plan = RollingPlan(graph, np.zeros(graph.n_cells, dtype=np.bool_), n, window=8, move_cost=move_cost, seed=0)
    states = [np.array(starts, dtype=np.int32)]
    plan.begin(states[0])
    at = np.zeros(n, dtype=np.int64)
    for _ in range(steps):
        here, after = (goals[np.arange(n), np.minimum(at + k, goals.shape[1] - 1)] for k in (0, 1))
        distances, row = tables.rows(np.concatenate((here, after)))
        wishes = Wishes(
            row=row[:n].copy(),
            cell=here.astype(np.int32),
            next_row=row[n:].copy(),
            onward=distances[row[n:], here].astype(np.int32),
        )
        states.append(plan.step(distances, wishes, np.arange(n, dtype=np.int32), nodes=2000, allow_rotation=True))
        at += states[-1] == here
    return Plan(states=np.array(states), status=Status.FEASIBLE, iterations=steps)


def test_a_goal_is_passed_on_the_way_to_the_next_without_a_stop() -> None:
    graph = open_grid(3, 10)
    plan = rolled(graph, [10], np.array([[14, 17, 19]]), move_cost=np.ones(graph.n_moves, dtype=np.int32), steps=9)
    assert plan.states[:, 0].tolist() == list(range(10, 20))


def test_dear_moves_are_gone_round() -> None:
    graph = open_grid(3, 7)
    cost = np.where((graph.move_to == 10) | (graph.move_from == 10), 9, 1).astype(np.int32)
    plan = rolled(graph, [7], np.array([[13, 7]]), move_cost=cost, steps=8)
    assert plan.states[8, 0] == 13
    assert 10 not in plan.states[:, 0]
    assert conflicts(graph, plan, allow_rotation=True) == []


def test_an_instance_without_agents_is_planned() -> None:
    instance: Instance = instance_of(open_grid(2, 2), [], horizon=3)
    assert WindowSearch().plan(instance).states.shape == (4, 0)
