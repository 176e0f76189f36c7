"""The referee of a run in ticks names what is wrong; faults planted in a legal run are seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fleet.errors import FleetError
from fleet.league.controller import PibtController
from fleet.league.ticks.play_ticks import play_ticks
from fleet.league.ticks.tick_referee import check_ticks
from maps.formats.lorr import FORWARD, LETTERS, LeagueResult
from maps.formats.lorr_2026 import TickedRun
from tests.unit.fleet.league.problems import CORRIDOR, ROOM, in_ticks, problem_of, random_problem

EMPTY = np.empty((0, 3), dtype=np.int32)


def result_of(
    starts: list[int],
    *paths: str,
    size: float = 1.0,
    per_action: int = 3,
    floor: list[str] = ROOM,
    delays: np.ndarray = EMPTY,
    tasks: list[list[int]] | None = None,
    events: list[list[int]] | None = None,
    schedule: list[list[int]] | None = None,
    n_finished: int = 0,
) -> LeagueResult:
    actual = np.array([[LETTERS.index(letter) for letter in path] for path in paths], dtype=np.int8).T
    return LeagueResult(
        problem=in_ticks(problem_of(floor, starts, tasks or [[4]]), size=size, per_action=per_action),
        actual=actual,
        planned=actual,
        planner_times_s=np.zeros(0),
        n_finished=n_finished,
        makespan=len(actual),
        n_timeouts=0,
        task_id=np.zeros(0, dtype=np.int64),
        task_release=np.zeros(0, dtype=np.int32),
        events=np.array(events or np.empty((0, 4)), dtype=np.int32),
        schedule=np.array(schedule or EMPTY, dtype=np.int32),
        proposed=EMPTY,
        planner_errors=(),
        schedule_errors=(),
        ticked=TickedRun(poses=np.zeros((1, len(starts), 4), dtype=np.int32), delays=delays),
    )


@pytest.mark.parametrize(
    ("starts", "paths", "kind", "tick"),
    [
        ([0, 1], ["FFF", "FFF"], None, 0),
        ([0, 1], ["WFFF", "FWWW"], "vertex", 2),
        ([0, 1], ["FFFW", "WFFF"], "vertex", 0),
        ([0, 2], ["WWWWWWFFF", "RRRRRRWWW"], None, 0),
        ([0, 2], ["WWWWWWFFF", "RRRRRRFWW"], "vertex", 8),
        ([0, 1], ["WWWWWWFFF", "RRRRRRFFF"], "vertex", 6),
        ([7, 1], ["WWWFFF", "RRRFFF"], "vertex", 3),
        ([7, 1], ["WWWFFFWWW", "RRRWWWFFF"], None, 0),
        ([5, 30], ["FFF", "WWW"], "illegal_move", 0),
        ([0, 30], ["CCCFFF", "WWWWWW"], "illegal_move", 3),
        ([0, 30], ["FWFRR", "WWWWW"], "illegal_move", 3),
        ([0, 30], ["FWFWFRRR", "WWWWWWWW"], None, 0),
    ],
)
def test_what_is_wrong_is_named(starts: list[int], paths: list[str], kind: str | None, tick: int) -> None:
    found = check_ticks(result_of(starts, *paths))
    assert [(conflict.kind, conflict.timestep) for conflict in found[:1]] == ([] if kind is None else [(kind, tick)])


def test_smaller_squares_may_pass_closer() -> None:
    """Robot 0 leaves cell 7 to the east while robot 1 comes into it from the north."""
    paths = ["WWWFFF", "RRRFFF"]
    assert check_ticks(result_of([7, 1], *paths, size=0.5)) == []
    assert check_ticks(result_of([7, 1], *paths, size=0.51)) != []


def test_two_small_squares_in_one_cell_and_a_third_are_seen() -> None:
    """Robot 2 drives into the cell that robot 1 has reached and robot 0 is half way out of."""
    found = check_ticks(result_of([7, 6, 1], "WWFFWWW", "WWFFFWW", "RRRWFFF", size=0.3))
    assert {conflict.agents for conflict in found} == {(1, 2)}


def test_driving_into_an_obstacle_is_illegal() -> None:
    found = check_ticks(result_of([0], "RRRF", floor=CORRIDOR))
    assert [(conflict.kind, conflict.timestep, conflict.agents) for conflict in found] == [("illegal_move", 3, (0,))]


def test_an_action_in_spite_of_a_delay_is_seen() -> None:
    delays = np.array([[1, 1, 3]], dtype=np.int32)
    assert check_ticks(result_of([0, 30], "FFFWW", "FWWFF", delays=delays)) == []
    found = check_ticks(result_of([0, 30], "FFFWW", "FWFFW", delays=delays))
    assert [(conflict.kind, conflict.timestep, conflict.agents) for conflict in found] == [("delayed", 2, (1,))]


@pytest.mark.parametrize(
    ("events", "schedule", "n_finished", "legal"),
    [
        ([[3, 0, 0, 1], [6, 0, 0, 2]], [[0, 0, 0]], 1, True),
        ([[2, 0, 0, 1], [6, 0, 0, 2]], [[0, 0, 0]], 1, False),
        ([[3, 0, 0, 1], [6, 0, 0, 2]], [[3, 0, 0]], 1, False),
        ([[3, 0, 0, 1], [6, 0, 0, 2]], [[0, 1, 0]], 1, False),
        ([[6, 0, 0, 2]], [[0, 0, 0]], 1, False),
        ([[3, 0, 0, 1]], [[0, 0, 0]], 1, False),
        ([[3, 0, 0, 1], [3, 1, 0, 2]], [[0, 0, 0]], 1, False),
    ],
)
def test_errands_are_done_where_they_are_by_whoever_has_them(
    events: list[list[int]], schedule: list[list[int]], n_finished: int, legal: bool
) -> None:
    result = result_of(
        [0, 30],
        "FFFFFF",
        "WWWWWW",
        tasks=[[1, 2], [5]],
        events=events,
        schedule=schedule,
        n_finished=n_finished,
    )
    assert (check_ticks(result) == []) == legal


def test_faults_planted_in_a_legal_run_are_seen() -> None:
    problem = in_ticks(random_problem(3, n_robots=30), chance=0.02)
    result = play_ticks(problem, PibtController(), 120, 1.0).result
    assert check_ticks(result) == []
    rng = np.random.default_rng(0)
    drives = np.argwhere(result.actual == FORWARD)
    for tick, robot in drives[rng.permutation(len(drives))[:20]]:
        changed = result.actual.copy()
        changed[tick, robot] = LETTERS.index("R")
        assert check_ticks(replace(result, actual=changed)) != []


def test_a_run_in_timesteps_is_none_of_its_business() -> None:
    result = result_of([0], "F")
    with pytest.raises(FleetError, match="tiny is played in timesteps"):
        check_ticks(replace(result, problem=replace(result.problem, ticks=None)))
