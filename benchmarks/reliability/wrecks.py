"""Wrecks: runs in which cars break down for good, and the others do what can still be done."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from benchmarks.harness import Row, Trial
from benchmarks.reliability.ends import Ends, play, rows
from benchmarks.reliability.fleets import drawn, fleets
from fleet.config import ArmConfig, Fidelity, RunConfig, ScenarioEvent

RUNS = {"one dead car": ((1, 1), 100), "two to four dead cars": ((2, 4), 50)}
"""How few and how many break down, and the number of runs."""
QUICK_RUNS = 4
TASKS_PER_CAR = 4
DIES_S = (5.0, 150.0)
"""When, the earliest and the latest [s]."""
LONGEST_S = 3_000.0
FIRST_SEED = 122_000
"""Nothing was developed on these."""


def measure_wrecks(trial: Trial) -> Iterator[Row]:
    """Measure how much of the work that is possible is done."""
    with fleets() as sites:
        for what, (dead, n_runs) in RUNS.items():
            ends = Ends()
            for seed in range(FIRST_SEED, FIRST_SEED + (QUICK_RUNS if trial.quick else n_runs)):
                play(draw(seed, sites, dead), ends)
            yield from rows(trial, ends, what)
            share = 100.0 * ends.n_done / (ends.n_done + ends.n_possible_left)
            yield Row(name=f"{what}: possible work done", value=share, unit="%", target=">= 100")


def draw(seed: int, sites: Mapping[str, tuple[int, int]], dead: tuple[int, int]) -> RunConfig:
    """A run of a seed, with at least one car that lives."""
    rng = np.random.default_rng(seed)
    site, robots = drawn(sites, rng)
    low, high = dead
    n_dead = min(int(rng.integers(low, high + 1)), robots - 1)
    events = tuple(
        ScenarioEvent(time_s=round(float(rng.uniform(*DIES_S)), 2), kind="car_dead", target=f"car_{car}")
        for car in rng.permutation(robots)[:n_dead].tolist()
    )
    return RunConfig(
        site=site,
        robots=robots,
        tasks=TASKS_PER_CAR * robots,
        seed=seed,
        fidelity=Fidelity.KINEMATIC,
        events=events,
        duration_s=LONGEST_S,
        arms=ArmConfig(workers_n=0),
    )
