"""Never frozen: a floor with hardly a free cell goes on working."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Literal

from benchmarks.harness import Row, Trial
from benchmarks.mapf.instances import find_map
from benchmarks.mapf.lifelong import run_lifelong

ROBOTS = 800
STEPS = 2000


def measure_crowded(trial: Trial) -> Iterable[Row]:
    """800 robots on 819 cells, with closed rings, as in the League, and without: throughput of the last quarter."""
    grid = find_map(trial, "random-32-32-20", what="never frozen")
    if grid is None:
        return
    motions: tuple[Literal["pebble", "rotating"], ...] = ("pebble", "rotating")
    for motion, rings in itertools.product(motions, (True, False)):
        runs = [
            run_lifelong(trial, grid, ROBOTS, steps=STEPS, motion=motion, allow_rotation=rings, seed=seed)
            for seed in trial.seeds
        ]
        shares = [float(run.quarters[3] / run.quarters[0]) for run in runs]
        goals = sum(int(run.finished.sum()) for run in runs) / len(runs)
        what = f"{ROBOTS} robots, {motion}, {'rings' if rings else 'no rings'}"
        yield Row(name=f"{what}: last quarter / first, worst seed", value=min(shares), unit="", target=">= 0.85")
        yield Row(name=f"  goals reached in {STEPS} timesteps, mean", value=goals, unit="")
