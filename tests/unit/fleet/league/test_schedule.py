"""TaskSchedule: the cheapest pair first, opened tasks stay, and nobody gets what another one has."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fleet.league import schedule as schedule_module
from fleet.league.arena import NO_TASK, Arena
from fleet.league.schedule import TaskSchedule
from maps.formats.lorr import LeagueProblem
from maps.grid import EAST
from maps.lane_graph import grid_lane_graph
from planners.mapf.arrays import IntArray
from planners.mapf.multi_step.goal_costs import GoalCosts, left
from planners.mapf.multi_step.multi_step_kernel import Costs
from tests.unit.fleet.league.problems import CORRIDOR, ROOM, problem_of, random_problem


@pytest.fixture(autouse=True, params=[0, 10_000], ids=["greedy", "exact"])
def _exact_pairs(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of this holds for both ways to choose."""
    monkeypatch.setattr(schedule_module, "_EXACT_PAIRS", request.param)


def begin(problem: LeagueProblem) -> tuple[Arena, TaskSchedule]:
    arena = Arena(problem)
    costs = GoalCosts(arena.graph, grid_lane_graph(problem.grid, "pebble"))
    return arena, TaskSchedule(arena, costs)


def test_what_is_left_of_a_task_is_the_way_from_errand_to_errand() -> None:
    """In the first task east, on east, and back round the corridor; the second has a single errand."""
    arena, schedule = begin(problem_of(CORRIDOR, [0], [[0, 2, 4, 10], [3], [1, 1]]))
    schedule.learn(arena, arena.pool())
    back = 1 + 1 + 1 + 4  # south twice, one turn, west four times
    assert schedule.onward_of.tolist() == [2, 2, back, 0, 0, 0, 0]
    assert schedule.rest_of.tolist() == [4 + back, 2 + back, back, 0, 0, 0, 0]


def test_what_is_left_of_tasks_that_are_not_known_yet_is_not_looked_at() -> None:
    arena, schedule = begin(problem_of(ROOM, [0], [[0, 5], [3, 4]], pool_size=1))
    schedule.learn(arena, arena.pool())
    assert schedule.onward_of.tolist() == [5, 0, -1, -1]


def test_tasks_are_learnt_one_after_the_other_or_together() -> None:
    problem = random_problem(2)
    arena, together = begin(problem)
    _, apart = begin(problem)
    together.learn(arena, arena.pool())
    for task in arena.pool():
        apart.learn(arena, np.array([task]))
    assert together.onward_of.tolist() == apart.onward_of.tolist()
    assert together.rest_of.tolist() == apart.rest_of.tolist()


def test_the_cheapest_pair_comes_first() -> None:
    """Both want the task at cell 3; robot 1 is nearer, and robot 0 takes what is left."""
    arena, schedule = begin(problem_of(ROOM, [0, 2], [[3], [30]]))
    assert schedule.assign(arena).tolist() == [1, 0]


def test_few_pairs_are_shared_out_at_least_cost(request: pytest.FixtureRequest) -> None:
    """From west to east task 1, robot 1, task 0, robot 0: robot 1 faces task 0, and robot 0 would have to pass it."""
    arena, schedule = begin(problem_of(ROOM, [4, 1], [[3], [0]]))
    assert schedule.assign(arena).tolist() == ([1, 0] if "greedy" in request.node.name else [0, 1])


def test_a_short_task_goes_before_a_long_one_at_the_same_place() -> None:
    arena, schedule = begin(problem_of(ROOM, [0], [[3, 30, 5], [3, 4]]))
    assert schedule.assign(arena).tolist() == [1]


def test_a_task_with_an_errand_in_a_crowd_waits_for_others() -> None:
    arena, schedule = begin(problem_of(ROOM, [0], [[3, 5], [3, 4]]))
    delay = np.zeros(arena.graph.n_cells, dtype=np.int32)
    assert schedule.assign(arena, delay=delay).tolist() == [1]
    delay[4] = 50
    assert schedule.assign(arena, delay=delay).tolist() == [0]


