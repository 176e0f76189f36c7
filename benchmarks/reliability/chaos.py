"""Chaos: runs with faults of all kinds that are drawn from seeds, on sites that ship and generated ones."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.reliability.possible import WorkLeft
from fleet.config import EVENT_KINDS, AllocationConfig, ArmConfig, Fidelity, RunConfig
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import TaskState
from maps.site import save_site
from maps.warehouse import generate_warehouse

SITES = ("cell", "small", "twin", "medium")
FLOORS: tuple[Mapping[str, Any], ...] = (
    {"rows": 13, "cols": 20, "pick": 2, "drop": 2, "parking": 10},
    {"rows": 13, "cols": 29, "pick": 3, "drop": 3, "parking": 12},
    {"rows": 20, "cols": 30, "pick": 4, "drop": 4, "parking": 20},
    {"rows": 24, "cols": 44, "pick": 6, "drop": 6, "parking": 30},
)
CARS = {"cell": (2, 2), "twin": (3, 7), "small": (3, 10)}
USUAL_CARS = (4, 20)
RATES_PER_H = (60.0, 120.0, 240.0)
ALLOCATORS = ("hungarian", "greedy", "regret_lns", "fifo")
RUNS = {Fidelity.KINEMATIC: 300, Fidelity.PHYSICS: 40}
QUICK_RUNS = {Fidelity.KINEMATIC: 8, Fidelity.PHYSICS: 1}
TASKS_PER_CAR = 4
LONGEST_S = {Fidelity.KINEMATIC: 1_800.0, Fidelity.PHYSICS: 240.0}
"""Simulated time of a run at most [s]: physics takes that long to compute."""
CAUSED_S = 2.0
"""A contact within so long of an event that moves a car is caused by it [s]."""
ENDS_S = 60.0
"""A task that has become impossible fails within so long [s]."""
FIRST_SEED = 70_000
"""Nothing was developed on these."""


@dataclass(kw_only=True)
class Ends:
    """How the runs of a fidelity ended."""

    runs: int = 0
    stalled: list[int] = field(default_factory=list)
    """Their seeds, as in the others."""
    open: list[int] = field(default_factory=list)
    contacts: list[int] = field(default_factory=list)
    lost: list[int] = field(default_factory=list)
    misplaced: list[int] = field(default_factory=list)
    given_up: list[int] = field(default_factory=list)
    """A task failed although it could be done."""
    late: list[int] = field(default_factory=list)
    """A task could not be done any more for longer than `ENDS_S`, and had not failed."""
    ended_after_s: list[float] = field(default_factory=list)
    """How long after it had become impossible each task failed [s]."""
    states: Counter[str] = field(default_factory=Counter)
    kinds: Counter[str] = field(default_factory=Counter)


def measure_chaos(trial: Trial) -> Iterator[Row]:
    """Measure how runs with chaos end, in both worlds."""
    with tempfile.TemporaryDirectory() as folder:
        sites = {**{name: CARS.get(name, USUAL_CARS) for name in SITES}, **_generated(Path(folder))}
        for fidelity, n_runs in (QUICK_RUNS if trial.quick else RUNS).items():
            ends = Ends()
            for seed in range(FIRST_SEED, FIRST_SEED + n_runs):
                _play(_drawn(seed, sites, fidelity), ends)
            yield from _rows(trial, ends, fidelity)


def _generated(folder: Path) -> dict[str, tuple[int, int]]:
    """Site files, and how many cars there may be: no more than park there."""
    found = {}
    for k, floor in enumerate(FLOORS):
        path = folder / f"floor_{k}.toml"
        save_site(generate_warehouse(**floor), path)
        low, high = USUAL_CARS
        found[str(path)] = low, min(high, floor["parking"])
    return found


def _drawn(seed: int, sites: Mapping[str, tuple[int, int]], fidelity: Fidelity) -> RunConfig:
    """A run of a seed."""
    rng = np.random.default_rng(seed)
    site = list(sites)[rng.integers(len(sites))]
    low, high = sites[site]
    robots = int(rng.integers(low, high + 1))
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


def _play(config: RunConfig, ends: Ends) -> None:
    """Play a run and note how it ended."""
    log: list[Event] = []
    with Simulation(config) as simulation:
        left = WorkLeft(simulation)
        simulation.view.events.subscribe(log.append)
        simulation.view.events.subscribe(left.hear)
        touched_s, n_contacts = [], 0
        while not simulation.finished:
            simulation.tick()
            left.tick()
            contacts = simulation.world.contacts()
            if contacts.robot + contacts.static > n_contacts:
                n_contacts = contacts.robot + contacts.static
                touched_s.append(simulation.sim_s)
        tasks = simulation.board.tasks
        ends.runs += 1
        ends.states.update(str(task.state) for task in tasks)
        ends.kinds.update(str(event.facts["disturbance"]) for event in log if event.kind == "disturbance")
        ends.ended_after_s += left.ended_after_s
        if left.failed_while_possible:
            ends.given_up.append(config.seed)
        if max(left.ended_after_s, default=0.0) > ENDS_S or left.open_too_long(ENDS_S):
            ends.late.append(config.seed)
        if simulation.stalled and left.open_while_possible():
            ends.stalled.append(config.seed)
        elif simulation.sim_s < config.duration_s and simulation.board.n_closed < len(tasks):
            ends.open.append(config.seed)
        if any(not _is_caused(time_s, log) for time_s in touched_s):
            ends.contacts.append(config.seed)
        if simulation.parcel_balance():
            ends.lost.append(config.seed)
        if simulation.view.inventory.misplaced():
            ends.misplaced.append(config.seed)


def _is_caused(time_s: float, log: list[Event]) -> bool:
    """Whether an event that moves a car was under way when something was touched, or just before."""
    began = {}
    for event in log:
        if event.sim_s > time_s or event.kind not in ("disturbance", "disturbance_over"):
            continue
        if not EVENT_KINDS[str(event.facts["disturbance"])].moves_cars:
            continue
        key = event.facts["disturbance"], event.facts["target"]
        if event.kind == "disturbance":
            began[key] = event.sim_s
        elif began.pop(key, None) is not None and time_s - event.sim_s <= CAUSED_S:
            return True
    lasting = [key for key in began if EVENT_KINDS[str(key[0])].lasts]
    return bool(lasting) or any(time_s - since_s <= CAUSED_S for since_s in began.values())


def _rows(trial: Trial, ends: Ends, fidelity: Fidelity) -> Iterator[Row]:
    what = f"chaos, {fidelity}, {ends.runs} runs"
    for name, seeds in (
        ("runs that stalled while work was possible", ends.stalled),
        ("runs in which a task failed that was possible", ends.given_up),
        (f"runs in which an impossible task was open after {ENDS_S:g} s", ends.late),
        ("runs that ended with tasks open", ends.open),
        ("runs with contacts that no fault caused", ends.contacts),
        ("runs with a parcel balance", ends.lost),
        ("runs with misplaced parcels", ends.misplaced),
    ):
        if seeds:
            trial.notes.append(f"{what}: {name}: seeds {', '.join(map(str, seeds[:10]))}")
        yield Row(name=f"{what}: {name}", value=float(len(seeds)), unit="runs", target="<= 0")
    done = ends.states[TaskState.COLLECTED] + ends.states[TaskState.DELIVERED]
    for name, part in (("median", 0.5), ("latest", 1.0)):
        value = float(np.quantile(ends.ended_after_s or [0.0], part))
        yield Row(name=f"{what}: an impossible task fails after, {name}", value=value, unit="s", kind=Kind.PLAIN)
    yield Row(name=f"{what}: tasks done", value=100.0 * done / max(1, sum(ends.states.values())), unit="%")
    fewest = min(ends.kinds[kind] for kind, known in EVENT_KINDS.items() if not known.ends)
    target = "" if trial.quick or fidelity is Fidelity.PHYSICS else ">= 20"
    yield Row(name=f"{what}: faults of the rarest kind", value=float(fewest), unit="faults", target=target)
