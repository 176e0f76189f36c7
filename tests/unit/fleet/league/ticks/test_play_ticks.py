"""Runs in ticks: legal by the referee whatever is delayed, the same every time, and nobody waits for ever."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.league.controller import Controller, PibtController
from fleet.league.multi_step_controller import MultiStepController, MultiStepControllerConfig
from fleet.league.play import Played, play
from fleet.league.rules import Tasks
from fleet.league.ticks.play_ticks import play_ticks
from fleet.league.view import LeagueView
from maps.formats.lorr import Ints, LeagueProblem, write_result
from planners.mapf.multi_step.guidance import GuidanceConfig
from tests.unit.fleet.league.problems import in_ticks, random_problem
from tests.unit.fleet.league.ticks.replay_ticks import complaints


def quick() -> MultiStepController:
    short = GuidanceConfig(candidates=1, rounds=1, timesteps=5)
    return MultiStepController(MultiStepControllerConfig(guidance=short, rounds=3, rehearsal_timesteps=10))


def run(problem: LeagueProblem, controller: Controller | None = None, *, ticks: int = 300, **options: Any) -> Played:
    return play_ticks(problem, PibtController() if controller is None else controller, ticks, 1.0, **options)


@pytest.mark.parametrize("make", [PibtController, quick])
@pytest.mark.parametrize("per_action", [1, 3, 7])
@pytest.mark.parametrize("chance", [0.0, 0.03])
def test_a_run_is_legal_and_gets_tasks_done(
    make: type[PibtController], per_action: int, chance: float, tmp_path: Path
) -> None:
    problem = in_ticks(random_problem(1, n_robots=16), per_action=per_action, chance=chance, longest=20)
    played = run(problem, make())
    assert played.conflicts == ()
    assert played.result.n_finished > 20 // per_action
    assert played.result.schedule_errors == ()
    write_result(tmp_path / "out.json", played.result)
    assert complaints(json.loads((tmp_path / "out.json").read_text())) == []


def test_small_robots_and_long_delays_are_legal_too() -> None:
    problem = in_ticks(random_problem(2, n_robots=30), size=0.5, chance=0.01, shortest=10, longest=60, events="poisson")
    played = run(problem, ticks=400)
    assert played.conflicts == ()
    assert played.result.n_finished > 5


def test_a_run_is_the_same_every_time_and_delays_cost_tasks() -> None:
    problem = random_problem(3, n_robots=16)
    first, again, free = (
        run(in_ticks(problem, chance=chance, shortest=5, longest=30), quick(), ticks=600)
        for chance in (0.02, 0.02, 0.0)
    )
    assert (first.result.actual == again.result.actual).all()
    assert first.result.n_finished == again.result.n_finished < free.result.n_finished


def test_without_delays_little_is_lost_against_the_rules_of_2024() -> None:
    """An action takes three ticks; schedules come a plan later, and corners are not cut."""
    problem = random_problem(4, n_robots=6)
    in_timesteps = play(problem, quick(), 200, 1.0).result.n_finished
    played = run(in_ticks(problem), quick(), ticks=600).result.n_finished
    assert 0.5 * in_timesteps < played <= in_timesteps


def test_nobody_stands_for_ever() -> None:
    played = run(in_ticks(random_problem(6, n_robots=20), chance=0.01), ticks=900)
    moved = played.result.actual.reshape(3, 300, -1) != 0
    assert moved.any(axis=1).all()


def test_a_plan_is_made_from_where_robots_will_be_and_what_they_will_have_done() -> None:
    seen: list[tuple[int, ...]] = []

    class Watcher(PibtController):
        def step(self, arena: LeagueView) -> tuple[Ints, Tasks]:
            assert len(set(arena.graph.state_cell[arena.states].tolist())) == len(arena.states)
            seen.append((int(arena.states[0]), int(arena.task_of[0]), int(arena.errand_of[0])))
            return super().step(arena)

    run(in_ticks(random_problem(7, n_robots=4)), Watcher(), ticks=30)
    # One step in vain to prepare, then four timesteps for each ten ticks, and a plan before the first.
    assert len(seen) == 1 + 4 * 4
    assert len(set(seen)) > 8


def test_a_late_plan_comes_into_force_late(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(10**6))
    monkeypatch.setattr("fleet.league.ticks.play_ticks.time.perf_counter", lambda: 1.7 * next(clock))
    problem = in_ticks(random_problem(8, n_robots=4))
    in_time = run(problem, ticks=100)
    late = run(problem, ticks=100, strict_time=True)
    # Plans take 1.7 s: every 17 ticks rather than every 10, and one before the first tick.
    assert (len(in_time.step_cpu_s), len(late.step_cpu_s)) == (11, 7)
    assert (in_time.late_steps, late.late_steps) == (11, 7)
    assert late.conflicts == ()


def test_no_ticks_are_a_run_too() -> None:
    played = run(in_ticks(random_problem(9)), ticks=0)
    assert (played.timesteps, played.result.n_finished, played.conflicts) == (0, 0, ())
    assert np.isfinite(played.startup_s)
