"""Settings of a run."""

from __future__ import annotations

from dataclasses import replace

from fleet.config import ArmConfig, Fidelity, RunConfig


def test_a_run_with_another_seed_is_the_same_but_for_the_seed() -> None:
    config = RunConfig(site="cell", robots=2, seed=3, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0))
    assert config.seeded(7) == replace(config, seed=7)
    assert config.seed == 3
