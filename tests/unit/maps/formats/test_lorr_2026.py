"""Files of the League of 2026: ticks and delays are read, every defect is named, results are written in segments."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maps.formats.lorr import LeagueProblem, LeagueResult, read_problem, write_result
from maps.formats.lorr_2026 import SEGMENT, Delays, TickedRun, Ticks
from maps.formats.lorr_files import LeagueError
from maps.grid import NORTH

DELAYS = {
    "seed": 7,
    "minDelay": 2,
    "maxDelay": 9,
    "eventModel": "poisson",
    "pDelay": 0.25,
    "durationModel": "gaussian",
    "gaussMeanRatio": 0.5,
    "gaussStdRatio": 0.22,
}
KEYS = {
    "mapFile": "floor.map",
    "agentFile": "team.agents",
    "teamSize": 2,
    "taskFile": "work.tasks",
    "numTasksReveal": 1.5,
    "version": "2026 LoRR",
    "agentCounter": 3,
    "agentSize": 0.75,
    "delayConfig": DELAYS,
}


def write_problem(folder: Path, keys: dict[str, Any]) -> Path:
    (folder / "floor.map").write_text("type octile\nheight 2\nwidth 3\nmap\n...\n...\n")
    (folder / "team.agents").write_text("2\n0\n5\n")
    (folder / "work.tasks").write_text("2\n1,2\n4\n")
    path = folder / "tiny.json"
    path.write_text(json.dumps(keys, indent=4))
    return path


def with_delays(**changes: Any) -> dict[str, Any]:
    return KEYS | {"delayConfig": DELAYS | changes}


def without(key: str) -> dict[str, Any]:
    return KEYS | {"delayConfig": {name: value for name, value in DELAYS.items() if name != key}}


def test_ticks_and_delays_are_read(tmp_path: Path) -> None:
    problem = read_problem(write_problem(tmp_path, KEYS))
    assert (problem.pool_size, problem.round_robin) == (3, False)
    assert problem.ticks == Ticks(
        per_action=3,
        size=0.75,
        delays=Delays(
            seed=7,
            shortest=2,
            longest=9,
            events="poisson",
            chance=0.25,
            durations="gaussian",
            mean=0.5,
            spread=0.22,
        ),
    )


def test_an_action_takes_ten_ticks_and_a_robot_fills_its_cell_if_nothing_is_said(tmp_path: Path) -> None:
    keys = {key: value for key, value in KEYS.items() if key not in ("agentCounter", "agentSize")}
    ticks = read_problem(write_problem(tmp_path, keys)).ticks
    assert ticks is not None
    assert (ticks.per_action, ticks.size) == (10, 1.0)


def test_a_problem_of_2024_has_no_ticks(tmp_path: Path) -> None:
    assert read_problem(write_problem(tmp_path, KEYS | {"version": "2024 LoRR"})).ticks is None


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (KEYS | {"agentCounter": 0}, r"line 8: agentCounter = 0; valid: an integer from 1 to 1000"),
        (KEYS | {"agentCounter": 2.5}, r"agentCounter = 2.5; valid: an integer from 1"),
        (KEYS | {"agentSize": 0}, r"line 9: agentSize = 0; valid: a number > 0 and <= 1"),
        (KEYS | {"agentSize": 1.5}, r"agentSize = 1.5; valid: a number > 0 and <= 1"),
        (KEYS | {"delayConfig": 3}, r"line 10: delayConfig = 3; valid: an object"),
        (with_delays(seed=-1), r"line 11: delayConfig.seed = -1; valid: an integer from 0 to 4294967295"),
        (with_delays(minDelay=0), r"line 12: delayConfig.minDelay = 0; valid: an integer from 1"),
        (with_delays(maxDelay=1), r"line 13: delayConfig.maxDelay = 1; valid: an integer from 2"),
        (with_delays(eventModel="rain"), r"delayConfig.eventModel = 'rain'; valid: one of 'bernoulli', 'poisson'"),
        (with_delays(pDelay=1.1), r"line 15: delayConfig.pDelay = 1.1; valid: a number from 0 to 1"),
        (with_delays(pDelay=True), r"delayConfig.pDelay = True; valid: a number from 0 to 1"),
        (with_delays(durationModel=None), r"delayConfig.durationModel = None; valid: one of 'uniform', 'gaussian'"),
        (with_delays(gaussMeanRatio=-0.1), r"delayConfig.gaussMeanRatio = -0.1; valid: a number from 0 to 1"),
        (with_delays(gaussStdRatio="wide"), r"delayConfig.gaussStdRatio = 'wide'; valid: a number from 0 to 100"),
        (without("seed"), r"tiny.json: delayConfig.seed is missing; valid: an integer"),
        (without("eventModel"), r"delayConfig.eventModel is missing; valid: one of"),
    ],
)
def test_a_wrong_value_is_named_by_line_and_key(tmp_path: Path, keys: dict[str, Any], said: str) -> None:
    with pytest.raises(LeagueError, match=said):
        read_problem(write_problem(tmp_path, keys))


def test_a_missing_delay_config_is_named(tmp_path: Path) -> None:
    keys = {key: value for key, value in KEYS.items() if key != "delayConfig"}
    with pytest.raises(LeagueError, match=r"tiny.json: delayConfig is missing; valid: an object"):
        read_problem(write_problem(tmp_path, keys))


def result_of(problem: LeagueProblem) -> LeagueResult:
    """Robot 0 waits twice and drives, robot 1 turns all the time; a segment and two ticks."""
    actual = np.zeros((SEGMENT + 2, 2), dtype=np.int8)
    actual[2:, 0] = 1
    actual[:, 1] = 3
    none = np.empty((0, 3), dtype=np.int32)
    return LeagueResult(
        problem=problem,
        actual=actual,
        planned=actual,
        planner_times_s=np.array([0.5]),
        n_finished=1,
        makespan=0,
        n_timeouts=0,
        task_id=np.array([0]),
        task_release=np.array([0], dtype=np.int32),
        events=np.array([[3, 0, 0, 1]], dtype=np.int32),
        schedule=none,
        proposed=none,
        planner_errors=(),
        schedule_errors=(),
        ticked=TickedRun(
            poses=np.array([[[0, 0, 0, 0], [1, 2, 0, 0]], [[0, 1, NORTH, 2], [1, 2, 3, 1]]], dtype=np.int32),
            delays=np.array([[1, 4, 6], [0, 0, 2], [1, 9, 10]], dtype=np.int32),
        ),
    )


def test_a_result_is_written_in_segments(tmp_path: Path) -> None:
    write_result(tmp_path / "out.json", result_of(read_problem(write_problem(tmp_path, KEYS))))
    out = json.loads((tmp_path / "out.json").read_text())
    assert (out["version"], out["makespan"]) == ("2026 LoRR", SEGMENT + 2)
    assert (out["agentMaxCounter"], out["outputSegmentSize"]) == (3, SEGMENT)
    assert out["delayIntervals"] == [[[0, 2]], [[4, 6], [9, 10]]]
    # Headings are counted clockwise there: north is 3, south 1.
    assert out["actualPaths"] == [
        "[(0,0,0,0,0):(W 2,F 98)][(100,0,1,3,2):(F 2)]",
        "[(0,1,2,0,0):(C 100)][(100,1,2,1,1):(C 2)]",
    ]
    assert out["plannerPaths"] == out["actualPaths"]
