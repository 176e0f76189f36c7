"""Costs of hand-made plans."""

from __future__ import annotations

import numpy as np

from planners.mapf.distance_table import DistanceTable
from planners.mapf.metrics import loss, lower_bound, sum_of_costs, sum_of_loss
from planners.mapf.problem import NO_GOAL, Plan
from planners.status import Status
from tests.unit.planners.mapf.lanes import graph_of, instance_of, open_grid


def plan_of(*rows: list[int]) -> Plan:
    return Plan(states=np.array(rows, dtype=np.int32), status=Status.FEASIBLE, iterations=0)


def test_waiting_at_the_goal_loses_nothing_but_leaving_it_and_coming_back_does() -> None:
    instance = instance_of(open_grid(1, 6), [0, 4, 5], [2, 4, NO_GOAL])
    plan = plan_of([0, 4, 5], [1, 4, 5], [2, 3, 4], [2, 4, 5], [2, 4, 5])
    assert loss(instance, plan).tolist() == [2, 2, 0]
    assert sum_of_loss(instance, plan) == 4


def test_the_sum_of_costs_counts_until_the_last_arrival() -> None:
    instance = instance_of(open_grid(1, 6), [0, 4, 5], [2, 4, NO_GOAL])
    plan = plan_of([0, 4, 5], [1, 4, 5], [2, 3, 4], [2, 4, 5], [2, 4, 5])
    assert sum_of_costs(instance, plan) == 2 + 3


def test_an_agent_that_does_not_arrive_costs_the_whole_plan() -> None:
    instance = instance_of(open_grid(1, 6), [0], [5])
    assert sum_of_costs(instance, plan_of([0], [1], [2], [2])) == 3
    assert sum_of_costs(instance, plan_of([0])) == 0


def test_the_lower_bound_adds_up_the_distances_of_those_who_have_a_way() -> None:
    graph = graph_of(range(6), [(0, 1), (1, 2), (2, 3), (4, 5), (5, 4)])
    instance = instance_of(graph, [0, 4, 5], [3, 0, NO_GOAL])
    assert lower_bound(instance, DistanceTable(graph, instance.blocked)) == 3
