"""Every one-shot planner meets the same dangers; the referee, who shares no code with them, is the judge."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf import ONE_SHOT_PLANNERS
from planners.mapf.distance_table import DistanceTable
from planners.mapf.problem import NO_GOAL, Instance, Plan
from planners.mapf.validate import breaches
from planners.status import Status
from tests.unit.planners.mapf.lanes import (
    graph_of,
    instance_of,
    king_grid,
    one_way_grid,
    one_way_loop,
    open_grid,
    random_starts,
    rotating_grid,
)

LONG = 200
SOLVED = (Status.FEASIBLE, Status.OPTIMAL)


@dataclass(frozen=True)
class Danger:
    """An instance and what it is good for."""

    instance: Instance
    solvable: bool = True
    """There is a plan, and any planner of this family finds it; otherwise there is none."""


def swap_with_room() -> Danger:
    """Neighbours want each other's cell."""
    return Danger(instance_of(open_grid(3, 3), [4, 5], [5, 4], horizon=LONG))


def head_on() -> Danger:
    """Two agents face each other in a corridor without a bay."""
    return Danger(instance_of(open_grid(1, 6), [0, 5], [5, 0], horizon=LONG), solvable=False)


def head_on_where_rings_are_legal() -> Danger:
    """A ring of two is still a swap."""
    return Danger(instance_of(open_grid(1, 2), [0, 1], [1, 0], allow_rotation=True, horizon=LONG), solvable=False)


def ring() -> Danger:
    """A loop full of followers."""
    return Danger(instance_of(one_way_loop(4), [0, 1, 2, 3], [1, 2, 3, 0], horizon=LONG), solvable=False)


def ring_allowed() -> Danger:
    """The same where rings are legal: all move at once."""
    return Danger(instance_of(one_way_loop(4), [0, 1, 2, 3], [1, 2, 3, 0], allow_rotation=True, horizon=LONG))


def full_cycle() -> Danger:
    """A two-way square without an empty cell: neither swaps nor rings."""
    return Danger(instance_of(open_grid(2, 2), [0, 1, 2, 3], [1, 3, 0, 2], horizon=LONG), solvable=False)


def following_chain() -> Danger:
    """A platoon moves as one."""
    return Danger(instance_of(open_grid(1, 8), [0, 1, 2, 3], [4, 5, 6, 7], horizon=LONG))


def fixed_blocker() -> Danger:
    """The only lane is held by an agent that does not move."""
    return Danger(instance_of(one_way_loop(8), [0, 3], [5, NO_GOAL], fixed=[False, True], horizon=LONG), solvable=False)


def fixed_elsewhere() -> Danger:
    """The straight way is held by an agent that does not move, another one is open."""
    return Danger(instance_of(open_grid(3, 3), [3, 4], [5, NO_GOAL], fixed=[False, True], horizon=LONG))


def fixed_away_from_its_goal() -> Danger:
    """An agent that must not move has somewhere to go."""
    return Danger(instance_of(open_grid(3, 3), [3, 0], [5, 8], fixed=[False, True], horizon=LONG), solvable=False)


def stay_at_goal() -> Danger:
    """An agent that stays at its goal closes the lane for the one behind it, unless that one passes first."""
    return Danger(instance_of(one_way_loop(8), [0, 2], [1, 6], stay=[True, False], horizon=LONG))


def shut_out() -> Danger:
    """An agent stays at its goal from the start, in the only way of the other."""
    return Danger(instance_of(one_way_loop(8), [0, 2], [6, 2], stay=[False, True], horizon=LONG), solvable=False)


def shared_goal() -> Danger:
    """Two agents cannot stand on one goal at the same time."""
    return Danger(instance_of(open_grid(3, 3), [0, 8], [4, 4], horizon=LONG), solvable=False)


def out_of_the_way() -> Danger:
    """An agent without a goal stands in the only lane, and has a bay to go to."""
    graph = graph_of(range(5), [(0, 1), (1, 0), (1, 2), (2, 1), (2, 3), (3, 2), (2, 4), (4, 2)])
    return Danger(instance_of(graph, [0, 2], [3, NO_GOAL], horizon=LONG))


