"""A run as its files tell it: an independent replay of the League's rules finds the same, and finds what is planted."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fleet.league.arena import NO_TASK, Arena, Tasks
from fleet.league.controller import PibtController
from fleet.league.play import Played, play
from maps.formats.lorr import Ints, read_problem, write_result
from maps.grid import EAST
from tests.unit.fleet.league.problems import CORRIDOR, ROOM, problem_of, random_problem, write_files
from tests.unit.fleet.league.replay import Replay


def nothing(arena: Arena, budget_s: float) -> None:
    assert arena.timestep == 0
    assert budget_s > 0


class Puppet:
    """Does what functions say."""

    def __init__(
        self,
        decide: Callable[[Arena], tuple[Ints, Tasks]],
        prepare: Callable[[Arena, float], None] = nothing,
    ) -> None:
        self.step = decide
        self.prepare = prepare


def wait(arena: Arena) -> tuple[Ints, Tasks]:
    return arena.states, arena.task_of


def replayed(folder: Path, played: Played, *, edition: int = 2024) -> Replay:
    write_result(folder / "out.json", played.result)
    return Replay(write_files(folder, played.result.problem, edition=edition), folder / "out.json")


@pytest.mark.parametrize("seed", range(5))
def test_an_independent_replay_of_the_file_finds_the_same(tmp_path: Path, seed: int) -> None:
    played = play(random_problem(seed), PibtController(seed=seed), 150, 1.0)
    replay = replayed(tmp_path, played)
    assert replay.complaints == []
    assert replay.n_finished == played.result.n_finished > 20
    assert (played.conflicts, played.result.planner_errors, played.result.schedule_errors) == ((), (), ())
    assert read_problem(tmp_path / "tiny.json").start_cell.tolist() == played.result.problem.start_cell.tolist()


@pytest.mark.parametrize("seed", range(3))
def test_the_same_for_problems_of_2023(tmp_path: Path, seed: int) -> None:
    played = play(random_problem(seed, round_robin=True), PibtController(seed=seed), 150, 1.0)
    replay = replayed(tmp_path, played, edition=2023)
    assert replay.complaints == []
    assert replay.n_finished == played.result.n_finished > 50
    assert read_problem(tmp_path / "tiny.json").round_robin


def test_the_same_seed_plays_the_same() -> None:
    runs = [play(random_problem(0), PibtController(seed=7), 60, 1.0).result for _ in range(2)]
    assert (runs[0].actual == runs[1].actual).all()
    assert (runs[0].schedule == runs[1].schedule).all()


def test_errors_on_the_way_are_counted_and_the_files_stay_legal(tmp_path: Path) -> None:
    """A good controller that stumbles: every 7th timestep a robot is left out, every 5th two want one task."""
    good = PibtController()

    def stumble(arena: Arena) -> tuple[Ints, Tasks]:
        states, task_of = good.step(arena)
        if arena.timestep % 7 == 3:
            states[0] = -1
        if arena.timestep % 5 == 4:
            task_of[:2] = arena.pool()[0]
        return states, task_of

    played = play(random_problem(1), Puppet(stumble, good.prepare), 100, 1.0)
    assert [error[2] for error in played.result.planner_errors] == list(range(4, 100, 7))
    assert [error[3] for error in played.result.schedule_errors] == list(range(5, 101, 5))
    replay = replayed(tmp_path, played)
    assert (replay.complaints, played.conflicts) == ([], ())
    assert replay.n_finished == played.result.n_finished > 10
    written = json.loads((tmp_path / "out.json").read_text())
    assert (written["numPlannerErrors"], written["numScheduleErrors"]) == (14, 20)
    assert written["plannerPaths"][0].split(",")[3] == "T"
    assert written["actualPaths"][0].split(",")[3] == "W"


@pytest.mark.parametrize(
    ("key", "change", "said"),
    [
        ("actualPaths", lambda paths: ["F,F,F,F,F,F", *paths[1:]], "timestep 5: two robots in one cell"),
        ("actualPaths", lambda paths: ["R,R,F,W,W,W", *paths[1:]], "timestep 3: (0, -1) is no floor"),
        ("actualPaths", lambda paths: [paths[0], "R,R,F,W,W,W"], "timestep 3: two robots in one cell"),
        ("events", lambda events: events[:-1], "the events are others"),
        ("numTaskFinished", lambda n: n + 1, "2 tasks finished, not 3"),
        ("tasks", lambda tasks: [[0, 0, [0, 2]], *tasks[1:]], "task 0 is another one in the task file"),
        ("tasks", lambda tasks: [tasks[0], [1, 4, tasks[1][2]], *tasks[2:]], "timestep 1: task 1 is not known"),
        ("actualSchedule", lambda texts: [texts[0], texts[1] + ",2:0"], "timestep 2: two robots have one task"),
        ("numPlannerErrors", lambda n: n + 1, "numPlannerErrors does not count errors"),
        ("start", lambda start: start[::-1], "the robots start elsewhere"),
    ],
)
def test_the_replay_sees_what_is_wrong_with_a_file(
    tmp_path: Path, key: str, change: Callable[[object], object], said: str
) -> None:
    """The judge is judged: robot 0 waits, robot 1 drives from cell 1 to the two ends of its tasks."""

    def drive(arena: Arena) -> tuple[Ints, Tasks]:
        cell = min(int(arena.graph.state_cell[arena.states[1]]) + 1, 5)
        return np.array([arena.states[0], arena.graph.state_at(cell, EAST)]), np.array([0, 1 if cell < 5 else 2])

    # The pool never refills before the end: three tasks of the file, all known from the start.
    problem = problem_of(ROOM, [0, 1], [[35], [4], [5]])
    played = play(problem, Puppet(drive), 6, 1.0)
    assert replayed(tmp_path, played).complaints == []
    out = tmp_path / "out.json"
    written = json.loads(out.read_text())
    out.write_text(json.dumps(written | {key: change(written[key])}))
    assert any(complaint.startswith(said) for complaint in Replay(tmp_path / "tiny.json", out).complaints)


def test_late_steps_are_counted_and_change_nothing() -> None:
    def dawdle(arena: Arena) -> tuple[Ints, Tasks]:
        time.sleep(0.02 if arena.timestep == 1 else 0.0)
        return arena.states, arena.task_of

    puppet = Puppet(dawdle, lambda arena, budget_s: time.sleep(0.05))
    played = play(problem_of(ROOM, [0], [[1]]), puppet, 4, 0.019)
    assert played.late_steps >= 1
    assert (played.timesteps, played.result.n_timeouts) == (4, 0)
    assert len(played.result.planner_times_s) == len(played.step_cpu_s) == 4
    assert played.startup_s >= 0.05


def test_with_strict_time_robots_wait_for_a_late_planner(tmp_path: Path) -> None:
    def dawdle(arena: Arena) -> tuple[Ints, Tasks]:
        time.sleep(0.5 if arena.timestep == 0 else 0.0)
        cell = int(arena.graph.state_cell[arena.states[0]]) + 1
        return np.array([arena.graph.state_at(cell, EAST)]), np.array([0])

    played = play(problem_of(CORRIDOR, [0], [[4]]), Puppet(dawdle), 8, 0.2, strict_time=True)
    assert played.result.n_timeouts >= 2
    assert played.timesteps == 8
    letters = "".join("WFRCT"[action] for action in played.result.actual[:, 0])
    assert letters.startswith("TT")
    assert letters.count("T") == played.result.n_timeouts
    assert letters.replace("T", "").startswith("F")
    assert replayed(tmp_path, played).complaints == []


def test_a_planner_that_never_gets_ready_spends_the_run_waiting() -> None:
    def never(arena: Arena) -> tuple[Ints, Tasks]:
        time.sleep(0.02)
        return arena.states, arena.task_of

    played = play(problem_of(CORRIDOR, [0], [[4]]), Puppet(never), 5, 0.001, strict_time=True)
    assert (played.timesteps, played.result.n_timeouts, len(played.result.planner_times_s)) == (5, 5, 1)


def test_an_interrupt_ends_the_run_after_the_timestep(tmp_path: Path) -> None:
    def interrupt(arena: Arena) -> tuple[Ints, Tasks]:
        if arena.timestep == 2:
            signal.raise_signal(signal.SIGINT)
        return arena.states, np.full(1, NO_TASK)

    played = play(problem_of(CORRIDOR, [0], [[4]]), Puppet(interrupt), 50, 1.0)
    assert played.interrupted
    assert played.timesteps == 3
    assert replayed(tmp_path, played).complaints == []


def test_progress_is_told_after_every_timestep() -> None:
    seen: list[int] = []
    play(problem_of(CORRIDOR, [0], [[4]]), Puppet(wait), 3, 1.0, progress=lambda arena: seen.append(arena.timestep))
    assert seen == [1, 2, 3]


def test_free_robots_take_the_nearest_tasks_until_there_are_none() -> None:
    arena = Arena(problem_of(ROOM, [0, 5, 30], [[29], [1]]))
    controller = PibtController()
    controller.prepare(arena, 1.0)
    _, task_of = controller.step(arena)
    assert task_of.tolist() == [1, 0, NO_TASK]
