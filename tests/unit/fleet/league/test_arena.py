"""The rules: what a timestep does to robots and tasks, and what is no timestep at all."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.league.arena import NO_TASK, Arena
from maps.formats.lorr import CLOCKWISE, COUNTER_CLOCKWISE, FORWARD, NO_ACTION, WAIT
from maps.grid import EAST, NORTH, SOUTH, WEST
from tests.unit.fleet.league.problems import CORRIDOR, ROOM, problem_of


def at(arena: Arena, *places: tuple[int, int]) -> np.ndarray:
    """States of cells and headings."""
    return np.array([arena.graph.state_at(cell, heading) for cell, heading in places], dtype=np.int32)


def run_east(arena: Arena, timesteps: int, task: int) -> None:
    """Let a single robot drive on along row 0."""
    for _ in range(timesteps):
        cell = int(arena.graph.state_cell[arena.states[0]])
        arena.apply(at(arena, (cell + 1, EAST)), np.array([task]))


def test_robots_start_heading_east_without_a_task() -> None:
    arena = Arena(problem_of(CORRIDOR, [0, 3], [[4], [9]]))
    assert arena.states.tolist() == at(arena, (0, EAST), (3, EAST)).tolist()
    assert arena.task_of.tolist() == [NO_TASK, NO_TASK]
    assert arena.errand_of.tolist() == [0, 0]
    assert arena.next_cell(arena.task_of).tolist() == [-1, -1]
    assert (arena.timestep, arena.n_finished) == (0, 0)


def test_errands_are_done_in_order_and_a_finished_task_makes_room_for_the_next() -> None:
    arena = Arena(problem_of(CORRIDOR, [0], [[1, 3], [2], [4]], pool_size=2))
    assert arena.pool().tolist() == [0, 1]
    arena.apply(at(arena, (1, EAST)), np.array([0]))
    assert (arena.task_of.tolist(), arena.errand_of.tolist()) == ([0], [1])
    assert arena.next_cell(arena.task_of).tolist() == [3]
    assert arena.pool().tolist() == [1]
    arena.apply(at(arena, (2, EAST)), np.array([0]))
    assert arena.n_finished == 0
    arena.apply(at(arena, (3, EAST)), np.array([0]))
    assert (arena.n_finished, arena.timestep) == (1, 3)
    assert (arena.task_of.tolist(), arena.errand_of.tolist()) == ([NO_TASK], [0])
    assert arena.pool().tolist() == [1, 2]
    result = arena.result(np.zeros(3))
    assert result.events.tolist() == [[1, 0, 0, 1], [3, 0, 0, 2]]
    assert result.schedule.tolist() == [[1, 0, 0]]
    assert (result.task_id.tolist(), result.task_release.tolist()) == ([0, 1, 2], [0, 0, 3])
    assert result.makespan == 3


def test_one_errand_a_timestep_even_where_the_robot_stands() -> None:
    arena = Arena(problem_of(CORRIDOR, [0], [[0, 0]]))
    arena.apply(arena.states, np.array([0]))
    assert (arena.errand_of.tolist(), arena.n_finished) == ([1], 0)
    arena.apply(arena.states, np.array([0]))
    assert arena.n_finished == 1


def test_tasks_of_the_file_come_again_under_new_numbers() -> None:
    arena = Arena(problem_of(CORRIDOR, [0], [[1], [2]], pool_size=3))
    assert arena.pool().tolist() == [0, 1, 2]
    run_east(arena, 1, task=2)
    assert arena.n_finished == 1
    assert arena.pool().tolist() == [0, 1, 3]


def test_more_tasks_than_there_was_room_for_at_first_have_room() -> None:
    arena = Arena(problem_of(CORRIDOR, [0], [[0]], pool_size=1))
    for task in range(1500):
        assert arena.pool().tolist() == [task]
        arena.apply(arena.states, arena.pool())
    assert (arena.n_finished, arena.schedule_errors) == (1500, [])


def test_an_unopened_task_may_change_hands() -> None:
    arena = Arena(problem_of(ROOM, [0, 5], [[35], [30]]))
    arena.apply(arena.states, np.array([0, 1]))
    assert arena.pool().tolist() == [0, 1]
    arena.apply(arena.states, np.array([1, 0]))
    arena.apply(arena.states, np.array([NO_TASK, 0]))
    assert arena.task_of.tolist() == [NO_TASK, 0]
    assert arena.schedule_errors == []
    assert arena.result(np.zeros(3)).schedule.tolist() == [[1, 0, 0], [1, 1, 1], [2, 0, 1], [2, 1, 0], [3, 0, -1]]


def test_every_robot_s_schedule_begins_even_if_it_gets_nothing() -> None:
    """The League's viewer reads no empty schedule."""
    arena = Arena(problem_of(ROOM, [0, 5], [[35]]))
    for _ in range(2):
        arena.apply(arena.states, np.full(2, NO_TASK))
    result = arena.result(np.zeros(2))
    assert result.schedule.tolist() == result.proposed.tolist() == [[1, 0, NO_TASK], [1, 1, NO_TASK]]


