"""Every planner meets the same dangers; the referee, who shares no code with them, is the judge."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from planners.deadline import Deadline
from planners.mapf import PLANNERS
from planners.mapf.distance_table import DistanceTable
from planners.mapf.problem import Instance, Plan
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
    reached,
    rotating_grid,
)


@dataclass(frozen=True)
class Danger:
    """An instance and what it is good for."""

    instance: Instance
    solved: bool = True
    """Every agent must be at its goal in some row."""
    status: Status = Status.FEASIBLE


def head_on() -> Danger:
    """Two agents face each other in a corridor: a planner that forgets swaps lets them pass through each other."""
    return Danger(instance_of(open_grid(1, 6), [0, 5], [5, 0], horizon=20), solved=False)


def head_on_adjacent() -> Danger:
    """The same with nothing between them."""
    return Danger(instance_of(open_grid(1, 2), [0, 1], [1, 0]), solved=False)


def head_on_where_rings_are_legal() -> Danger:
    """A ring of two is still a swap."""
    return Danger(instance_of(open_grid(1, 2), [0, 1], [1, 0], allow_rotation=True), solved=False)


def adjacent_swap() -> Danger:
    """Neighbours want each other's cell, and there is room beside them."""
    return Danger(instance_of(open_grid(3, 3), [4, 5], [5, 4]))


def head_on_with_bay() -> Danger:
    """A corridor with a bay in the middle: giving way is possible, but no greedy planner has to find it."""
    corridor = [(k, k + 1) for k in range(4)] + [(k + 1, k) for k in range(4)]
    graph = graph_of(range(6), [*corridor, (2, 5), (5, 2)])
    return Danger(instance_of(graph, [0, 4], [4, 0], priorities=[1.0, 0.0], horizon=20), solved=False)


def ring() -> Danger:
    """A loop full of followers: no legal step but waiting."""
    return Danger(instance_of(one_way_loop(4), [0, 1, 2, 3], [1, 2, 3, 0]), solved=False)


def ring_allowed() -> Danger:
    """The same where rings are legal: all move at once."""
    return Danger(instance_of(one_way_loop(4), [0, 1, 2, 3], [1, 2, 3, 0], allow_rotation=True))


def ring_with_gap() -> Danger:
    """A loop with one empty cell: it moves like a sliding puzzle."""
    return Danger(instance_of(one_way_loop(5), [0, 1, 2, 3], [2, 3, 4, 0], horizon=20))


def ring_among_others() -> Danger:
    """Four agents in a square of an open grid want to turn around its centre, which tempts into a ring."""
    return Danger(instance_of(open_grid(4, 4), [5, 6, 10, 9], [6, 10, 9, 5], horizon=30))


def full_cycle() -> Danger:
    """A two-way square without an empty cell: neither swaps nor rings."""
    return Danger(instance_of(open_grid(2, 2), [0, 1, 2, 3], [1, 3, 0, 2]), solved=False)


def following_chain() -> Danger:
    """A platoon moves as one."""
    return Danger(instance_of(open_grid(1, 8), [0, 1, 2, 3], [4, 5, 6, 7], horizon=4))


def following_chain_from_behind() -> Danger:
    """The last of a platoon decides first."""
    return Danger(instance_of(open_grid(1, 8), [0, 1, 2, 3], [4, 5, 6, 7], priorities=[4, 3, 2, 1], horizon=4))


def fixed_blocker() -> Danger:
    """The only lane is held by an agent that does not move."""
    return Danger(instance_of(one_way_loop(8), [0, 3], [5, -1], fixed=[False, True]), solved=False)


def fixed_goal() -> Danger:
    """The goal is occupied by an agent that does not move."""
    return Danger(instance_of(one_way_grid(4, 4), [0, 9], [9, 9], fixed=[False, True]), solved=False)


def stay_at_goal() -> Danger:
    """An agent that stays at its goal is not pushed on, however important the one behind it."""
    return Danger(instance_of(one_way_loop(8), [0, 2], [6, 3], stay=[False, True], priorities=[9.0, 0.0]), solved=False)


def pushed_on() -> Danger:
    """An agent that does not stay at its goal is pushed on."""
    return Danger(instance_of(one_way_loop(8), [0, 2], [6, 3], priorities=[0.0, 9.0]))


def no_way_out() -> Danger:
    """An agent at the end of a lane is wanted away, and cannot go."""
    return Danger(instance_of(graph_of([0, 1], [(0, 1)]), [0, 1], [1, -1]), solved=False)