def test_a_task_that_is_opened_stays_and_one_that_is_not_may_change_hands() -> None:
    """Robot 0 has opened its long task; robot 1 was on its way to task 1, which robot 0 could not take anyway."""
    arena, schedule = begin(problem_of(ROOM, [0, 35], [[1, 30, 5, 30], [2], [34]]))
    arena.apply(arena.graph.state_index[[1, 35], EAST], np.array([0, 1]))
    assert arena.errand_of.tolist() == [1, 0]
    assert schedule.assign(arena).tolist() == [0, 2]


def test_with_more_robots_than_tasks_the_nearest_ones_work() -> None:
    arena, schedule = begin(problem_of(ROOM, [0, 4, 30, 35], [[5], [29]]))
    assert schedule.assign(arena).tolist() == [NO_TASK, 0, NO_TASK, 1]


def test_with_more_tasks_than_a_shortlist_everybody_gets_one() -> None:
    """All robots have the same shortlist, and are more than it is long."""
    tasks = [[6 * row + 5] for row in range(6)] * 5
    arena, schedule = begin(problem_of(ROOM, list(range(20)), tasks))
    task_of = schedule.assign(arena)
    assert NO_TASK not in task_of
    assert len(set(task_of.tolist())) == 20


@pytest.mark.parametrize(("most_pairs", "first"), [(0, 0), (10_000, 2)], ids=["in turn", "all"])
def test_in_a_large_fleet_a_task_that_waits_goes_before_a_shorter_one(
    most_pairs: int, first: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three tasks begin at the same place; the first one is longest, but two others are known since."""
    monkeypatch.setattr(schedule_module, "_MOST_PAIRS", most_pairs)
    arena, schedule = begin(problem_of(ROOM, [0], [[3, 35], [3, 34], [3, 33]], pool_size=3))
    assert schedule.assign(arena).tolist() == [first]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("most_pairs", [150_000, 40])
def test_every_task_has_one_robot_however_few_are_asked(
    seed: int, most_pairs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Robots move at random; the rules of the arena judge the schedules."""
    monkeypatch.setattr(schedule_module, "_MOST_PAIRS", most_pairs)
    arena, schedule = begin(random_problem(seed))
    rng = np.random.default_rng(seed)
    for timestep in range(60):
        task_of = schedule.assign(arena, everybody=timestep == 0)
        assert task_of.shape == arena.task_of.shape
        busy = task_of[task_of != NO_TASK]
        assert len(set(busy.tolist())) == len(busy)
        opened = arena.errand_of > 0
        assert (task_of[opened] == arena.task_of[opened]).all()
        assert NO_TASK not in task_of  # there are always more tasks than robots
        states = arena.states.copy()
        robot = int(rng.integers(len(states)))
        moves = arena.graph.out_move[arena.graph.out_ptr[states[robot]] : arena.graph.out_ptr[states[robot] + 1]]
        to = int(arena.graph.move_to[rng.choice(moves)])
        others = np.delete(arena.graph.state_cell[states], robot)
        if arena.graph.state_cell[to] not in others:
            states[robot] = to
        arena.apply(states, task_of)
    assert arena.schedule_errors == []
    assert arena.planner_errors == []


def test_robots_are_offered_their_cheapest_tasks_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of equal costs, of which there are many on a small floor, the earlier task comes first."""
    monkeypatch.setattr(schedule_module, "_EXACT_PAIRS", 0)
    arena, schedule = begin(random_problem(3))
    kernel, n_offers = schedule_module._shortlist, 0

    def checked(costs: Costs, states: IntArray, rows: IntArray, length: IntArray, *more: Any) -> None:
        nonlocal n_offers
        kernel(costs, states, rows, length, *more)
        best, key = more[-2:]
        for robot, state in enumerate(states):
            ways = left(costs, np.full(len(rows), state), rows)
            values = schedule_module._HASTE * ways.astype(np.int64) + length
            order = np.argsort(values, kind="stable")[: best.shape[1]]
            assert best[robot].tolist() == order.tolist()
            assert key[robot].tolist() == values[order].tolist()
            n_offers += len(order)

    monkeypatch.setattr(schedule_module, "_shortlist", checked)
    schedule.assign(arena, everybody=True)
    assert n_offers > 100
