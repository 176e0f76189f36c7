"""Conflict-based search against exhaustion: the same least cost on tiny problems of every motion model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maps.grid import GridMap
from maps.lane_graph import grid_lane_graph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.cbs.cbs import Cbs, CbsConfig
from planners.mapf.problem import Instance, Plan
from planners.mapf.validate import breaches
from planners.status import Status
from tests.unit.planners.mapf.brute_force import least_sum_of_costs
from tests.unit.planners.mapf.lanes import graph_of, instance_of, king_grid, one_way_loop, open_grid, random_starts
from tests.unit.planners.mapf.tiny import MODELS, tiny_instance

ALL = 500
QUICK = range(60)


def cost_of(plan: Plan) -> int:
    """Timesteps until each agent stands still for good, added up."""
    away = plan.states != plan.states[-1]
    return int(np.where(away.any(axis=0), len(away) - np.argmax(away[::-1], axis=0), 0).sum())


def agrees_with_exhaustion(instance: Instance) -> bool:
    """Whether the least costs are the same; a problem without a solution must not be solved."""
    least = least_sum_of_costs(instance)
    plan = Cbs().plan(instance, None, Deadline(200 if least is None else 20_000))
    assert breaches(instance, plan) == []
    if least is None:
        return plan.status in (Status.TIMEOUT, Status.INFEASIBLE)
    at_goals = ((plan.states[-1] == instance.goals) | (instance.goals < 0)).all()
    return plan.status is Status.OPTIMAL and bool(at_goals) and cost_of(plan) == least


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("number", QUICK)
def test_it_costs_what_exhaustion_says(model: str, number: int) -> None:
    assert agrees_with_exhaustion(tiny_instance(model, number))


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_it_costs_what_exhaustion_says_five_hundred_times(model: str) -> None:
    wrong = [number for number in range(ALL) if not agrees_with_exhaustion(tiny_instance(model, number))]
    assert wrong == []


@pytest.mark.parametrize("model", MODELS)
def test_the_problems_are_no_walk_over(model: str) -> None:
    """Enough of them have a solution, enough have none, and in at least eight the agents cost each other something."""
    costs, alone = [], []
    for number in QUICK:
        instance = tiny_instance(model, number)
        least = least_sum_of_costs(instance)
        if least is not None:
            costs.append(least)
            each = [
                least_sum_of_costs(
                    replace(
                        instance,
                        **{
                            name: getattr(instance, name)[agent : agent + 1]
                            for name in ("starts", "goals", "priorities", "stay", "fixed")
                        },
                    )
                )
                for agent in range(instance.n_agents)
            ]
            alone.append(sum(each))
    assert 20 < len(costs) < 56
    assert sum(together > apart for together, apart in zip(costs, alone, strict=True)) >= 8


def test_two_meet_in_a_corridor_with_a_bay() -> None:
    """Head on in a corridor with one bay: 6 timesteps for who turns in, 5 for the other one."""
    corridor = [*((k, k + 1) for k in range(4)), *((k + 1, k) for k in range(4))]
    instance = instance_of(graph_of(range(6), [*corridor, (2, 5), (5, 2)]), [0, 4], [4, 0], horizon=40)
    plan = Cbs().plan(instance)
    assert (plan.status, breaches(instance, plan), cost_of(plan)) == (Status.OPTIMAL, [], 11)


def test_a_ring_costs_nothing_where_it_is_legal_and_cannot_turn_where_it_is_not() -> None:
    for rotation in (False, True):
        instance = instance_of(one_way_loop(4), [0, 1, 2, 3], [1, 2, 3, 0], allow_rotation=rotation)
        plan = Cbs(CbsConfig(nodes=500)).plan(instance)
        assert breaches(instance, plan) == []
        assert (plan.status is Status.OPTIMAL) == rotation
    assert cost_of(plan) == 4


def test_a_square_of_four_turns_around_a_gap() -> None:
    """Rings are forbidden, so the square must open."""
    instance = instance_of(open_grid(2, 3), [0, 1, 4, 3], [1, 4, 3, 0], horizon=40)
    free = Cbs().plan(replace(instance, allow_rotation=True))
    plan = Cbs().plan(instance)
    assert (free.status, cost_of(free)) == (Status.OPTIMAL, 4)
    assert (plan.status, breaches(instance, plan)) == (Status.OPTIMAL, [])
    assert cost_of(plan) == least_sum_of_costs(instance) > 4


def test_an_agent_that_stays_is_in_the_way() -> None:
    """Without staying it steps aside once; with it, the other one has no way at all."""
    graph = graph_of(range(6), [*((k, k + 1) for k in range(4)), *((k + 1, k) for k in range(4)), (2, 5), (5, 2)])
    for stay in (False, True):
        instance = instance_of(graph, [2, 4], [2, 0], stay=[stay, False], horizon=40)
        plan = Cbs(CbsConfig(nodes=300)).plan(instance)
        assert breaches(instance, plan) == []
        assert (plan.status is Status.OPTIMAL) == (not stay)


def test_ten_agents_on_a_floor_with_obstacles() -> None:
    rng = np.random.default_rng(3)
    free = rng.random((12, 12)) >= 0.15
    graph = grid_lane_graph(GridMap(free), "pebble")
    for seed in range(5):
        chance = np.random.default_rng(seed)
        instance = instance_of(graph, random_starts(graph, 10, chance), random_starts(graph, 10, chance), horizon=200)
        plan = Cbs().plan(instance, None, Deadline(5000))
        assert breaches(instance, plan) == []
        assert plan.status in (Status.OPTIMAL, Status.INFEASIBLE)


def test_the_horizon_cuts_the_plan_and_the_proof() -> None:
    instance = instance_of(open_grid(1, 8), [0], [7], horizon=3)
    plan = Cbs().plan(instance)
    assert (plan.status, plan.states.ravel().tolist()) == (Status.FEASIBLE, [0, 1, 2, 3])


@pytest.mark.parametrize("budget", [0, 1, 5, 50])
def test_too_small_a_budget_leaves_a_legal_beginning(budget: int) -> None:
    instance = instance_of(king_grid(3, 3), [0, 2, 6, 8], [8, 6, 2, 0], horizon=40)
    plan = Cbs().plan(instance, None, Deadline(budget))
    assert breaches(instance, plan) == []
    assert plan.iterations <= budget
    if plan.status is not Status.OPTIMAL:
        assert plan.status is Status.TIMEOUT


def test_the_limit_of_nodes_ends_a_search_that_would_not() -> None:
    plan = Cbs(CbsConfig(nodes=30)).plan(instance_of(open_grid(1, 4), [0, 3], [3, 0], horizon=40))
    assert (plan.status, plan.iterations) == (Status.TIMEOUT, 30)


def test_nobody_is_at_once_where_nobody_wants_to_be() -> None:
    plan = Cbs().plan(instance_of(open_grid(2, 2), [], []))
    assert (plan.status, plan.states.shape) == (Status.OPTIMAL, (1, 0))


def test_no_nodes_at_all_are_refused() -> None:
    with pytest.raises(PlanningError, match="nodes = 0; valid: an integer >= 1"):
        CbsConfig(nodes=0)
