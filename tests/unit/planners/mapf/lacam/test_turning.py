"""Plans over cells become plans of vehicles that turn on the spot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planners.deadline import Deadline
from planners.mapf.lacam.lacam import Lacam, LacamConfig
from planners.mapf.lacam.turning import can_forget_headings, with_headings, without_headings
from planners.mapf.problem import NO_GOAL, Instance, Plan
from planners.mapf.validate import breaches
from planners.status import Status
from tests.unit.planners.mapf.lanes import instance_of, open_grid, random_starts, rotating_grid


def lifted(instance: Instance) -> Plan:
    flat = without_headings(instance)
    plan = Lacam(LacamConfig(refine=False)).plan(flat, None, Deadline(1000))
    assert plan.status in (Status.FEASIBLE, Status.OPTIMAL)
    assert breaches(flat, plan) == []
    return replace(plan, states=with_headings(instance, plan.states))


@pytest.mark.parametrize("rotation", [False, True])
@pytest.mark.parametrize("n", [1, 10, 30])
def test_a_crowd_drives_its_cells_in_order(n: int, rotation: bool) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        graph = rotating_grid(6, 8)
        goals = random_starts(graph, n, rng)
        goals[0] = NO_GOAL
        instance = instance_of(graph, random_starts(graph, n, rng), goals, allow_rotation=rotation, horizon=10**4)
        plan = lifted(instance)
        assert breaches(instance, plan) == []
        assert ((plan.states[-1] == instance.goals) | (instance.goals == NO_GOAL)).all()


def test_nobody_waits_for_the_clock_of_the_plan() -> None:
    """Two turns to begin with, three cells straight on, one turn at the end."""
    graph = rotating_grid(1, 4)
    start, goal = int(graph.state_index[0, 2]), int(graph.state_index[3, 1])
    instance = instance_of(graph, [start], [goal], horizon=50)
    cells = np.array([[0], [0], [0], [1], [1], [2], [2], [3], [3]], dtype=np.int32)
    assert len(with_headings(instance, cells)) == 1 + 2 + 3 + 1


def test_a_ring_turns_as_one() -> None:
    graph = rotating_grid(2, 2)
    starts = [int(graph.state_index[cell, 0]) for cell in (0, 1, 3, 2)]
    goals = [int(graph.state_index[cell, 0]) for cell in (1, 3, 2, 0)]
    instance = instance_of(graph, starts, goals, allow_rotation=True, horizon=50)
    plan = lifted(instance)
    assert breaches(instance, plan) == []
    assert (plan.states[-1] == instance.goals).all()


def test_headings_cannot_be_forgotten_where_they_bind() -> None:
    rotating = instance_of(rotating_grid(2, 2), [0, 8], [4, 8], stay=[False, True])
    assert can_forget_headings(rotating)
    assert not can_forget_headings(replace(rotating, stay=np.array([True, False])))
    assert not can_forget_headings(instance_of(open_grid(2, 2), [0], [1]))