def unreachable_goal() -> Danger:
    """The first agent cannot ever reach its goal."""
    graph = graph_of(range(6), [*((k, (k + 1) % 4) for k in range(4)), (4, 5), (5, 4)])
    return Danger(instance_of(graph, [0, 4], [4, 5], horizon=LONG), solvable=False)


def blocked_goal() -> Danger:
    """The goal lies in a closed cell."""
    return Danger(instance_of(open_grid(1, 4), [0], [3], blocked=[3], horizon=LONG), solvable=False)


def blocked_shortcut() -> Danger:
    """The straight way is closed, another one is open."""
    return Danger(instance_of(open_grid(3, 3), [3], [5], blocked=[4], horizon=LONG))


def starts_in_blocked() -> Danger:
    """A cell is closed over an agent: it leaves, and nobody follows it in."""
    return Danger(instance_of(open_grid(1, 4), [1, 0], [3, NO_GOAL], blocked=[1], horizon=LONG))


def start_is_goal() -> Danger:
    """Nothing to do."""
    return Danger(instance_of(open_grid(2, 2), [0, 3], [0, 3], horizon=LONG))


def wide_sweep() -> Danger:
    """A move cuts a corner that another agent stands on or wants."""
    graph = graph_of(
        range(6),
        [(0, 2), (2, 0), (1, 3), (3, 1), (4, 1), (1, 4), (3, 5), (5, 3)],
        sweeps={(0, 2): (1,), (2, 0): (1,), (4, 1): (3,)},
    )
    return Danger(instance_of(graph, [0, 1, 5], [2, 4, 1], horizon=LONG))


def turn_on_the_spot() -> Danger:
    """Two vehicles that turn on the spot pass each other; goals have headings."""
    graph = rotating_grid(2, 4)
    ends = [int(graph.state_index[cell, heading]) for cell, heading in ((0, 0), (3, 2), (3, 1), (0, 3))]
    return Danger(instance_of(graph, ends[:2], ends[2:], horizon=LONG))


def nobody() -> Danger:
    """No agents at all."""
    return Danger(instance_of(open_grid(2, 2), [], [], horizon=LONG))


GRIDS = {"one_way": one_way_grid, "two_way": open_grid, "diagonal": king_grid, "rotating": rotating_grid}


def crowd(seed: int, grid: str, share: float) -> Danger:
    """Distinct random starts and goals on a grid with room to pass."""
    rng = np.random.default_rng(seed)
    graph = GRIDS[grid](6, 8)
    n = int(share * graph.n_cells)
    starts, goals = random_starts(graph, n, rng), random_starts(graph, n, rng)
    return Danger(instance_of(graph, starts, goals, allow_rotation=seed % 2 == 1, horizon=LONG))


DANGERS: dict[str, Callable[[], Danger]] = {
    make.__name__: make
    for make in (
        swap_with_room,
        head_on,
        head_on_where_rings_are_legal,
        ring,
        ring_allowed,
        full_cycle,
        following_chain,
        fixed_blocker,
        fixed_elsewhere,
        fixed_away_from_its_goal,
        stay_at_goal,
        shut_out,
        shared_goal,
        out_of_the_way,
        unreachable_goal,
        blocked_goal,
        blocked_shortcut,
        starts_in_blocked,
        start_is_goal,
        wide_sweep,
        turn_on_the_spot,
        nobody,
    )
}

planners = pytest.mark.parametrize("planner", ONE_SHOT_PLANNERS)
COMPLETE = ("lacam",)
"""Planners that prove that there is no plan, and find one whatever has to be undone for it."""


BUDGET = {"lacam": 3000, "sipp": 3000, "cbs": 200}
"""Iterations, which each planner counts in its own way."""


def plan_with(planner: str, instance: Instance, deadline: Deadline | None = None, *, seed: int = 0) -> Plan:
    tables = DistanceTable(instance.graph, instance.blocked)
    return ONE_SHOT_PLANNERS[planner](seed=seed).plan(instance, tables, deadline)


def all_there(instance: Instance, plan: Plan) -> bool:
    return bool(((plan.states[-1] == instance.goals) | (instance.goals == NO_GOAL)).all())


