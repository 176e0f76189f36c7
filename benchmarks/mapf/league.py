"""The League of Robot Runners: tasks, step times, start-up and memory, each run in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.calibration import REFERENCE_S, calibrate
from benchmarks.harness import Kind, Row, Trial
from benchmarks.mapf.instances import find

FAST_MS = 10.0
ANYTIME_MS = 1000.0
QUICK_STEPS = 20


@dataclass(frozen=True, kw_only=True)
class Case:
    """A problem, how long it is played, and what is promised."""

    problem: str
    steps: int
    budget_ms: float = FAST_MS
    targets: dict[str, str]
    """Target of each figure of the summary that has one."""


STARTUP = {"startup_s": "<= 60"}
FAST = (
    Case(problem="RANDOM-01", steps=600, targets={"tasks_finished": ">= 680", "step_ms_mean": "<= 10"} | STARTUP),
    Case(problem="RANDOM-03", steps=800, targets={"tasks_finished": ">= 2180", "step_ms_mean": "<= 10"} | STARTUP),
    Case(
        problem="sortation_large_2000",
        steps=2000,
        targets={"tasks_finished": ">= 13500", "step_ms_mean": "<= 10"} | STARTUP,
    ),
    Case(problem="brc202d_500", steps=1000, targets={"tasks_finished": ">= 900", "step_ms_mean": "<= 10"} | STARTUP),
    Case(
        problem="warehouse_large_5000",
        steps=1000,
        targets={"step_ms_mean": "<= 15", "step_ms_max": "<= 60", "peak_rss_mb": "<= 4096"} | STARTUP,
    ),
)
ANYTIME = (
    Case(problem="RANDOM-01", steps=600, budget_ms=ANYTIME_MS, targets={"tasks_finished": ">= 690"} | STARTUP),
    Case(problem="RANDOM-03", steps=800, budget_ms=ANYTIME_MS, targets={"tasks_finished": ">= 2300"} | STARTUP),
)

Figure = tuple[str, str, str, Kind]
FIGURES: tuple[Figure, ...] = (
    ("tasks_finished", "tasks finished", "", Kind.PLAIN),
    ("step_ms_mean", "step, mean", "ms", Kind.TIME),
    ("step_ms_max", "step, worst", "ms", Kind.TIME),
    ("step_cpu_ms_mean", "step, mean", "ms CPU", Kind.TIME),
    ("startup_s", "start-up", "s", Kind.TIME),
    ("peak_rss_mb", "peak memory", "MB", Kind.PLAIN),
)
"""Key in the summary of `fleet lorr`, name, unit, and whether it is a time."""
WRONG = ("planner_errors", "schedule_errors", "conflicts")


def measure_league(trial: Trial) -> Iterable[Row]:
    """Fast mode, 10 ms per step."""
    return _measure(trial, FAST)


def measure_league_anytime(trial: Trial) -> Iterable[Row]:
    """Anytime mode, up to 1 s per step; left out with --quick."""
    return () if too_quick(trial, "League") else _measure(trial, ANYTIME)


def too_quick(trial: Trial, what: str) -> bool:
    """Whether a trial has no time for steps of a second; it notes then what is left out."""
    if trial.quick:
        trial.notes.append(f"{what}, anytime mode: left out with --quick")
    return trial.quick


def _measure(trial: Trial, cases: Sequence[Case]) -> Iterable[Row]:
    for case in cases:
        steps = QUICK_STEPS if trial.quick else case.steps
        title = f"{case.problem}, {steps} steps of {case.budget_ms:g} ms"
        path = find(trial, f"lorr2024/{case.problem}.json", what=title)
        if path is None:
            continue
        summary = play_problem(trial, title, path, steps, case.budget_ms, seed=trial.seeds[0])
        yield from figure_rows(title, summary, FIGURES, {} if trial.quick else case.targets)


def figure_rows(
    title: str, summary: Mapping[str, Any], figures: Iterable[Figure], targets: Mapping[str, str]
) -> Iterable[Row]:
    """Rows of a run: how many robots, then its figures, with the targets that have the same key."""
    yield Row(name=f"{title}: robots", value=summary["robots"], unit="")
    for key, name, unit, kind in figures:
        yield Row(name=f"  {name}", value=summary[key], unit=unit, kind=kind, target=targets.get(key, ""))


def play_problem(trial: Trial, title: str, problem: Path, steps: int, budget_ms: float, *, seed: int) -> dict[str, Any]:
    """Play by `fleet lorr`, and check that nothing was wrong.

    Kernels that are not in the cache yet are compiled in its start-up.

    Args:
        trial: Told, under the title, what was wrong.
        title: Name of the run.
        problem: Problem file.
        steps: Timesteps.
        budget_ms: Wall time for each of them on the machine that times are scaled to [ms]; here as much less as this
            machine is faster, so that both get as far.
        seed: Seed of everything random.

    Returns:
        Its summary.
    """
    summary = _played(problem, steps, budget_ms * calibrate() / REFERENCE_S, seed=seed)
    for key in WRONG:
        trial.check(summary[key] == 0, f"{title}: {summary[key]} {key}")
    trial.check(summary["steps"] == steps, f"{title}: {summary['steps']} steps played")
    return summary


def _played(problem: Path, steps: int, budget_ms: float, *, seed: int) -> dict[str, Any]:
    """Summary of `fleet lorr`."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "summary.json"
        words = [problem, "--steps", steps, "--budget-ms", budget_ms, "--seed", seed, "--json", output]
        done = subprocess.run(
            [sys.executable, "-m", "fleet", "lorr", *map(str, words)],
            cwd=Path(__file__).resolve().parents[2],
            check=False,
            capture_output=True,
            text=True,
        )
        if not output.exists():
            raise RuntimeError(f"fleet lorr {problem.name}: exit status {done.returncode}: {done.stderr.strip()}")
        summary: dict[str, Any] = json.loads(output.read_text(encoding="utf-8"))
        return summary
