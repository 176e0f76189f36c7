"""The lorr command: plays, writes what it says, refuses what it cannot do, and keeps what it has when interrupted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from fleet.cli.main import main
from fleet.league import arena as arena_module
from fleet.league.arena import Arena, Tasks
from fleet.league.multi_step_controller import MultiStepController
from maps.formats.lorr import Ints
from tests.unit.fleet.league.problems import in_ticks, random_problem, write_files
from tests.unit.fleet.league.replay import Replay
from tests.unit.fleet.league.ticks.replay_ticks import complaints

SUMMARY_KEYS = {"tasks_finished", "step_ms_mean", "step_ms_max", "peak_rss_mb", "startup_s", "planner_errors"}


@pytest.fixture
def problem(tmp_path: Path) -> Path:
    """Return the file of a dozen robots in a room."""
    return write_files(tmp_path, random_problem(0))


def end(*words: object) -> Any:
    """Run the command; returns its exit status."""
    with pytest.raises(SystemExit) as stop:
        main(["lorr", *map(str, words)])
    return stop.value.code


def complaint(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """Run a command that must be refused, and return its one line."""
    status = end(*words)
    said = capsys.readouterr()
    assert (status, said.out, said.err.count("\n")) == (2, "", 1), said
    return said.err


def test_a_run_leaves_a_file_for_the_league_and_a_summary(
    problem: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, figures = tmp_path / "out.json", tmp_path / "summary.json"
    assert end(problem, "--steps", 80, "--output", out, "--json", figures) == 0
    said = capsys.readouterr()
    assert said.err == ""
    replay = Replay(problem, out)
    assert replay.complaints == []
    summary = json.loads(figures.read_text())
    assert summary.keys() >= SUMMARY_KEYS
    assert summary["tasks_finished"] == replay.n_finished > 5
    assert (summary["robots"], summary["steps"], summary["seed"], summary["interrupted"]) == (12, 80, 0, False)
    assert (summary["planner_errors"], summary["schedule_errors"], summary["conflicts"]) == (0, 0, 0)
    assert 0 < summary["step_ms_mean"] <= summary["step_ms_max"]
    assert summary["peak_rss_mb"] > 10
    assert "tiny: 12 robots, 80 steps, seed 0" in said.out
    assert f"tasks finished                 │ {summary['tasks_finished']:>12}" in said.out


def test_a_problem_of_2026_is_played_in_ticks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    problem = write_files(tmp_path, in_ticks(random_problem(0), chance=0.02))
    out, figures = tmp_path / "out.json", tmp_path / "summary.json"
    assert end(problem, "--steps", 250, "--output", out, "--json", figures) == 0
    assert "tiny: 12 robots, 250 steps, seed 0" in capsys.readouterr().out
    result, summary = json.loads(out.read_text()), json.loads(figures.read_text())
    assert (result["version"], result["makespan"], result["agentMaxCounter"]) == ("2026 LoRR", 250, 3)
    assert complaints(result) == []
    assert summary["tasks_finished"] == result["numTaskFinished"] > 5
    assert (summary["steps"], summary["conflicts"], summary["schedule_errors"]) == (250, 0, 0)
    assert any(result["delayIntervals"])


def test_a_wrong_delay_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    problem = write_files(tmp_path, in_ticks(random_problem(0), chance=2.0))
    assert "delayConfig.pDelay = 2.0; valid: a number from 0 to 1" in complaint(capsys, problem)


def test_without_files_it_only_prints(problem: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(tmp_path.iterdir())
    assert end(problem, "--steps", 3) == 0
    assert sorted(tmp_path.iterdir()) == before
    assert "tasks finished" in capsys.readouterr().out


def test_the_seed_decides(problem: Path, tmp_path: Path) -> None:
    paths = []
    for seed in (0, 0, 1):
        assert end(problem, "--steps", 30, "--seed", seed, "--output", tmp_path / "out.json") == 0
        paths.append(json.loads((tmp_path / "out.json").read_text())["actualPaths"])
    assert paths[0] == paths[1] != paths[2]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--steps", "0"], "--steps is 0; valid: an integer >= 1"),
        (["--steps", "many"], "--steps is 'many'; valid: an integer"),
        (["--budget-ms", "0"], "--budget-ms is 0.0; valid: a number > 0"),
        (["--budget-ms", "-1"], "--budget-ms is -1.0; valid: a number > 0"),
        (["--budget-ms", "nan"], "--budget-ms is nan; valid: a number > 0"),
        (["--budget-ms", "inf"], "--budget-ms is inf; valid: a number > 0"),
        (["--seed", "-1"], "--seed is -1; valid: an integer >= 0"),
        (["--output", "nowhere/out.json"], "nowhere/out.json: No such file or directory"),
        (["--json", "nowhere/out.json"], "nowhere/out.json: No such file or directory"),
        (["--output", "."], ".: Is a directory"),
        (["--output", "x.json", "--json", "x.json"], "--json is 'x.json'; valid: a file of its own"),
        (["--output", "tiny.json"], "--output is 'tiny.json'; valid: a file of its own"),
        (["--planner", "lacam"], "unknown option --planner"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_wrong_words_are_refused_and_nothing_is_written(
    problem: Path,
    tmp_path: Path,
    words: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert said in complaint(capsys, problem.name, *words)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"teamSize": 0}, "tiny.json: line 4: teamSize = 0; valid: an integer >= 1"),
        ({"taskFile": "no.tasks"}, "tiny.json: line 5: taskFile = 'no.tasks'"),
        ({"mapFile": "tiny.tasks"}, "tiny.tasks: lines 1-4 are"),
    ],
)
def test_a_malformed_problem_is_refused_before_files_are_touched(
    problem: Path, tmp_path: Path, change: dict[str, Any], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    problem.write_text(json.dumps(json.loads(problem.read_text()) | change, indent=1))
    (tmp_path / "out.json").write_text("old")
    assert said in complaint(capsys, problem, "--output", tmp_path / "out.json")
    assert (tmp_path / "out.json").read_text() == "old"


def test_a_missing_problem_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: `[Errno 2]` in the message."""
    said = complaint(capsys, tmp_path / "no.json")
    assert "no.json: cannot be read" in said
    assert "Errno" not in said
    assert "PROBLEM" in complaint(capsys)


