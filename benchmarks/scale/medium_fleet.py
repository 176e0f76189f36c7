"""Medium fleet: the run of 20 cars that costs are told of."""

from __future__ import annotations

from benchmarks.harness import Trial
from fleet.config import ArmConfig, Fidelity, RunConfig

SITE, CARS = "medium", 20


def medium_fleet(trial: Trial, fidelity: Fidelity, duration_s: float) -> RunConfig:
    """Four orders for each car, arms planned in the run's own process."""
    return RunConfig(
        site=SITE,
        robots=CARS,
        tasks=4 * CARS,
        seed=trial.seeds[0],
        fidelity=fidelity,
        duration_s=duration_s,
        arms=ArmConfig(workers_n=0),
    )
