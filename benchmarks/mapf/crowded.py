"""Never frozen: a floor with hardly a free cell goes on working."""

from __future__ import annotations

from collections.abc import Iterable

from benchmarks.harness import Row, Trial
from benchmarks.mapf.instances import find_map
from benchmarks.mapf.lifelong import run_lifelong

ROBOTS = 800
STEPS = 2000


def measure_crowded(trial: Trial) -> Iterable[Row]:
    """800 robots on 819 cells, with closed rings legal, as in the League: throughput of the last quarter."""
    grid = find_map(trial, "random-32-32-20", what="never frozen")
    if grid is None:
        return
    for motion in ("pebble", "rotating"):
        runs = [run_lifelong(trial, grid, ROBOTS, steps=STEPS, motion=motion, seed=seed) for seed in trial.seeds]
        shares = [float(run.quarters[3] / run.quarters[0]) for run in runs]
        tasks = sum(int(run.finished.sum()) for run in runs) / len(runs)
        yield Row(name=f"{motion}, last quarter / first, worst seed", value=min(shares), unit="", target=">= 0.85")
        yield Row(name=f"{motion}, goals reached in {STEPS} steps, mean", value=tasks, unit="")
