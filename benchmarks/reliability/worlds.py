"""Worlds: random sites, fleets and settings, with and without chaos, and all safety invariants looked at every tick."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.harness import Row, Trial
from benchmarks.reliability.fuzz import Hang, at_most
from fleet.config import (
    AllocationConfig,
    ArmConfig,
    BatteryConfig,
    Fidelity,
    Grip,
    RunConfig,
    StreamConfig,
    TrafficConfig,
)
from fleet.errors import FleetError
from fleet.safety.breach import InvariantError
from fleet.safety.check import SafetyCheck
from fleet.simulation import Simulation
from maps.errors import MapsError
from maps.site import save_site
from maps.warehouse import generate_warehouse
from planners.allocation import ALLOCATORS
from planners.mapf import PLANNERS

WORLDS, QUICK_WORLDS = 1_000, 12
DURATION_S = 120.0
LONGEST_CPU_S = 120.0
"""A world that takes longer hangs."""
FIRST_SEED = 123_000
"""Nothing was developed on these."""


def measure_worlds(trial: Trial) -> Iterator[Row]:
    """Measure how many random worlds break an invariant, hang, or end in an error once they have begun."""
    n_refused, broken, errors = 0, [], []
    n_worlds = QUICK_WORLDS if trial.quick else WORLDS
    for seed in range(FIRST_SEED, FIRST_SEED + n_worlds):
        try:
            n_refused += not play(seed)
        except InvariantError as error:
            broken.append(f"seed {seed}: {error}")
        except (Exception, Hang) as error:
            errors.append(f"seed {seed}: {traceback.format_exception_only(error)[0].strip()}")
    trial.notes.extend([*broken, *errors][:10])
    yield Row(name="random worlds", value=n_worlds, unit="worlds")
    yield Row(name="random worlds: refused by name", value=n_refused, unit="worlds")
    yield Row(name="random worlds: broken invariants", value=len(broken), unit="worlds", target="<= 0")
    yield Row(name="random worlds: hangs and errors", value=len(errors), unit="worlds", target="<= 0")


def play(seed: int) -> bool:
    """Play the world of a seed; False if it was refused by name before it began.

    Raises:
        InvariantError: It broke an invariant.
        Hang: It takes too long.
    """
    rng = np.random.default_rng(seed)
    with TemporaryDirectory() as folder, at_most(LONGEST_CPU_S):
        try:
            simulation = Simulation(draw(rng, seed, Path(folder)))
        except (FleetError, MapsError):
            return False
        with simulation:
            check = SafetyCheck(simulation.view)
            simulation.run(lambda _: check.tick())
    return True


def draw(rng: np.random.Generator, seed: int, folder: Path) -> RunConfig:
    """A world: a site of any size and shape, and a fleet with any settings.

    Raises:
        MapsError: The site cannot be laid out.
    """
    rows, cols = int(rng.integers(7, 30)), int(rng.integers(9, 46))
    site = generate_warehouse(
        rows=rows,
        cols=cols,
        pick=int(rng.integers(1, max(2, rows // 4))),
        drop=int(rng.integers(1, max(2, rows // 4))),
        parking=int(rng.integers(2, 25)),
        chargers=int(rng.integers(0, 4)),
        rack_rows=int(rng.integers(1, 4)),
        rack_cols=int(rng.integers(1, 7)),
    )
    save_site(site, folder / "site.toml")
    chaos = rng.random() < 0.5
    robots = int(rng.integers(1, len(site.parking) + 1))
    return RunConfig(
        site=str(folder / "site.toml"),
        robots=robots,
        tasks=None if rng.random() < 0.3 else int(rng.integers(1, 4 * robots + 2)),
        stream=StreamConfig(rate_per_h=float(rng.uniform(20.0, 900.0))) if rng.random() < 0.5 else None,
        seed=seed,
        duration_s=DURATION_S,
        fidelity=Fidelity.KINEMATIC if rng.random() < 0.7 else Fidelity.GRID,
        grip=Grip.SUCTION if rng.random() < 0.6 else Grip.FRICTION,
        askew=bool(rng.random() < 0.3),
        chaos_per_h=float(rng.uniform(30.0, 400.0)) if chaos else 0.0,
        traffic=TrafficConfig(planner=str(rng.choice(sorted(PLANNERS)))),
        allocation=AllocationConfig(allocator=str(rng.choice(sorted(ALLOCATORS)))),
        battery=BatteryConfig(enabled=bool(site.chargers) and rng.random() < 0.5),
        arms=ArmConfig(workers_n=0),
    )