def unreachable_goal() -> Danger:
    """The first agent cannot ever reach its goal; the second must not suffer."""
    graph = graph_of(range(6), [*((k, (k + 1) % 4) for k in range(4)), (4, 5), (5, 4)])
    return Danger(instance_of(graph, [0, 4], [4, 5]), solved=False, status=Status.INFEASIBLE)


def blocked_goal() -> Danger:
    """The goal lies in a closed cell."""
    return Danger(instance_of(open_grid(1, 4), [0], [3], blocked=[3]), solved=False, status=Status.INFEASIBLE)


def blocked_shortcut() -> Danger:
    """The straight way is closed, another one is open."""
    return Danger(instance_of(open_grid(3, 3), [3], [5], blocked=[4]))


def starts_in_blocked() -> Danger:
    """A cell is closed over an agent: it leaves, and nobody follows it in."""
    return Danger(instance_of(open_grid(1, 4), [1, 0], [3, -1], blocked=[1]))


def start_is_goal() -> Danger:
    """Nothing to do."""
    return Danger(instance_of(open_grid(2, 2), [0, 3], [0, 3]))


def two_agents_one_goal() -> Danger:
    """Normal in lifelong runs: both get there, one after the other."""
    return Danger(instance_of(open_grid(3, 3), [0, 8], [4, 4], horizon=20))


def wide_sweep() -> Danger:
    """A move cuts a corner that another agent stands on or wants."""
    graph = graph_of(
        range(6),
        [(0, 2), (2, 0), (1, 3), (3, 1), (4, 1), (1, 4), (3, 5), (5, 3)],
        sweeps={(0, 2): (1,), (2, 0): (1,), (4, 1): (3,)},
    )
    return Danger(instance_of(graph, [0, 1, 5], [2, 4, 1], priorities=[3, 2, 1], horizon=20))


def nobody() -> Danger:
    """No agents at all."""
    return Danger(instance_of(open_grid(2, 2), [], []))


GRIDS = {"one_way": one_way_grid, "two_way": open_grid, "diagonal": king_grid, "rotating": rotating_grid}


def crowd(seed: int, share: float, grid: str = "one_way", *, rotation: bool = False) -> Danger:
    """Random starts and goals, some fixed, some that stay, some blocked cells."""
    rng = np.random.default_rng(seed)
    graph = GRIDS[grid](6, 8)
    n = int(share * graph.n_cells)
    starts = random_starts(graph, n, rng)
    taken = set(graph.state_cell[starts].tolist())
    free = [cell for cell in range(graph.n_cells) if cell not in taken]
    goals = [goal if rng.random() < 0.8 else -1 for goal in rng.integers(graph.n_states, size=n).tolist()]
    blocked = free[:2]
    instance = instance_of(
        graph,
        starts,
        goals,
        priorities=rng.random(n).tolist(),
        stay=(rng.random(n) < 0.3).tolist(),
        fixed=(rng.random(n) < 0.1).tolist(),
        blocked=blocked,
        allow_rotation=rotation,
        horizon=30,
    )
    possible = DistanceTable(graph, instance.blocked)
    lost = any(
        goal >= 0 and possible.to(goal)[start] > graph.n_states for start, goal in zip(starts, goals, strict=True)
    )
    return Danger(instance, solved=False, status=Status.INFEASIBLE if lost else Status.FEASIBLE)


DANGERS: dict[str, Callable[[], Danger]] = {
    make.__name__: make
    for make in (
        head_on,
        head_on_adjacent,
        head_on_where_rings_are_legal,
        adjacent_swap,
        head_on_with_bay,
        ring,
        ring_allowed,
        ring_with_gap,
        ring_among_others,
        full_cycle,
        following_chain,
        following_chain_from_behind,
        fixed_blocker,
        fixed_goal,
        stay_at_goal,
        pushed_on,
        no_way_out,
        unreachable_goal,
        blocked_goal,
        blocked_shortcut,
        starts_in_blocked,
        start_is_goal,
        two_agents_one_goal,
        wide_sweep,
        nobody,
    )
}
for case in itertools.product(GRIDS, (0.2, 0.5, 0.8, 0.95), range(4)):
    DANGERS["crowd_{}_{}_{}".format(*case)] = lambda grid=case[0], share=case[1], seed=case[2]: crowd(
        seed, share, grid, rotation=seed % 2 == 1
    )

planners = pytest.mark.parametrize("planner", PLANNERS)


def plan_with(planner: str, instance: Instance, deadline: Deadline | None = None, *, seed: int = 0) -> Plan:
    tables = DistanceTable(instance.graph, instance.blocked)
    return PLANNERS[planner](seed=seed).plan(instance, tables, deadline)


