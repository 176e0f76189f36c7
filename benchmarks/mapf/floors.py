"""Floors that keep flowing: thousands of robots on two-way floors, judged when the start is over."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.harness import Kind, Row, Trial
from benchmarks.mapf.drawn import draw_problem
from benchmarks.mapf.instances import find
from benchmarks.mapf.league import ANYTIME_MS, QUICK_STEPS, STARTUP, Figure, figure_rows, play_problem, too_quick

SETTLED = 600
"""Timesteps after which the start is over: robots begin empty and scattered."""


@dataclass(frozen=True, kw_only=True)
class Floor:
    """A floor, how long robots drive on it, and what is promised."""

    problem: str
    steps: int
    budget_ms: float
    robots: int = 0
    """Robots drawn anew for each seed; 0 = the published problem as it is."""
    targets: dict[str, str]


FLOORS = (
    Floor(
        problem="WAREHOUSE",
        steps=2000,
        budget_ms=25.0,
        targets={
            "settled": ">= 5500",
            "longest_stand_steps": "<= 200",
            "step_ms_mean": "<= 25",
            "peak_rss_mb": "<= 3072",
        },
    ),
    Floor(
        problem="warehouse_large_5000",
        steps=5000,
        budget_ms=15.0,
        targets={"tasks_finished": ">= 85000", "kept": ">= 95", "step_ms_mean": "<= 15"},
    ),
    Floor(
        problem="sortation_large_2000",
        steps=2000,
        budget_ms=10.0,
        targets={"tasks_finished": ">= 15000", "step_ms_mean": "<= 10"},
    ),
    Floor(
        problem="sortation_large_2000",
        steps=2000,
        budget_ms=25.0,
        robots=10_000,
        targets={"settled": ">= 6300", "kept": ">= 95", "step_ms_mean": "<= 25"},
    ),
    Floor(
        problem="brc202d_500",
        steps=2000,
        budget_ms=25.0,
        robots=6500,
        targets={"settled": ">= 800", "step_ms_mean": "<= 25"},
    ),
)
ANYTIME = (
    Floor(problem="WAREHOUSE", steps=2000, budget_ms=ANYTIME_MS, targets={"settled": ">= 5900"}),
    Floor(problem="brc202d_500", steps=2000, budget_ms=ANYTIME_MS, robots=6500, targets={"settled": ">= 850"}),
)
"""Those that may take a second for each timestep; half an hour each."""
FIGURES: tuple[Figure, ...] = (
    ("tasks_finished", "tasks finished", "", Kind.PLAIN),
    ("settled", f"tasks per 200 steps after step {SETTLED}", "", Kind.PLAIN),
    ("kept", "last quarter of the best", "%", Kind.PLAIN),
    ("longest_stand_steps", "longest stand with a task", "steps", Kind.PLAIN),
    ("step_ms_mean", "step, mean", "ms", Kind.TIME),
    ("step_cpu_ms_mean", "step, mean", "ms CPU", Kind.TIME),
    ("startup_s", "start-up", "s", Kind.TIME),
    ("peak_rss_mb", "peak memory", "MB", Kind.PLAIN),
)
"""Key of a figure, name, unit, and whether it is a time."""


def measure_floors(trial: Trial) -> Iterable[Row]:
    """Every floor, in steps of some milliseconds; drawn ones once for each seed."""
    return _measure(trial, FLOORS)


def measure_floors_anytime(trial: Trial) -> Iterable[Row]:
    """The same, up to 1 s per step; left out with --quick."""
    return () if too_quick(trial, "floors that keep flowing") else _measure(trial, ANYTIME)


def _measure(trial: Trial, floors: Sequence[Floor]) -> Iterable[Row]:
    for floor in floors:
        steps = QUICK_STEPS if trial.quick else floor.steps
        published = find(trial, f"lorr2024/{floor.problem}.json", what=f"{floor.problem}, {steps} steps")
        if published is None:
            continue
        for seed in trial.seeds if floor.robots else trial.seeds[:1]:
            with tempfile.TemporaryDirectory() as folder:
                drawn = floor.robots > 0
                problem = draw_problem(published, Path(folder), floor.robots, seed) if drawn else published
                title = f"{problem.stem}, {steps} steps of {floor.budget_ms:g} ms"
                summary = play_problem(trial, title, problem, steps, floor.budget_ms, seed=seed)
            summary |= settled(summary["tasks_finished_in_blocks"], int(summary["block_steps"]))
            known = [figure for figure in FIGURES if figure[0] in summary]
            yield from figure_rows(title, summary, known, {} if trial.quick else floor.targets | STARTUP)


def settled(finished: Sequence[int], block: int) -> dict[str, float]:
    """Figures of the time after the start, none for a run that is too short.

    Args:
        finished: Tasks finished in each block of timesteps.
        block: Timesteps of a block.

    Returns:
        `settled`: mean of the blocks after the start; `kept`: the last quarter of them, of the best quarter [%].
    """
    after = list(finished[SETTLED // block :])
    quarter = len(after) // 4
    if quarter == 0:
        return {}
    means = [sum(after[k : k + quarter]) / quarter for k in range(len(after) - quarter + 1)]
    return {"settled": sum(after) / len(after), "kept": 100.0 * means[-1] / max(*means, 1e-9)}
