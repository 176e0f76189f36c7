"""Chaos: runs with faults of all kinds that are drawn from seeds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from benchmarks.harness import Row, Trial
from benchmarks.reliability.ends import Ends, play, rows
from benchmarks.reliability.fleets import drawn, fleets
from fleet.config import EVENT_KINDS, AllocationConfig, ArmConfig, Fidelity, RunConfig

RATES_PER_H = (60.0, 120.0, 240.0)
ALLOCATORS = ("hungarian", "greedy", "regret_lns", "fifo")
RUNS = {Fidelity.KINEMATIC: 300, Fidelity.PHYSICS: 40}
QUICK_RUNS = {Fidelity.KINEMATIC: 8, Fidelity.PHYSICS: 1}
TASKS_PER_CAR = 4
LONGEST_S = {Fidelity.KINEMATIC: 1_800.0, Fidelity.PHYSICS: 240.0}
"""Simulated time of a run at most [s]: physics takes that long to compute."""
FIRST_SEED = 121_000
"""Nothing was developed on these."""


def measure_chaos(trial: Trial) -> Iterator[Row]:
    """Measure how runs with chaos end, in both worlds."""
    with fleets() as sites:
        for fidelity, n_runs in (QUICK_RUNS if trial.quick else RUNS).items():
            ends = Ends()
            for seed in range(FIRST_SEED, FIRST_SEED + n_runs):
                play(draw(seed, sites, fidelity), ends)
            yield from rows(trial, ends, f"chaos, {fidelity}")
            fewest = min(ends.kinds[kind] for kind, known in EVENT_KINDS.items() if not known.ends)
            target = "" if trial.quick or fidelity is Fidelity.PHYSICS else ">= 20"
            yield Row(name=f"chaos, {fidelity}: faults of the rarest kind", value=fewest, unit="faults", target=target)


def draw(seed: int, sites: Mapping[str, tuple[int, int]], fidelity: Fidelity) -> RunConfig:
    """A run of a seed."""
    rng = np.random.default_rng(seed)
    site, robots = drawn(sites, rng)
    return RunConfig(
        site=site,
        robots=robots,
        tasks=TASKS_PER_CAR * robots,
        seed=seed,
        fidelity=fidelity,
        chaos_per_h=float(rng.choice(RATES_PER_H)),
        duration_s=LONGEST_S[fidelity],
        allocation=AllocationConfig(allocator=str(rng.choice(ALLOCATORS))),
        arms=ArmConfig(workers_n=0),
    )