def test_a_run_with_conflicts_is_no_success(
    problem: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An arena that lets everything pass: the referee at the end sees what came of it."""

    def lax(*arrays: Any) -> tuple[int, int, int]:
        judge(*arrays)
        return 0, -1, -1

    def first_move(controller: MultiStepController, arena: Arena) -> tuple[Ints, Tasks]:
        graph = arena.graph
        return graph.move_to[graph.out_move[graph.out_ptr[arena.states]]], arena.task_of

    judge = arena_module.judge_moves
    monkeypatch.setattr(arena_module, "judge_moves", lax)
    monkeypatch.setattr(MultiStepController, "step", first_move)
    assert end(problem, "--steps", 60, "--json", tmp_path / "summary.json") == 1
    assert "illegal: " in capsys.readouterr().out
    assert json.loads((tmp_path / "summary.json").read_text())["conflicts"] > 0


def test_an_interrupted_run_keeps_what_it_has(problem: Path, tmp_path: Path, repository: Path) -> None:
    out, figures = tmp_path / "out.json", tmp_path / "summary.json"
    words = [problem, "--steps", 10**6, "--output", out, "--json", figures]
    process = subprocess.Popen(
        [sys.executable, "-m", "fleet", "lorr", *map(str, words)],
        cwd=repository,
        env=dict(os.environ, COLUMNS="100"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline().startswith("step 1 of 1000000")
    process.send_signal(signal.SIGINT)
    said, complained = process.communicate(timeout=120)
    assert (process.returncode, complained) == (130, "")
    assert "interrupted: the files hold the run up to here" in said
    replay = Replay(problem, out)
    summary = json.loads(figures.read_text())
    assert replay.complaints == []
    assert summary["interrupted"]
    assert 1 <= summary["steps"] < 10**6
    assert summary["tasks_finished"] == replay.n_finished


def test_the_plain_controller_plays_too(problem: Path, tmp_path: Path) -> None:
    """PIBT plays otherwise than the default does, and by the rules."""
    played = []
    for controller in ("pibt", "multi_step_pibt"):
        out = tmp_path / f"{controller}.json"
        assert end(problem, "--steps", 40, "--controller", controller, "--output", out) == 0
        assert Replay(problem, out).complaints == []
        played.append(json.loads(out.read_text())["actualPaths"])
    assert played[0] != played[1]


def test_an_unknown_controller_is_refused(problem: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "multi_step_pibt" in complaint(capsys, problem, "--controller", "none")
