"""Day: a fleet that runs for 24 hours takes no more memory, and no longer for a tick, than in the beginning."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.config import ArmConfig, Fidelity, RunConfig, StreamConfig
from fleet.simulation import Simulation

HOURS, QUICK_HOURS = 24, 2
HOUR_S = 3600.0
CARS = 20
ORDERS_PER_H = 400.0


def measure_day(trial: Trial) -> Iterator[Row]:
    """Measure memory and the time of a tick, hour by hour."""
    hours = QUICK_HOURS if trial.quick else HOURS
    config = RunConfig(
        site="medium",
        robots=CARS,
        seed=trial.seeds[0],
        fidelity=Fidelity.KINEMATIC,
        duration_s=hours * HOUR_S,
        stream=StreamConfig(rate_per_h=ORDERS_PER_H),
        arms=ArmConfig(workers_n=0),
    )
    memory_mb: list[float] = []
    tick_us: list[float] = []
    n_visits = 0
    with Simulation(config) as simulation:
        dependencies = simulation.view.executor.dependencies
        spent_ns = np.zeros(round(HOUR_S / simulation.view.tick_s), dtype=np.int64)
        while not simulation.board.finished and len(memory_mb) < hours:
            at = simulation.now % len(spent_ns)
            before_ns = time.thread_time_ns()
            simulation.tick()
            spent_ns[at] = time.thread_time_ns() - before_ns
            queues = dependencies.queues
            n_visits = max(n_visits, len(queues.visit_agent) - int(queues.pool[1]))
            if at == len(spent_ns) - 1:
                gc.collect()
                memory_mb.append(_memory_mb())
                tick_us.append(float(np.median(spent_ns)) / 1e3)
        done = simulation.summary().tasks_done
    trial.check(len(memory_mb) == hours, f"the run ended after {len(memory_mb)} of {hours} hours")
    if len(memory_mb) < hours:
        return
    what = f"{CARS} cars, {ORDERS_PER_H:g} orders an hour, {hours} h"
    grown = 100.0 * (memory_mb[-1] / memory_mb[0] - 1.0)
    slower = 100.0 * (tick_us[-1] / tick_us[1] - 1.0)
    yield Row(name=f"{what}: tasks done", value=float(done), unit="tasks")
    yield Row(name=f"{what}: memory after the first hour", value=memory_mb[0], unit="MB")
    yield Row(name=f"{what}: memory after the last hour, beyond that", value=grown, unit="%", target="<= 5")
    yield Row(name=f"{what}: median tick of the second hour", value=tick_us[1], unit="us", kind=Kind.TIME)
    yield Row(name=f"{what}: median tick of the last hour, beyond that", value=slower, unit="%", target="<= 10")
    yield Row(name=f"{what}: visits in the dependency graph at most", value=float(n_visits), unit="visits")


def _memory_mb() -> float:
    """Memory of this process that is in use [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
