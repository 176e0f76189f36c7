"""The arena of 2026: actions take ticks, squares do not overlap, and schedules are put right robot by robot."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.errors import FleetError
from fleet.league.rules import NO_TASK
from fleet.league.ticks.tick_arena import TickArena
from maps.formats.lorr import LETTERS, Actions
from tests.unit.fleet.league.problems import CORRIDOR, ROOM, in_ticks, problem_of

TASKS = [[35], [30], [5]]


def arena_of(starts: list[int], *, per_action: int = 3, size: float = 1.0, floor: list[str] = ROOM) -> TickArena:
    return TickArena(in_ticks(problem_of(floor, starts, [[4]]), per_action=per_action, size=size))


def act(letters: str) -> Actions:
    return np.array([LETTERS.index(letter) for letter in letters], dtype=np.int8)


def drive(arena: TickArena, *rows: str) -> list[int]:
    """Let ticks pass; returns the robots' cells."""
    for row in rows:
        arena.apply(act(row))
    return arena.graph.state_cell[arena.states].tolist()


def test_an_action_takes_its_ticks_and_waits_do_not_undo_it() -> None:
    arena = arena_of([0])
    assert drive(arena, "F", "F") == [0]
    assert arena.under_way.tolist() == [2]
    assert drive(arena, "W", "W") == [0]
    assert arena.apply(act("F")).tolist() == [True]
    assert drive(arena) == [1]
    assert arena.under_way.tolist() == [0]


def test_an_action_under_way_is_carried_on_whatever_is_said() -> None:
    arena = arena_of([7])
    assert drive(arena, "C", "F", "R") == [7]
    assert drive(arena, "F", "F", "F") == [1], "the turn to the north was finished"


def test_a_problem_of_another_year_has_no_ticks() -> None:
    with pytest.raises(FleetError, match="tiny is played in timesteps; valid: a problem of 2026"):
        TickArena(problem_of(ROOM, [0], [[4]]))


def test_a_line_drives_as_one() -> None:
    assert drive(arena_of([2, 1, 0]), "FFF", "FFF", "FFF") == [3, 2, 1]
    assert drive(arena_of([0, 1, 2]), "FFF", "FFF", "FFF") == [1, 2, 3]


def test_a_line_waits_for_a_leader_that_stands() -> None:
    arena = arena_of([2, 1, 0])
    assert drive(arena, "WFF", "FFF", "FFF", "FFF") == [3, 2, 1]
    assert drive(arena, "WFF", "WFF", "WFF") == [3, 2, 1]


def test_a_gap_that_a_delay_leaves_may_be_used() -> None:
    """The follower starts late, and drives on while the leader stands half way out."""
    arena = arena_of([1, 0])
    assert drive(arena, "FW", "FW", "WF", "WF", "WF") == [1, 0]
    assert arena.under_way.tolist() == [2, 2], "not beyond what the leader has left"


@pytest.mark.parametrize(("size", "waits"), [(1.0, 2), (0.5, 0)])
def test_round_a_corner_a_square_waits_until_the_other_is_out(size: float, waits: int) -> None:
    """Robot 0 leaves cell 7 to the east; robot 1 comes into it from the north."""
    arena = arena_of([7, 1], size=size, per_action=2)
    drive(arena, "WR", "WR")
    drive(arena, *["FF"] * waits)
    assert arena.under_way[1] == 0
    drive(arena, "FF")
    assert arena.under_way[1] == 1


def test_two_that_want_one_cell_stop_half_way() -> None:
    """Nobody keeps an order here: both begin while there is room, and stand face to face for ever."""
    arena = arena_of([0, 2])
    drive(arena, *["WR"] * 6)
    assert drive(arena, *["FF"] * 9) == [0, 2]
    assert arena.under_way.tolist() == [2, 1]


