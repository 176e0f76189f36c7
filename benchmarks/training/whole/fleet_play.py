"""Fleet play: a run whose dispatch, traffic and docking were learned, against the classical one on the same orders.

The policies are those of `runs/learning/<recipe>/0`, as `python -m benchmarks.training --only RECIPE` leaves them.
"""

from __future__ import annotations

import importlib.util
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.harness import Row, Trial
from benchmarks.training.learning import FOLDER
from fleet.charts.statistics import estimate
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.insight.metrics import Summary
from fleet.play.policies import played_policy
from fleet.play.simulation import PlayedSimulation
from fleet.simulation import Simulation
from fleet.training.results import CHECKPOINT

RECIPES: Mapping[str, str] = {"dispatch": "dispatch_due", "traffic": "traffic", "docking": "approach"}
"""Recipe of the policy that plays each part."""
N_CARS, N_TASKS = 6, 20
FIRST_SEED, N_SEEDS, N_QUICK_SEEDS = 60_000, 20, 1
"""Of the runs, which nothing was trained on."""


@dataclass
class Played:
    """What came of some runs."""

    done: int = 0
    """Runs with all tasks done."""
    contacts: int = 0
    throughput: list[float] = field(default_factory=list)
    """Of each run, over that of the classical one."""
    n_made: Counter[str] = field(default_factory=Counter)
    n_policy: Counter[str] = field(default_factory=Counter)
    """Decisions by part, and those that the policy took."""

    def add(self, played: Summary, classical: Summary) -> None:
        """Count a pair of runs."""
        self.done += played.tasks_done == played.tasks_total
        self.contacts += played.robot_contacts + played.static_contacts
        self.throughput.append(played.throughput_per_h / classical.throughput_per_h)


def measure_fleet_play(trial: Trial) -> Iterator[Row]:
    """Runs of both worlds, and how much of them was decided by policies."""
    folders = {part: FOLDER / recipe / "0" for part, recipe in RECIPES.items()}
    missing = [str(folder) for folder in folders.values() if not (folder / CHECKPOINT).is_file()]
    if importlib.util.find_spec("torch") is None or missing:
        trial.notes.append(f"fleet play: left out, needs PyTorch and what was learned; missing: {', '.join(missing)}")
        return
    n_seeds = N_QUICK_SEEDS if trial.quick else N_SEEDS
    for fidelity in (Fidelity.KINEMATIC, Fidelity.PHYSICS):
        found = play(folders, fidelity, range(FIRST_SEED, FIRST_SEED + n_seeds))
        where, promised = f"fleet play, {fidelity}", not trial.quick
        yield Row(name=f"{where}: all done", value=found.done, unit=f"of {n_seeds} runs", target=f">= {n_seeds}")
        yield Row(name="  contacts", value=found.contacts, unit="", target="<= 0")
        ratio = estimate(found.throughput)
        assert ratio is not None
        unit = f"of the classical one; 95 %: {ratio.low:.3f} to {ratio.high:.3f}, least {min(found.throughput):.3f}"
        yield Row(name="  throughput", value=ratio.mean, unit=unit, target=">= 0.95" if promised else "")
        for part, n_made in found.n_made.items():
            share = 100.0 * found.n_policy[part] / max(n_made, 1)
            yield Row(name=f"  decided by {RECIPES[part]}", value=share, unit=f"% of {n_made} of {part}")


def play(folders: Mapping[str, Path], fidelity: Fidelity, seeds: range) -> Played:
    """Play runs with policies, and the same ones without.

    Args:
        folders: Of training runs, by the parts that they play.
        fidelity: Of the world.
        seeds: Of the runs.
    """
    found = Played()
    for seed in seeds:
        config = RunConfig(
            site="small", robots=N_CARS, tasks=N_TASKS, fidelity=fidelity, seed=seed, arms=ArmConfig(workers_n=0)
        )
        policies = {part: played_policy(part, str(folder), seed) for part, folder in folders.items()}
        with Simulation(config) as classical, PlayedSimulation(config, policies) as played:
            classical.run()
            played.run()
            found.add(played.summary(), classical.summary())
        for part, one in policies.items():
            found.n_made[part] += one.decisions.n_made
            found.n_policy[part] += one.decisions.n_policy
    return found