@pytest.mark.parametrize(
    ("schedule", "error"),
    [
        ([2, 1], (2, 0, -1, 2, "task already finished")),
        ([99999, 1], (99999, 0, -1, 2, "task already finished")),
        ([-7, 1], (-7, 0, -1, 2, "task already finished")),
        ([0, 0], (0, 1, 0, 2, "task is already assigned by the second agent at the same time")),
        ([0, NO_TASK], (NO_TASK, 1, 1, 2, "task is already opened by the second agent")),
        ([1, 3], (3, 1, 1, 2, "task is already opened by the second agent")),
        ([0], (-1, -1, -1, 2, "Invalid schedule size")),
        ([0.0, 1.0], (-1, -1, -1, 2, "Invalid schedule size")),
    ],
)
def test_a_schedule_with_an_error_is_counted_and_changes_nothing(
    schedule: list[int], error: tuple[int, int, int, int, str]
) -> None:
    """Robot 1 has opened task 1, and task 2 is not known any more."""
    arena = Arena(problem_of(ROOM, [0, 5, 30], [[35], [5, 0], [30], [20]]))
    arena.apply(arena.states, np.array([0, 1, 2]))
    assert arena.n_finished == 1
    wanted = np.array([*schedule, NO_TASK]) if len(schedule) > 1 else np.array(schedule)
    arena.apply(arena.states, wanted)
    assert arena.schedule_errors == [error]
    assert arena.task_of.tolist() == [0, 1, NO_TASK]
    assert arena.planner_errors == []


def test_a_task_is_finished_even_if_the_schedule_of_that_timestep_has_an_error() -> None:
    arena = Arena(problem_of(CORRIDOR, [0], [[2]]))
    run_east(arena, 1, task=0)
    run_east(arena, 1, task=77)
    assert (arena.n_finished, len(arena.schedule_errors)) == (1, 1)


@pytest.mark.parametrize(
    ("starts", "moves", "error"),
    [
        ([0, 2], [(1, EAST), (1, EAST)], (1, -1, 1, "unallowed move")),
        ([0, 1], [(1, EAST), (1, EAST)], (1, 0, 1, "vertex conflict")),
        ([0, 5], [(2, EAST), (5, EAST)], (0, -1, 1, "unallowed move")),
        ([0, 5], [(0, WEST), (5, EAST)], (0, -1, 1, "unallowed move")),
        ([0, 5], [(0, EAST), (6, EAST)], (1, -1, 1, "unallowed move")),
        ([0, 1], [(0, EAST)], (-1, -1, 1, "incorrect vector size")),
    ],
)
def test_a_move_with_an_error_is_counted_and_nobody_moves(
    starts: list[int], moves: list[tuple[int, int]], error: tuple[int, int, int, str]
) -> None:
    arena = Arena(problem_of(ROOM, starts, [[35]]))
    before = arena.states.tolist()
    arena.apply(at(arena, *moves), np.full(2, NO_TASK))
    assert arena.planner_errors == [error]
    assert arena.states.tolist() == before
    assert (arena.timestep, arena.result(np.zeros(1)).actual.tolist()) == (1, [[WAIT, WAIT]])


def test_a_state_that_does_not_exist_is_an_unallowed_move() -> None:
    for state in (-1, 10**9, 2**40):
        arena = Arena(problem_of(ROOM, [0], [[35]]))
        arena.apply(np.array([state]), np.array([0]))
        assert arena.planner_errors == [(0, -1, 1, "unallowed move")]
        assert arena.result(np.zeros(1)).planned.tolist() == [[NO_ACTION]]


def test_two_robots_may_not_swap_cells() -> None:
    arena = Arena(problem_of(ROOM, [0, 1], [[35]]))
    free = np.full(2, NO_TASK)
    for heading in (NORTH, WEST):
        arena.apply(at(arena, (0, EAST), (1, heading)), free)
    assert arena.planner_errors == []
    arena.apply(at(arena, (1, EAST), (0, WEST)), free)
    assert arena.planner_errors == [(1, 0, 3, "edge conflict")]
    arena.apply(at(arena, (0, EAST), (1, WEST)), free)
    assert len(arena.planner_errors) == 1


