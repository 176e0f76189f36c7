"""Multi-step PIBT: what it can do that one step ahead cannot see, and what it must not do."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from maps.grid import EAST, NORTH
from maps.lane_graph import build_lane_graph
from maps.site import Site
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.distance_table import DistanceTable
from planners.mapf.multi_step import multi_step_kernel
from planners.mapf.multi_step.multi_step_pibt import (
    RELEASE_WINDOWS,
    STUCK_WINDOWS,
    MultiStepConfig,
    MultiStepPibt,
    rank_weights,
)
from planners.mapf.options import open_moves
from planners.mapf.problem import NO_GOAL, Instance
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

GRAPHS = {"pebble": open_grid, "rotating": rotating_grid, "one_way": one_way_grid, "wide": king_grid}


def crowd(name: str, share: float, seed: int, *, allow_rotation: bool, horizon: int = 25) -> Instance:
    """Random starts and goals on a floor of 4 x 6 cells; some are fixed, some stay at their goals."""
    rng = np.random.default_rng(seed)
    graph = GRAPHS[name](4, 6)
    n = int(share * graph.n_cells)
    starts = random_starts(graph, n, rng)
    return instance_of(
        graph,
        starts,
        rng.integers(graph.n_states, size=n).tolist(),
        priorities=rng.random(n).tolist(),
        stay=(rng.random(n) < 0.3).tolist(),
        fixed=(rng.random(n) < 0.1).tolist(),
        allow_rotation=allow_rotation,
        horizon=horizon,
    )


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"length": 0}, "length = 0; valid: 1 to 6"),
        ({"length": 7}, "length = 7; valid: 1 to 6"),
        ({"most_tries": 0}, "most_tries = 0; valid: an integer >= 1"),
        ({"rounds": -1}, "rounds = -1; valid: 0 to 10000"),
        ({"rounds": 10**18}, "rounds = 1000000000000000000; valid: 0 to 10000"),
        ({"impatience": -0.5}, "impatience = -0.5; valid: a number >= 0"),
        ({"impatience": float("nan")}, "impatience = nan; valid: a number >= 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(PlanningError) as refused:
        MultiStepConfig(**settings)
    assert str(refused.value) == f"multi-step pibt: {said}"


def test_tables_of_another_graph_are_refused() -> None:
    other = open_grid(2, 2)
    with pytest.raises(PlanningError, match="another graph"):
        MultiStepPibt().plan(instance_of(open_grid(2, 2), [0], [3]), DistanceTable(other, np.zeros(4, dtype=np.bool_)))


@pytest.mark.parametrize("seed", range(5))
def test_nobody_goes_on_before_it_has_come_to_its_start(seed: int) -> None:
    instance = crowd("one_way", 0.4, seed, allow_rotation=False)
    comes = np.random.default_rng(seed).integers(5, size=instance.n_agents)
    plan = MultiStepPibt().plan(replace(instance, comes=comes))
    for agent, timestep in enumerate(comes):
        assert (plan.states[: timestep + 1, agent] == instance.starts[agent]).all()
    assert breaches(instance, plan) == []
    assert (plan.states[5:] != instance.starts).any()


def test_who_may_be_pushed_makes_room_where_somebody_gets_nowhere_for_long() -> None:
    """Agent 0 wants to rest in the cell in the middle, agent 1 to stay there; window after window begins alike."""
    instance = instance_of(open_grid(1, 3), [0, 2], [1, 1], priorities=[10.0, 1.0], stay=[False, True], horizon=1)
    planner, first = MultiStepPibt(seed=0), []
    for _ in range(2 * (STUCK_WINDOWS + RELEASE_WINDOWS)):
        first.append(planner.plan(instance).states[1].tolist())
    assert first == 2 * ([[1, 2]] * STUCK_WINDOWS + [[0, 1]] * RELEASE_WINDOWS)


def test_who_is_there_already_does_not_wait_for_one_who_is_still_coming() -> None:
    """Two lanes cross in a cell, and the agent with the right of way comes to it much later."""
    crossing = graph_of([0, 1, 2, 3, 1, 4], [(0, 1), (1, 2), (3, 4), (4, 5)])
    instance = instance_of(crossing, [0, 3], [2, 5], priorities=[2.0, 1.0], horizon=8)
    assert arrivals(instance) == [2, 3]
    assert arrivals(replace(instance, comes=np.array([4, 0]))) == [6, 2]


def arrivals(instance: Instance) -> list[int]:
    """First row of the plan in which each agent is at its goal."""
    there: list[int] = (MultiStepPibt().plan(instance).states == instance.goals).argmax(axis=0).tolist()
    return there


@pytest.mark.parametrize(
    ("name", "length"), [("pebble", 1), ("pebble", 4), ("rotating", 2), ("rotating", 5), ("one_way", 5), ("wide", 2)]
)
@pytest.mark.parametrize("rounds", [0, 2])
def test_operations_of_any_length_make_legal_plans(name: str, length: int, rounds: int) -> None:
    planner = MultiStepPibt(MultiStepConfig(length=length, rounds=rounds))
    for seed, share in enumerate((0.3, 0.7, 0.95)):
        instance = crowd(name, share, seed, allow_rotation=seed == 1)
        assert breaches(instance, planner.plan(instance)) == []


def test_the_referee_would_see_a_search_that_looks_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """A planted fault: after each timestep one agent is put where another one stands."""

    def careless(ops: Any, choices: Any, costs: Any, wishes: Any, after: Any) -> None:
        first_states(ops, choices, costs, wishes, after)
        after[0] = after[1]

    first_states = multi_step_kernel.first_states
    instance = crowd("pebble", 0.5, 0, allow_rotation=False, horizon=1)
    step_by_step = MultiStepConfig(rounds=1)
    assert breaches(instance, MultiStepPibt(step_by_step).plan(instance)) == []
    monkeypatch.setattr(multi_step_kernel, "first_states", careless)
    assert breaches(instance, MultiStepPibt(step_by_step).plan(instance)) != []


@pytest.mark.parametrize("name", ["pebble", "one_way", "wide"])
def test_a_window_is_planned_at_once_as_it_is_step_by_step(name: str) -> None:
    """Where the clock counts, timesteps are decided one by one."""
    at_once, step_by_step = MultiStepPibt(seed=3), MultiStepPibt(seed=3)
    for seed, share in enumerate((0.3, 0.7, 0.95)):
        instance = crowd(name, share, seed, allow_rotation=seed == 1)
        instance = replace(instance, comes=np.arange(instance.n_agents) % 4)
        plan = at_once.plan(instance, deadline=Deadline(1000))
        assert np.array_equal(plan.states, step_by_step.plan(instance, deadline=Deadline(wall_s=1e6)).states)
        assert len(at_once.plan(instance, deadline=Deadline(2)).states) == 3
        step_by_step.plan(instance, deadline=Deadline(2, wall_s=1e6))


@pytest.mark.parametrize("length", [1, 3])
def test_a_closed_ring_turns_only_where_that_is_legal(length: int) -> None:
    planner = MultiStepPibt(MultiStepConfig(length=length))
    for allowed in (True, False):
        instance = instance_of(one_way_loop(5), [0, 1, 2, 3, 4], [1, 2, 3, 4, 0], allow_rotation=allowed, horizon=3)
        plan = planner.plan(instance)
        assert breaches(instance, plan) == []
        assert reached(instance, plan).all() == allowed
        assert (plan.states == plan.states[0]).all() == (not allowed)


@pytest.mark.parametrize("name", GRAPHS)
def test_agents_that_may_not_move_stay_where_they_are(name: str) -> None:
    for seed in range(4):
        instance = crowd(name, 0.8, seed, allow_rotation=True)
        instance.fixed[1] = True
        plan = MultiStepPibt(seed=seed).plan(instance)
        assert (plan.states[:, instance.fixed] == instance.starts[instance.fixed]).all()
        for agent in np.flatnonzero(instance.stay):
            at_goal = plan.states[:, agent] == instance.goals[agent]
            assert at_goal[at_goal.argmax() :].all() or not at_goal.any()


def test_an_agent_about_to_move_can_be_locked_and_moves_again_later() -> None:
    """What is left of operations from the window before must not carry a fixed agent on."""
    graph = open_grid(1, 8)
    planner = MultiStepPibt()
    states = np.array([0, 3], dtype=np.int32)
    for window, fixed in enumerate([False, True, False]):
        instance = instance_of(graph, states.tolist(), [4, 7], fixed=[False, fixed], horizon=2)
        plan = planner.plan(instance)
        assert breaches(instance, plan) == []
        assert plan.states[-1, 1] - states[1] == (0 if fixed else 2), window
        states = plan.states[-1]


def test_a_robot_that_must_turn_first_is_out_of_the_way_in_time() -> None:
    """It stands across a corridor and turns while the other one is still coming: nobody waits."""
    graph = rotating_grid(1, 6)
    starts = [int(graph.state_at(0, EAST)), int(graph.state_at(2, NORTH))]
    instance = instance_of(graph, starts, [int(graph.state_at(4, EAST)), NO_GOAL], horizon=4)
    plan = MultiStepPibt().plan(instance)
    assert breaches(instance, plan) == []
    assert graph.state_cell[plan.states[:, 0]].tolist() == [0, 1, 2, 3, 4]


def test_rounds_of_improvement_cost_nothing_and_gain() -> None:
    """On a crowded floor they leave the agents nearer to their goals, all in all."""
    left = {0: 0, 6: 0}
    for seed in range(12):
        instance = crowd("rotating", 0.6, seed, allow_rotation=True, horizon=10)
        tables = DistanceTable(instance.graph, instance.blocked)
        table, row = tables.rows(instance.goals)
        for rounds in left:
            plan = MultiStepPibt(MultiStepConfig(rounds=rounds), seed=seed).plan(instance, tables)
            assert breaches(instance, plan) == []
            left[rounds] += int(table[row, plan.states].astype(np.int64).sum())
    assert left[6] < left[0]


def test_the_same_seed_gives_the_same_plans_window_after_window() -> None:
    def windows(seed: int) -> list[list[int]]:
        planner = MultiStepPibt(MultiStepConfig(rounds=1), seed=seed)
        return [
            planner.plan(crowd("rotating", 0.5, number, allow_rotation=False)).states.ravel().tolist()
            for number in range(3)
        ]

    assert windows(3) == windows(3) != windows(4)


def test_cars_on_a_site_reach_their_docks(small_site: Site) -> None:
    graph = build_lane_graph(small_site)
    docks = [int(graph.state_at(station.dock.cell, station.dock.heading)) for station in small_site.stations]
    starts = [int(graph.states_of_cell(cell)[0]) for cell in small_site.parking]
    n = min(len(docks), len(starts))
    instance = instance_of(graph, starts[:n], docks[:n], horizon=150)
    plan = MultiStepPibt().plan(instance)
    assert breaches(instance, plan) == []
    assert reached(instance, plan).all()


def test_a_deadline_ends_the_window_after_so_many_timesteps() -> None:
    instance = crowd("one_way", 0.5, 0, allow_rotation=False)
    planner = MultiStepPibt()
    plan = planner.plan(instance, deadline=Deadline(4))
    assert (len(plan.states), plan.iterations) == (5, 4)
    assert plan.status is Status.TIMEOUT
    assert breaches(instance, plan) == []


def test_a_move_is_not_open_into_a_blocked_cell_and_nobody_goes_there() -> None:
    instance = instance_of(open_grid(2, 3), [0, 5], [2, 3], blocked=[1])
    assert not open_moves(instance.graph, instance.blocked)[instance.graph.move_to == 1].any()
    plan = MultiStepPibt().plan(instance)
    assert breaches(instance, plan) == []
    assert 1 not in plan.states


def test_weights_fall_with_the_place_in_the_order() -> None:
    weight = rank_weights(np.array([2, 0, 1], dtype=np.int32))
    assert weight[2] == 1.0
    assert weight[2] > weight[0] > weight[1] > 0
    assert rank_weights(np.empty(0, dtype=np.int32)).size == 0


def test_a_wide_sweep_keeps_others_off_the_corner() -> None:
    """Agent 0 cuts the corner on which agent 1 stands: it waits until the other one is gone."""
    graph = graph_of(range(4), [(0, 2), (1, 3)], sweeps={(0, 2): (1,)})
    instance = instance_of(graph, [0, 1], [2, 3], priorities=[1.0, 0.0], horizon=4)
    plan = MultiStepPibt().plan(instance)
    assert breaches(instance, plan) == []
    assert plan.states[:3].tolist() == [[0, 1], [0, 3], [2, 3]]


def test_a_fleet_with_more_goals_than_fit_looks_up_those_of_agents_on_their_way() -> None:
    instance = crowd("one_way", 0.5, 0, allow_rotation=False)
    at_goals = np.where(np.arange(instance.n_agents) % 2, instance.goals, instance.starts).astype(np.int32)
    instance = replace(instance, goals=at_goals, stay=np.zeros(instance.n_agents, dtype=np.bool_))
    cap = 2 * instance.graph.n_states * (instance.n_agents * 3 // 4)
    tables = DistanceTable(instance.graph, instance.blocked, memory_cap=cap)
    plan = MultiStepPibt(seed=1).plan(instance, tables)
    assert breaches(instance, plan) == []
    assert tables.n_goals <= instance.n_agents // 2 + 1


def test_who_has_no_goal_does_not_depend_on_what_the_tables_memory_holds() -> None:
    """Row -1 of the table was taken for theirs: what nobody had filled decided who was stuck."""
    assert wanderings(0) == wanderings(7)


def wanderings(memory: int) -> list[list[int]]:
    """Where twelve agents come to, three of them without goals, where the last row of the table holds a number."""
    graph, n, rng = open_grid(6, 9), 12, np.random.default_rng(1)
    starts, goals = np.array(random_starts(graph, n, rng)), rng.integers(50, size=n).astype(np.int32)
    goals[:3] = NO_GOAL
    tables, planner, came = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_)), MultiStepPibt(seed=0), []
    tables._rows[-1] = memory
    stay, priorities = (np.arange(n) % 2 == 0).tolist(), np.arange(n, dtype=np.float64).tolist()
    for _ in range(STUCK_WINDOWS + RELEASE_WINDOWS):
        instance = instance_of(
            graph, starts.tolist(), goals.tolist(), priorities=priorities, stay=stay, allow_rotation=False, horizon=3
        )
        starts = planner.plan(instance, tables).states[-1]
        came.append(starts.tolist())
        there = starts == goals
        goals[there] = rng.integers(50, size=there.sum())
    return came