@planners
@pytest.mark.parametrize("danger", DANGERS)
def test_a_plan_is_legal_and_ends_with_all_agents_at_their_goals_or_says_why_not(planner: str, danger: str) -> None:
    case = DANGERS[danger]()
    for seed in range(3):
        plan = plan_with(planner, case.instance, Deadline(BUDGET[planner]), seed=seed)
        assert breaches(case.instance, plan) == []
        assert plan.status in (SOLVED if case.solvable else (Status.INFEASIBLE, Status.TIMEOUT))
        assert all_there(case.instance, plan) == case.solvable
        if planner in COMPLETE and not case.solvable:
            assert plan.status is Status.INFEASIBLE


@planners
@pytest.mark.parametrize("grid", ["one_way", "two_way", "diagonal", "rotating"])
@pytest.mark.parametrize("share", [0.1, 0.3])
def test_a_crowd_gets_there(planner: str, grid: str, share: float) -> None:
    for seed in range(3):
        case = crowd(seed, grid, share)
        plan = plan_with(planner, case.instance, Deadline(BUDGET[planner]))
        assert breaches(case.instance, plan) == []
        if planner in COMPLETE or plan.status in SOLVED:
            assert plan.status in SOLVED
            assert all_there(case.instance, plan)


@planners
def test_a_plan_ends_where_the_last_agent_arrives(planner: str) -> None:
    case = following_chain()
    assert len(plan_with(planner, case.instance).states) == 5


@planners
def test_without_a_deadline_it_ends_by_itself(planner: str) -> None:
    for danger in (swap_with_room(), head_on(), crowd(0, "two_way", 0.3)):
        plan = plan_with(planner, danger.instance)
        assert (plan.status in SOLVED) == danger.solvable


@planners
def test_a_horizon_cuts_the_plan(planner: str) -> None:
    instance = replace(following_chain().instance, horizon=2)
    plan = plan_with(planner, instance)
    assert plan.states.shape == (3, 4)
    assert plan.status in SOLVED
    assert breaches(instance, plan) == []


@planners
def test_a_horizon_of_nothing_is_the_start(planner: str) -> None:
    instance = replace(crowd(0, "two_way", 0.3).instance, horizon=0)
    assert plan_with(planner, instance).states.tolist() == [instance.starts.tolist()]


@planners
@pytest.mark.parametrize("budget", [0, 1, 5])
def test_an_expired_deadline_gives_a_legal_prefix(planner: str, budget: int) -> None:
    instance = crowd(0, "two_way", 0.5).instance
    plan = plan_with(planner, instance, Deadline(budget))
    assert plan.status is Status.TIMEOUT
    assert len(plan.states) >= 1
    assert breaches(instance, plan) == []


@planners
def test_no_time_on_the_clock_gives_the_start(planner: str) -> None:
    instance = crowd(0, "two_way", 0.5).instance
    plan = plan_with(planner, instance, Deadline(wall_s=0.0))
    assert plan.status is Status.TIMEOUT
    assert plan.states.tolist() == [instance.starts.tolist()]


@planners
@pytest.mark.parametrize("grid", ["one_way", "rotating"])
def test_the_input_is_not_changed(planner: str, grid: str) -> None:
    instance = crowd(1, grid, 0.3).instance
    before = copy.deepcopy(vars(instance))
    plan_with(planner, instance)
    for name, value in before.items():
        if name == "graph":
            for part, array in vars(value).items():
                np.testing.assert_array_equal(array, getattr(instance.graph, part))
        else:
            np.testing.assert_array_equal(value, getattr(instance, name))


@planners
def test_read_only_input_is_enough(planner: str) -> None:
    instance = crowd(1, "two_way", 0.3).instance
    for value in vars(instance).values():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
    plan_with(planner, instance)


@planners
def test_the_same_seed_gives_the_same_plan(planner: str) -> None:
    instance = crowd(2, "two_way", 0.5).instance
    plans = [plan_with(planner, instance, Deadline(500), seed=7).states for _ in range(2)]
    np.testing.assert_array_equal(*plans)


@planners
def test_tables_of_another_graph_are_refused(planner: str) -> None:
    instance = swap_with_room().instance
    other = open_grid(3, 3)
    with pytest.raises(PlanningError, match="another graph"):
        ONE_SHOT_PLANNERS[planner]().plan(instance, DistanceTable(other, instance.blocked))