def test_robots_may_follow_each_other_in_a_closed_ring() -> None:
    """Cells 0, 1, 7, 6 of the room, driven clockwise."""
    arena = Arena(problem_of(ROOM, [0, 1, 7, 6], [[35]]))
    free = np.full(4, NO_TASK)
    arena.apply(at(arena, (0, EAST), (1, SOUTH), (7, SOUTH), (6, NORTH)), free)
    arena.apply(at(arena, (0, EAST), (1, SOUTH), (7, WEST), (6, NORTH)), free)
    arena.apply(at(arena, (1, EAST), (7, SOUTH), (6, WEST), (0, NORTH)), free)
    assert arena.planner_errors == []
    assert arena.result(np.zeros(3)).actual.tolist() == [
        [WAIT, CLOCKWISE, CLOCKWISE, COUNTER_CLOCKWISE],
        [WAIT, WAIT, CLOCKWISE, WAIT],
        [FORWARD] * 4,
    ]


def test_after_an_error_the_next_timestep_is_judged_afresh() -> None:
    arena = Arena(problem_of(ROOM, [0, 1, 2], [[35]]))
    free = np.full(3, NO_TASK)
    arena.apply(at(arena, (1, EAST), (2, EAST), (2, EAST)), free)
    assert arena.planner_errors == [(2, 1, 1, "vertex conflict")]
    arena.apply(at(arena, (1, EAST), (2, EAST), (3, EAST)), free)
    assert len(arena.planner_errors) == 1
    assert arena.states.tolist() == at(arena, (1, EAST), (2, EAST), (3, EAST)).tolist()


def test_idle_timesteps_are_timeouts_and_count_no_errand() -> None:
    arena = Arena(problem_of(CORRIDOR, [0], [[0]]))
    arena.idle(2)
    assert (arena.timestep, arena.n_timeouts, arena.n_finished) == (2, 2, 0)
    arena.apply(arena.states, np.array([0]))
    result = arena.result(np.zeros(1))
    assert result.actual.tolist() == result.planned.tolist() == [[NO_ACTION], [NO_ACTION], [WAIT]]
    assert result.events.tolist() == [[3, 0, 0, 1]]


def test_what_was_handed_out_does_not_change_later() -> None:
    arena = Arena(problem_of(CORRIDOR, [0], [[1, 2], [3]], pool_size=2))
    held = (arena.states, arena.task_of, arena.errand_of, arena.pool())
    before = [array.tolist() for array in held]
    run_east(arena, 3, task=0)
    assert [array.tolist() for array in held] == before


def test_scribbling_over_what_was_handed_out_changes_nothing() -> None:
    """Robot 0 has opened task 0: an arena that trusted its readers would let it go."""
    arena = Arena(problem_of(CORRIDOR, [0, 3], [[1, 2], [3]]))
    arena.apply(at(arena, (1, EAST), (3, EAST)), np.array([0, NO_TASK]))
    for array in (arena.states, arena.task_of, arena.errand_of, arena.pool(), arena.next_cell(arena.task_of)):
        array[:] = 0
    arena.apply(at(arena, (2, EAST), (3, EAST)), np.array([NO_TASK, 1]))
    assert arena.schedule_errors == [(NO_TASK, 0, 0, 2, "task is already opened by the second agent")]
    assert (arena.planner_errors, arena.n_finished) == ([], 1)


def test_what_was_handed_in_is_neither_kept_nor_changed() -> None:
    arena = Arena(problem_of(CORRIDOR, [0], [[1, 2]]))
    states, tasks = at(arena, (1, EAST)), np.array([0])
    arena.apply(states, tasks)
    assert (states.tolist(), tasks.tolist()) == (at(arena, (1, EAST)).tolist(), [0])
    states[:], tasks[:] = 0, 9
    assert (arena.states.tolist(), arena.task_of.tolist()) == (at(arena, (1, EAST)).tolist(), [0])


def test_in_2023_the_league_hands_out_the_tasks_in_turn() -> None:
    arena = Arena(problem_of(ROOM, [0, 5], [[1], [5], [2]], round_robin=True))
    assert arena.task_of.tolist() == [0, 1]
    assert arena.next_cell(arena.task_of).tolist() == [1, 5]
    nonsense = np.array([77, 77])
    arena.apply(at(arena, (1, EAST), (5, EAST)), nonsense)
    assert arena.task_of.tolist() == [2, 3]
    assert arena.next_cell(arena.task_of).tolist() == [2, 1]
    arena.apply(at(arena, (2, EAST), (5, EAST)), nonsense)
    assert arena.task_of.tolist() == [4, 3]
    assert (arena.n_finished, arena.schedule_errors) == (3, [])
    result = arena.result(np.zeros(2))
    assert result.schedule.tolist() == [[1, 0, 0], [1, 1, 1], [2, 0, 2], [2, 1, 3]]
    assert result.events.tolist() == [[1, 0, 0, 1], [1, 1, 1, 1], [2, 0, 2, 1]]
    assert result.task_release.tolist() == [0, 0, 1, 1, 2]


def test_a_result_may_be_asked_for_before_the_first_timestep() -> None:
    result = Arena(problem_of(CORRIDOR, [0, 1], [[4]])).result(np.zeros(0))
    assert (result.actual.shape, len(result.events), result.makespan) == ((0, 2), 0, 0)
