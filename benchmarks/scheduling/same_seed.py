"""Same seed: the same schedule byte for byte, on an idle machine and on one that is busy with something else."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import time
from collections.abc import Iterable

from benchmarks.harness import Row, Trial
from fleet.config import AllocationConfig, BatteryConfig, Fidelity, RunConfig, StreamConfig, StreamKind
from fleet.simulation import Simulation

SITE, CARS = "medium", 16
DURATION_S, QUICK_DURATION_S = 900.0, 120.0
BURNERS_PER_CORE = 3
"""Processes that do nothing but take time from the run."""


def measure_same_seed(trial: Trial) -> Iterable[Row]:
    """Every event of a run, as text, hashed; arms are planned in a process of their own, as in the demo."""
    for allocator in ("hungarian", "regret_lns"):
        config = RunConfig(
            site=SITE,
            robots=CARS,
            seed=trial.seeds[0],
            duration_s=QUICK_DURATION_S if trial.quick else DURATION_S,
            fidelity=Fidelity.KINEMATIC,
            stream=StreamConfig(kind=StreamKind.SKEWED_WAVES, rate_per_h=360.0),
            allocation=AllocationConfig(allocator=allocator),
            battery=BatteryConfig(enabled=True),
        )
        alone, n_events, alone_s = _digest(config)
        context = multiprocessing.get_context("spawn")
        burners = [context.Process(target=_burn, daemon=True) for _ in range(BURNERS_PER_CORE * (os.cpu_count() or 1))]
        for burner in burners:
            burner.start()
        try:
            beside, _, beside_s = _digest(config)
        finally:
            for burner in burners:
                burner.kill()
                burner.join()
        trial.check(alone == beside, f"{allocator}: {alone[:12]} alone, {beside[:12]} beside {len(burners)} others")
        yield Row(name=f"{allocator}: events compared", value=n_events, unit="", target=">= 1")
        yield Row(name="  differing", value=int(alone != beside), unit="runs", target="<= 0")
        yield Row(name="  wall time beside others / alone", value=beside_s / alone_s, unit="")


def _digest(config: RunConfig) -> tuple[str, int, float]:
    """Hash of all events and of the final state, number of events, and the time the run took [s]."""
    lines: list[str] = []
    begin_s = time.monotonic()
    with Simulation(config, on_event=lambda event: lines.append(repr(event))) as simulation:
        simulation.run()
        lines.append(simulation.state_hash())
    return hashlib.sha256("\n".join(lines).encode()).hexdigest(), len(lines), time.monotonic() - begin_s


def _burn() -> None:
    while True:
        pass
