"""Benchmark of a large fleet: what a simulated second of 1,000 cars with 2,000 open tasks costs, without recording."""

from __future__ import annotations

import csv
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.harness import Kind, Row, Trial, grouped, main
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.simulation import Simulation
from fleet.tasks.board import OPEN_STATES
from maps.site import Site, save_site
from maps.warehouse import generate_warehouse

N_CARS, N_TASKS = 1_000, 2_000
WARM_S, QUICK_WARM_S = 120.0, 10.0
"""Simulated time before anything is measured: kernels are compiled, the first cars come to the first docks [s]."""
SIM_S, QUICK_SIM_S = 60.0, 10.0
"""Simulated time that is measured [s]."""
BEFORE_S = {Fidelity.KINEMATIC: 0.16, Fidelity.GRID: 0.14}
"""CPU time of a simulated second, scaled, while parking, inventory and allocation still went through cars and tasks one
by one [s]; what is promised is a share of it."""
SHARE = {Fidelity.KINEMATIC: 1 / 4, Fidelity.GRID: 1 / 6}
"""What is promised of that."""


def big_site() -> Site:
    """The generated site of 110 x 180 cells: 34 pick and 34 drop stations, parking for every car."""
    return generate_warehouse(rows=110, cols=180, pick=34, drop=34, parking=N_CARS)


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """What was seen of a run."""

    start_s: float
    """CPU time of making the run: site, graph, distances, world [s]."""
    warm_s: float
    """CPU time of the ticks before the measured ones, with what is compiled and first asked for in them [s]."""
    cpu_s: float
    """CPU time of the measured ticks [s]."""
    sim_s: float
    """Simulated time of the measured ticks [s]."""
    n_open: tuple[int, int]
    """Open tasks when they began and when they had ended."""
    n_delivered: int
    """Tasks delivered in all."""


def _measure(fidelity: Fidelity) -> Callable[[Trial], Iterable[Row]]:
    def measure(trial: Trial) -> Iterable[Row]:
        warm_s, sim_s = (QUICK_WARM_S, QUICK_SIM_S) if trial.quick else (WARM_S, SIM_S)
        with tempfile.TemporaryDirectory() as folder:
            site, orders = Path(folder) / "site.toml", Path(folder) / "orders.csv"
            save_site(big_site(), site)
            _write_orders(orders, trial.seeds[0])
            config = RunConfig(
                site=str(site),
                robots=N_CARS,
                orders=orders,
                fidelity=fidelity,
                seed=trial.seeds[0],
                arms=ArmConfig(workers_n=0),
            )
            seen = _run(trial, config, warm_s, sim_s)
        where = f"{N_CARS:,} cars, {fidelity}"
        trial.check(seen.n_open[1] > 0.8 * N_TASKS, f"{where}: only {seen.n_open[1]} tasks are open at the end")
        target = "" if trial.quick else f"<= {BEFORE_S[fidelity] * SHARE[fidelity]:.3g}"
        yield Row(
            name=f"{where}: a simulated second",
            value=seen.cpu_s / seen.sim_s,
            unit="s CPU",
            kind=Kind.TIME,
            target=target,
        )
        yield Row(name="  start-up", value=seen.start_s, unit="s CPU", kind=Kind.TIME)
        yield Row(name=f"  the {warm_s:g} simulated seconds before", value=seen.warm_s, unit="s CPU", kind=Kind.TIME)
        yield Row(name="  tasks open, at the end", value=seen.n_open[1], unit="")
        yield Row(name="  tasks delivered", value=seen.n_delivered, unit="")

    return measure


def _write_orders(path: Path, seed: int) -> None:
    """All orders at once, each between two stations drawn at random."""
    rng = np.random.default_rng(seed)
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["id", "release_s", "pick", "drop", "mass_kg", "size_m"])
        for k in range(N_TASKS):
            pick, drop = rng.integers(1, 35, 2)
            table.writerow([f"o{k}", 0, f"pick_{pick}", f"drop_{drop}", f"{rng.uniform(0.1, 1.4):.3f}", "0.06"])


def _run(trial: Trial, config: RunConfig, warm_s: float, sim_s: float) -> Stretch:
    begin_s = time.process_time()
    with Simulation(config) as simulation:
        made_s = time.process_time()
        while simulation.sim_s < warm_s:
            simulation.tick()
        n_open = len(simulation.board.in_state(*OPEN_STATES))
        since, warmed_s = simulation.sim_s, time.process_time()
        with trial.profiled(f"{config.fidelity}, {sim_s:g} simulated seconds"):
            while simulation.sim_s < since + sim_s:
                simulation.tick()
        cpu_s = time.process_time() - warmed_s
        return Stretch(
            start_s=made_s - begin_s,
            warm_s=warmed_s - made_s,
            cpu_s=cpu_s,
            sim_s=simulation.sim_s - since,
            n_open=(n_open, len(simulation.board.in_state(*OPEN_STATES))),
            n_delivered=simulation.summary().tasks_done,
        )


GROUPS = {str(fidelity): _measure(fidelity) for fidelity in BEFORE_S}

BENCHMARK = grouped(
    GROUPS,
    name="fleet_size",
    summary=f"{N_CARS:,} cars and {N_TASKS:,} open tasks on 110 x 180 cells: what a simulated second costs",
    profiles=True,
)

if __name__ == "__main__":
    raise SystemExit(main(BENCHMARK))
