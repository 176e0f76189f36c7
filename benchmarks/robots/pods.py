"""Pods: how exactly one is set down by itself and in runs, and what it touched."""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.harness import Row, Trial
from fleet.config import ArmConfig, CarConfig, Fidelity, RunConfig
from fleet.proving.pods import carry
from fleet.robots.twist import POD_CARRIER
from fleet.run.events import Event
from fleet.simulation import Simulation
from maps.site import load_site

FLOOR = Path(__file__).parents[2] / "docs/examples/pods/floor.toml"
N_ORDERS, QUICK_N_ORDERS, N_CARRIERS = 20, 4, 3
EVERY_S = 5.0
"""Time from one order to the next [s]."""
N_PHYSICS = 2
"""Seeds of runs in physics, of those without."""


@dataclass(frozen=True, kw_only=True)
class PodShift:
    """What came of a run."""

    n_done: int
    n_contacts: int
    off_mm: float
    """Farthest that a pod was set down from its place."""
    off_deg: float
    """Most that one was turned there."""
    sim_s: float


def measure_pods(trial: Trial) -> Iterable[Row]:
    """Carry a pod with each seed; then orders in runs, without physics and in physics."""
    carried = [carry(seed) for seed in trial.seeds]
    for seed, report in zip(trial.seeds, carried, strict=True):
        trial.check(report.arrived, f"pod, seed {seed}: the carrier did not arrive")
    off_mm = 1000 * max(report.off_m for report in carried)
    off_deg = math.degrees(max(report.off_rad for report in carried))
    n_touches = sum(report.n_touches for report in carried)
    yield Row(name="pod carried 20 m: off its place, largest", value=off_mm, unit="mm", target="<= 20")
    yield Row(name="pod carried 20 m: off its yaw, largest", value=off_deg, unit="degrees", target="<= 2")
    yield Row(name="pod carried 20 m: touches beside the plate", value=n_touches, unit="", target="<= 0")
    n_orders = QUICK_N_ORDERS if trial.quick else N_ORDERS
    for fidelity in (Fidelity.KINEMATIC, Fidelity.PHYSICS):
        seeds = trial.seeds[:N_PHYSICS] if fidelity is Fidelity.PHYSICS else trial.seeds
        yield from _rows(fidelity, n_orders, [play(fidelity, n_orders, seed) for seed in seeds])


def play(fidelity: Fidelity, n_orders: int, seed: int) -> PodShift:
    """Let three carriers do orders for pods drawn at random; told of on standard error when it is over."""
    down: list[Event] = []

    def note(event: Event) -> None:
        if event.kind == "pod_set_down":
            down.append(event)

    with TemporaryDirectory() as folder:
        orders = Path(folder) / "orders.csv"
        write_orders(orders, n_orders, seed)
        config = RunConfig(
            site=str(FLOOR),
            robots=N_CARRIERS,
            cars={f"car_{k}": CarConfig(model=POD_CARRIER) for k in range(N_CARRIERS)},
            orders=orders,
            seed=seed,
            fidelity=fidelity,
            duration_s=3600.0,
            arms=ArmConfig(workers_n=0),
        )
        with Simulation(config, on_event=note) as simulation:
            simulation.run()
            summary = simulation.summary()
            n_done = sum(task.state == "done" for task in simulation.board.tasks)
    seen = PodShift(
        n_done=n_done,
        n_contacts=summary.robot_contacts + summary.static_contacts,
        off_mm=max((float(str(event.facts["off_mm"])) for event in down), default=math.inf),
        off_deg=max((float(str(event.facts["off_deg"])) for event in down), default=math.inf),
        sim_s=summary.sim_s,
    )
    sys.stderr.write(f"{n_orders} pod orders, {fidelity}, seed {seed}: {seen}\n")
    sys.stderr.flush()
    return seen


def write_orders(path: Path, n_orders: int, seed: int) -> None:
    """Write orders for pods and places drawn at random."""
    site, rng = load_site(FLOOR), np.random.default_rng([25, seed])
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["id", "release_s", "type", "pod", "to"])
        for k in range(n_orders):
            pod = f"pod_{rng.integers(len(site.storage)) + 1}"
            to = ";".join(f"parking_{place + 1}" for place in rng.permutation(len(site.parking))[:2].tolist())
            table.writerow([f"o{k}", f"{EVERY_S * k:g}", "pod", pod, to])


def _rows(fidelity: Fidelity, n_orders: int, seen: list[PodShift]) -> Iterable[Row]:
    name = f"{n_orders} pod orders, {N_CARRIERS} carriers, {fidelity}"
    done = sum(one.n_done for one in seen) / (n_orders * len(seen))
    yield Row(name=f"{name}: done", value=done, unit="", target=">= 1")
    yield Row(name="  contacts", value=sum(one.n_contacts for one in seen), unit="", target="<= 0")
    yield Row(
        name="  set down off the place, largest", value=max(one.off_mm for one in seen), unit="mm", target="<= 20"
    )
    yield Row(name="  off its yaw, largest", value=max(one.off_deg for one in seen), unit="degrees", target="<= 2")
    minutes = float(np.mean([one.sim_s for one in seen])) / 60.0
    yield Row(name="  until all were done, mean", value=minutes, unit="minutes")
