"""Two-way aisles: cars that may back up, on a site whose halls are joined by aisles of one cell, for an hour."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.flow import write_orders
from benchmarks.harness import Row, Trial
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.simulation import Simulation
from maps.site import load_site
from planners.mapf.problem import NO_GOAL

SITE = "two_way"
CARS = (4, 8)
HOUR_S, QUICK_S = 3600.0, 300.0
"""Simulated time [s]."""
_MOST_ORDERS_PER_S = 0.5
"""More than any fleet delivers here, so that every car always has an order."""


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What came of a run in which more orders wait than can be done."""

    done: int
    per_h: float
    stalled: bool
    contacts: int
    longest_stand_s: float
    """The longest that a car on its way to somewhere stood [s]."""


def drive(site: str, cars: int, *, seed: int, duration_s: float) -> Drive:
    """Drive without physics, with all orders open from the start, each between two stations drawn at random."""
    with tempfile.TemporaryDirectory() as folder:
        orders = Path(folder) / "orders.csv"
        write_orders(orders, load_site(site), int(_MOST_ORDERS_PER_S * duration_s), seed)
        config = RunConfig(
            site=site,
            robots=cars,
            orders=orders,
            seed=seed,
            fidelity=Fidelity.KINEMATIC,
            duration_s=duration_s,
            arms=ArmConfig(workers_n=0),
        )
        longest_s = 0.0
        with Simulation(config) as simulation:
            traffic, executor = simulation.traffic, simulation.executor
            goals, sent_s = traffic.goals.copy(), np.zeros(cars)
            while not simulation.finished:
                simulation.tick()
                sent_s[traffic.goals != goals] = simulation.sim_s
                goals = traffic.goals.copy()
                away = (goals != NO_GOAL) & (goals != executor.tail_states()) & ~traffic.fixed
                # Who has parked for long has not stood on its way.
                stood_s = np.minimum(executor.still_s, simulation.sim_s - sent_s)
                longest_s = max(longest_s, float(stood_s[away].max(initial=0.0)))
            contacts = simulation.world.contacts()
            summary = simulation.summary()
            return Drive(
                done=summary.tasks_done,
                per_h=summary.throughput_per_h,
                stalled=simulation.stalled and not simulation.board.finished,
                contacts=contacts.robot + contacts.static,
                longest_stand_s=longest_s,
            )


def measure_two_way(trial: Trial) -> Iterable[Row]:
    """The shipped site with half of its cars and with all of them."""
    duration_s = QUICK_S if trial.quick else HOUR_S
    for cars in CARS:
        runs = [drive(SITE, cars, seed=seed, duration_s=duration_s) for seed in trial.seeds]
        per_h = float(np.mean([run.per_h for run in runs]))
        yield Row(name=f"{SITE}, {cars} cars, {duration_s:g} s: tasks", value=per_h, unit="/h")
        yield Row(name="  fewest of all seeds", value=min(run.per_h for run in runs), unit="/h")
        yield Row(name="  stalls", value=sum(run.stalled for run in runs), unit="", target="<= 0")
        yield Row(name="  contacts", value=sum(run.contacts for run in runs), unit="", target="<= 0")
        longest_s = max(run.longest_stand_s for run in runs)
        yield Row(name="  longest stand (simulated)", value=longest_s, unit="")
