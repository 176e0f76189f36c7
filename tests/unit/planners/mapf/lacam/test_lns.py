"""The large-neighbourhood search: never worse, always legal, and right where the best is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from maps.lane_graph import LaneGraph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.distance_table import DistanceTable
from planners.mapf.lacam.lacam import Lacam, LacamConfig
from planners.mapf.lacam.lns import LargeNeighbourhoodSearch, improve
from planners.mapf.lacam.successors import guide_of
from planners.mapf.metrics import lower_bound, sum_of_loss
from planners.mapf.problem import NO_GOAL, Instance, Plan
from planners.mapf.roads import closed_cells, roads_of
from planners.mapf.validate import breaches
from planners.status import Status
from tests.unit.planners.mapf.lanes import (
    instance_of,
    king_grid,
    one_way_grid,
    open_grid,
    random_starts,
    rotating_grid,
)

GRAPHS = {"one_way": one_way_grid, "two_way": open_grid, "diagonal": king_grid, "rotating": rotating_grid}


def first_plan(instance: Instance) -> Plan:
    return Lacam(LacamConfig(refine=False)).plan(instance, None, Deadline(1000))


def crowd(make: Callable[[int, int], LaneGraph], seed: int, *, rotation: bool) -> Instance:
    """Random starts and goals; one agent has no goal, one stays once it is at its goal."""
    rng = np.random.default_rng(seed)
    graph = make(6, 8)
    n = 6 if make is rotating_grid else 16
    starts, goals = random_starts(graph, n, rng), random_starts(graph, n, rng)
    goals[3] = NO_GOAL
    return instance_of(
        graph,
        starts,
        goals,
        stay=[agent == 4 for agent in range(n)],
        allow_rotation=rotation,
        horizon=500,
    )


@pytest.mark.parametrize("graph", GRAPHS)
@pytest.mark.parametrize("rotation", [False, True])
def test_a_plan_stays_legal_and_gets_cheaper(graph: str, rotation: bool) -> None:
    n_improved = saved = 0
    for seed in range(4):
        instance = crowd(GRAPHS[graph], seed, rotation=rotation)
        plan = first_plan(instance)
        if plan.status is not Status.FEASIBLE:
            continue
        n_improved += 1
        costs = [sum_of_loss(instance, plan)]
        for steps in (1, 30, 300):
            better = improve(instance, plan, deadline=Deadline(steps))
            assert breaches(instance, better) == []
            arrived = (better.states[-1] == instance.goals) | (instance.goals == NO_GOAL)
            assert arrived.all()
            costs.append(sum_of_loss(instance, better))
        assert max(costs) == costs[0]
        saved += costs[0] - costs[-1]
    assert n_improved >= 2
    assert saved > 0


def test_an_aimless_plan_becomes_the_best_one() -> None:
    """A platoon that stands about first."""
    instance = instance_of(open_grid(1, 8), [0, 1, 2, 3], [4, 5, 6, 7], horizon=50)
    rows = [[0, 1, 2, 3]] * 5 + [[k, k + 1, k + 2, k + 3] for k in range(5)]
    plan = Plan(states=np.array(rows, dtype=np.int32), status=Status.FEASIBLE, iterations=0)
    better = improve(instance, plan, deadline=Deadline(100))
    assert better.status is Status.OPTIMAL
    assert sum_of_loss(instance, better) == 16
    assert len(better.states) == 5


def test_an_agent_at_its_goal_makes_room_for_a_moment_instead_of_coming_late() -> None:
    """A T-junction: the one at home has to let the other pass, which costs it two timesteps, not all of them."""
    graph = open_grid(3, 3)
    instance = instance_of(graph, [7, 4], [1, 4], blocked=[0, 6, 2, 8, 3], horizon=50)
    plan = first_plan(instance)
    better = improve(instance, plan, deadline=Deadline(200))
    assert sum_of_loss(instance, better) == 4


def test_no_steps_change_nothing() -> None:
    instance = crowd(open_grid, 0, rotation=False)
    plan = first_plan(instance)
    same = improve(instance, plan, deadline=Deadline(0))
    assert (same.states == plan.states).all()
    assert same.iterations == 0


def test_agents_that_are_not_at_their_goals_are_left_alone() -> None:
    instance = instance_of(open_grid(2, 4), [0, 7], [3, 4], horizon=50)
    rows = [[0, 7], [0, 6], [1, 6], [1, 5], [1, 4]]
    plan = Plan(states=np.array(rows, dtype=np.int32), status=Status.TIMEOUT, iterations=0)
    better = improve(instance, plan, deadline=Deadline(50))
    assert better.states[:, 0].tolist()[:2] == [0, 0]
    assert better.status is Status.TIMEOUT
    assert breaches(instance, better) == []


def test_the_same_generator_gives_the_same_plan() -> None:
    instance = crowd(open_grid, 1, rotation=True)
    plan = first_plan(instance)
    a, b = (improve(instance, plan, deadline=Deadline(100), rng=np.random.default_rng(5)).states for _ in range(2))
    np.testing.assert_array_equal(a, b)


def test_starting_over_is_good_where_there_is_room_and_leaves_no_trace_where_there_is_not() -> None:
    for n in (8, 40):
        rng = np.random.default_rng(n)
        graph = open_grid(7, 8)
        instance = instance_of(graph, random_starts(graph, n, rng), random_starts(graph, n, rng), horizon=900)
        tables = DistanceTable(graph, instance.blocked)
        plan = first_plan(instance)
        search = LargeNeighbourhoodSearch(
            roads_of(graph, closed_cells(instance)), guide_of(instance, tables), plan.states, np.random.default_rng(0)
        )
        search.start_over(lambda: True)
        again = Plan(states=search.states(), status=plan.status, iterations=0)
        assert breaches(instance, again) == []
        assert search.cost == sum_of_loss(instance, again) <= sum_of_loss(instance, plan)
        if n == 8:
            assert search.cost <= 1.1 * lower_bound(instance, tables)


def test_starting_over_that_is_broken_off_leaves_no_trace() -> None:
    instance = crowd(open_grid, 2, rotation=False)
    plan = first_plan(instance)
    tables = DistanceTable(instance.graph, instance.blocked)
    search = LargeNeighbourhoodSearch(
        roads_of(instance.graph, instance.blocked), guide_of(instance, tables), plan.states, np.random.default_rng(0)
    )
    search.start_over(lambda: False)
    assert (search.states() == plan.states).all()
    assert search.cost == sum_of_loss(instance, plan)


def test_the_plan_of_another_instance_is_refused() -> None:
    instance = crowd(open_grid, 0, rotation=False)
    wrong = Plan(states=instance.starts[None, ::-1], status=Status.FEASIBLE, iterations=0)
    with pytest.raises(PlanningError, match="does not begin with the starts"):
        improve(instance, wrong)