def test_a_closed_ring_stands() -> None:
    arena = arena_of([0, 1, 7, 6])
    drive(arena, *["WRRC"] * 3, *["WWRW"] * 3)
    assert drive(arena, "FFFF") == [0, 1, 7, 6]
    assert arena.under_way.tolist() == [0, 0, 0, 0]


def test_nobody_drives_into_an_obstacle_or_off_the_floor() -> None:
    arena = arena_of([4, 0], floor=CORRIDOR)
    assert drive(arena, "FW", "FW", "FW") == [4, 0]
    drive(arena, *["WR"] * 3)
    assert drive(arena, *["WF"] * 3) == [4, 0]
    assert arena.result(np.zeros(0)).actual.any(axis=0).tolist() == [False, True]


def test_a_delayed_robot_stands_and_the_file_says_when() -> None:
    problem = in_ticks(problem_of(ROOM, [0], [[4]]), chance=1.0, shortest=4, longest=4)
    arena = TickArena(problem)
    assert drive(arena, *["F"] * 8) == [0]
    result = arena.result(np.zeros(0))
    assert result.ticked is not None
    assert result.ticked.delays.tolist() == [[0, 0, 4], [0, 4, 8]]
    assert not result.actual.any()


def test_an_errand_is_done_when_the_robot_is_all_the_way_there() -> None:
    arena = TickArena(in_ticks(problem_of(ROOM, [0], [[1, 2], [5]], pool_size=1)))
    arena.propose(np.array([0]))
    arena.assign()
    drive(arena, *["F"] * 6)
    result = arena.result(np.zeros(0))
    assert result.events.tolist() == [[3, 0, 0, 1], [6, 0, 0, 2]]
    assert (result.n_finished, result.makespan) == (1, 6)
    assert (result.task_id.tolist(), result.task_release.tolist()) == ([0, 1], [0, 6])


def test_who_finished_a_task_gets_none_from_the_schedule_before() -> None:
    arena = TickArena(in_ticks(problem_of(ROOM, [0, 30], [[1], [5], [35]])))
    arena.propose(np.array([0, 1]))
    arena.assign()
    arena.propose(np.array([0, 2]))
    drive(arena, *["FW"] * 3)
    arena.assign()
    assert arena.ledger.task_of.tolist() == [NO_TASK, 2]
    assert arena.schedule_errors == []


@pytest.mark.parametrize(
    ("wanted", "given", "said"),
    [
        ([2, 1], [2, 1], None),
        ([9, 1], [NO_TASK, 1], (9, 0, -1, "task already finished")),
        ([-7, 1], [NO_TASK, 1], (-7, 0, -1, "task already finished")),
        ([2, 2], [2, NO_TASK], (2, 1, 0, "task is already assigned by the second agent at the same time")),
        ([NO_TASK, 0], [NO_TASK, 0], None),
    ],
)
def test_a_schedule_is_put_right(wanted: list[int], given: list[int], said: tuple[int, int, int, str] | None) -> None:
    arena = TickArena(in_ticks(problem_of(ROOM, [0, 30], TASKS)))
    arena.propose(np.array([0, 1]))
    arena.assign()
    arena.propose(np.array(wanted))
    arena.assign()
    assert arena.ledger.task_of.tolist() == given
    assert [(*error[:3], error[4]) for error in arena.schedule_errors] == ([] if said is None else [said])


def test_an_opened_task_stays_with_its_robot() -> None:
    arena = TickArena(in_ticks(problem_of(ROOM, [0, 30], [[1, 5], [35]])))
    arena.propose(np.array([0, 1]))
    arena.assign()
    drive(arena, *["FW"] * 3)
    arena.propose(np.array([NO_TASK, 0]))
    arena.assign()
    assert arena.ledger.task_of.tolist() == [0, NO_TASK]
    assert [error[4] for error in arena.schedule_errors] == [
        "schedule agent to another task who is already opened a task",
        "task is already assigned by the second agent at the same time",
    ]
    arena.propose(np.array([0, 1]))
    arena.assign()
    assert arena.ledger.task_of.tolist() == [0, 1]