@planners
@pytest.mark.parametrize("danger", DANGERS)
def test_a_plan_is_legal_and_says_how_it_ended(planner: str, danger: str) -> None:
    case = DANGERS[danger]()
    for seed in range(3):
        plan = plan_with(planner, case.instance, seed=seed)
        assert breaches(case.instance, plan) == []
        assert plan.status == case.status
        assert plan.states.shape == (case.instance.horizon + 1, case.instance.n_agents)
        if case.solved:
            assert reached(case.instance, plan).all()


@planners
def test_a_full_ring_stands_still(planner: str) -> None:
    plan = plan_with(planner, ring().instance)
    assert (plan.states == plan.states[0]).all()


@planners
def test_a_platoon_loses_no_time(planner: str) -> None:
    plan = plan_with(planner, following_chain_from_behind().instance)
    assert plan.states[-1].tolist() == [4, 5, 6, 7]


@planners
def test_the_agent_behind_a_blocker_comes_close_and_waits(planner: str) -> None:
    plan = plan_with(planner, fixed_blocker().instance)
    assert plan.states[:, 0].tolist() == [0, 1, *[2] * 11]


@planners
def test_waiting_beats_a_detour(planner: str) -> None:
    """Behind an agent that is being served there is a way around through the whole loop: not worth it."""
    graph = graph_of(range(12), [*((k, (k + 1) % 10) for k in range(10)), (3, 10), (10, 11), (11, 0)])
    instance = instance_of(graph, [2, 4], [6, -1], fixed=[False, True])
    plan = plan_with(planner, instance)
    assert plan.states[1:, 0].tolist() == [3] * 12


@planners
def test_the_other_agents_do_not_suffer_from_one_that_has_no_way(planner: str) -> None:
    case = unreachable_goal()
    assert reached(case.instance, plan_with(planner, case.instance)).tolist() == [False, True]


@planners
def test_an_agent_without_a_goal_stays_where_it_is(planner: str) -> None:
    instance = instance_of(open_grid(3, 3), [4, 0])
    assert (plan_with(planner, instance).states == instance.starts).all()


@planners
def test_the_important_agent_goes_first(planner: str) -> None:
    """Two lanes merge; whoever matters more passes first."""
    graph = graph_of(range(5), [(0, 2), (1, 2), (2, 3), (3, 4)])
    for winner in (0, 1):
        instance = instance_of(graph, [0, 1], [4, 4], priorities=[1.0 - winner, float(winner)], horizon=3)
        assert plan_with(planner, instance).states[1, winner] == 2


@planners
@pytest.mark.parametrize("budget", [0, 1, 5])
def test_an_expired_deadline_gives_a_legal_prefix(planner: str, budget: int) -> None:
    case = crowd(0, 0.5)
    plan = plan_with(planner, case.instance, Deadline(budget))
    assert plan.status in (Status.TIMEOUT, Status.INFEASIBLE)
    assert 1 <= len(plan.states) <= case.instance.horizon + 1
    assert breaches(case.instance, plan) == []


@planners
def test_the_budget_says_whether_there_was_time(planner: str) -> None:
    instance = adjacent_swap().instance
    assert plan_with(planner, instance, Deadline(0)).status is Status.TIMEOUT
    assert plan_with(planner, instance, Deadline(10**6)).status is Status.FEASIBLE


@planners
@pytest.mark.parametrize("danger", ["crowd_one_way_0.5_0", "wide_sweep", "ring_with_gap"])
def test_the_input_is_not_changed(planner: str, danger: str) -> None:
    instance = DANGERS[danger]().instance
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
    instance = crowd(1, 0.5).instance
    for value in vars(instance).values():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
    plan_with(planner, instance)


@planners
def test_the_same_seed_gives_the_same_plan_and_another_one_does_not(planner: str) -> None:
    instance = crowd(2, 0.5, "two_way").instance
    plans = [plan_with(planner, instance, seed=seed).states for seed in (7, 7, 8)]
    assert (plans[0] == plans[1]).all()
    assert (plans[0] != plans[2]).any()


@planners
def test_tables_of_earlier_windows_do_not_change_the_plan(planner: str) -> None:
    instance = crowd(3, 0.5).instance
    tables = DistanceTable(instance.graph, instance.blocked)
    for goal in range(0, 60, 7):
        tables.to(goal)
    warm = PLANNERS[planner](seed=0).plan(instance, tables)
    assert (warm.states == plan_with(planner, instance).states).all()


@planners
def test_a_horizon_of_nothing_is_the_start(planner: str) -> None:
    instance = replace(crowd(0, 0.5).instance, horizon=0)
    assert plan_with(planner, instance).states.tolist() == [instance.starts.tolist()]
