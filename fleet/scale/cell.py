"""Cell: one fleet size at one fidelity, measured in a process of its own."""

from __future__ import annotations

import multiprocessing
import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fleet.abstract.fleet import FloorTooLarge
from fleet.abstract.kernel import Stage
from fleet.abstract.run import AbstractRun
from fleet.arrays import FloatArray
from fleet.config import ArmConfig, Fidelity, PhysicsConfig, RunConfig, TrafficConfig
from fleet.errors import FleetError
from fleet.insight.time_accounts import CarTime
from fleet.run.memory import settled
from fleet.scale.floors import floor_for
from fleet.simulation import Simulation
from fleet.study.backend import POLL_S
from fleet.study.pool import begin_process
from fleet.tasks.board import DONE_STATES, TaskState
from maps.site import save_site

WARM_UP_S = 2.0
"""Simulated time before anything is measured: the first plans are made, the first cars drive [s]."""
LEAST_SIM_S = 1.0
"""Least simulated time from which a speed is told [s]."""
LEAST_TASKS_SIM_S = 300.0
"""Least simulated time from which deliveries are told: the first parcel takes a minute or two [s]."""
MOST_SIM_S = 900.0
"""Simulated time after which a cell has seen enough [s]."""
NOT_BEGUN = (TaskState.ORDERED, TaskState.BACKLOG)
"""Orders that are still to come or wait for a station."""
SPARE_S = 0.5
"""Wall time for the answer [s]."""


@dataclass(frozen=True, kw_only=True)
class CellFigures:
    """What was measured."""

    real_time_factor: float | None
    """Simulated time by wall time, after the warm-up; None if there was too little of it."""
    memory_mb: float
    """The most that the process ever had in memory [MB]."""
    tasks_per_h: float | None
    """Tasks done in the second half of the run; None if it was too short."""
    at_work_share: float
    """Share of the cars' time in which they drove with a task or were served."""
    contacts: int
    """Of robots, with each other and with what is fixed."""
    first_move_s: float
    """Wall time until the first car moved, from reading the site on [s]."""
    sim_s: float
    """Simulated time in all [s]."""
    core_share: float
    """Time of the processor by wall time, after the warm-up: below 1 where other programs had the cores."""


def run_cell(
    n_cars: int,
    fidelity: Fidelity,
    floor: Path,
    wall_s: float,
    interrupted: Sequence[int],
    *,
    most_sim_s: float = MOST_SIM_S,
    n_workers: int = 1,
    n_orders: int | None = None,
) -> CellFigures | str:
    """Measure one cell in a process of its own.

    Args:
        n_cars: Fleet size.
        fidelity: How robots are moved.
        floor: Site file; made if it is not there.
        wall_s: Most wall time, start of the process included [s].
        interrupted: Becomes non-empty when the user wants to stop.
        most_sim_s: Simulated time after which it has seen enough [s].
        n_workers: Processes that share the physics.
        n_orders: Orders at the start; None = two for each car, and some. A cell ends when the last of them is begun.

    Returns:
        Figures, or why there are none.

    Raises:
        FleetError: The run was refused.
    """
    until = time.time() + wall_s
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    words = (there, n_cars, fidelity, floor, until - SPARE_S, most_sim_s, n_workers, n_orders)
    process = context.Process(target=_answer, args=words, daemon=True)
    process.start()
    there.close()
    try:
        while not here.poll(POLL_S):
            if interrupted:
                return "interrupted"
            if time.time() > until:
                return f"did not start within {wall_s:.0f} s"
        answer: CellFigures | str | FleetError = here.recv()
    except EOFError:
        process.join()
        return f"its process died ({process.exitcode}), perhaps for want of memory"
    finally:
        process.kill()
        process.join()
        here.close()
    if isinstance(answer, FleetError):
        raise answer
    return answer


def _answer(there: Connection, *words: Any) -> None:
    """`measure_cell` in a process of its own."""
    begin_process()
    try:
        there.send(measure_cell(*words))
    except FloorTooLarge as error:
        there.send(str(error))
    except FleetError as error:
        there.send(error)


def measure_cell(
    n_cars: int,
    fidelity: Fidelity,
    floor: Path,
    until: float,
    most_sim_s: float = MOST_SIM_S,
    n_workers: int = 1,
    n_orders: int | None = None,
) -> CellFigures:
    """Measure one cell in this process; a fleet that runs out of orders is not measured any longer.

    Args:
        n_cars: Fleet size.
        fidelity: How robots are moved.
        floor: Site file; made if it is not there.
        until: When to stop, as `time.time` has it [s].
        most_sim_s: Simulated time after which it has seen enough [s].
        n_workers: Processes that share the physics.
        n_orders: Orders at the start; None = two for each car, and some.

    Raises:
        FleetError: The run was refused.
        FloorTooLarge: The floor has no room in memory at this fidelity.
    """
    begin = time.perf_counter()
    if not floor.exists():
        save_site(floor_for(n_cars), floor)
    config = RunConfig(
        site=str(floor),
        robots=n_cars,
        tasks=2 * n_cars + 300 if n_orders is None else n_orders,
        duration_s=most_sim_s,
        fidelity=fidelity,
        traffic=TrafficConfig.usual(fidelity),
        arms=ArmConfig(workers_n=0),
        physics=PhysicsConfig(workers_n=n_workers),
    )
    if fidelity is Fidelity.ABSTRACT:
        return _abstract_cell(config, begin, until)
    with Simulation(config) as simulation, settled():
        world = simulation.world
        while not world.car_speeds().any() and time.time() < until:
            simulation.tick()
        first_move_s = time.perf_counter() - begin
        while simulation.sim_s < WARM_UP_S and time.time() < until:
            simulation.tick()
        warm = _Moment.now(simulation.sim_s)
        count = simulation.board.count
        while any(map(count, NOT_BEGUN)) and not simulation.finished and time.time() < until:
            simulation.tick()
        end = _Moment.now(simulation.sim_s)
        done_s = np.array([task.done_s or 0.0 for task in simulation.board.in_state(*DONE_STATES)])
        contacts = world.contacts()
        spent = simulation.metrics.time_accounts.fleet_time()
        return _figures(warm, end, first_move_s, done_s, spent, contacts.robot + contacts.static)


def _abstract_cell(config: RunConfig, begin: float, until: float) -> CellFigures:
    """The same of an abstract run; its cars do not touch, as one timestep leads to the next."""
    run = AbstractRun(config)
    run.step()
    first_move_s = time.perf_counter() - begin
    while run.sim_s < WARM_UP_S and time.time() < until:
        run.step()
    warm = _Moment.now(run.sim_s)
    stages = run.fleet.tasks.stage
    while (stages <= Stage.READY).any() and run.sim_s < config.duration_s and not run.stalled and time.time() < until:
        run.step()
    end = _Moment.now(run.sim_s)
    return _figures(warm, end, first_move_s, run.told().done_s, run.accounts.car_time(), 0)


class _Moment(NamedTuple):
    """A moment of a run, on three clocks [s]."""

    sim_s: float
    wall_s: float
    cpu_s: float

    @classmethod
    def now(cls, sim_s: float) -> _Moment:
        return cls(sim_s, time.perf_counter(), time.process_time())


def _figures(
    warm: _Moment, end: _Moment, first_move_s: float, done_s: FloatArray, spent: CarTime, contacts: int
) -> CellFigures:
    """What was measured between two moments; `done_s` of tasks that are not done is infinite."""
    sim_s, wall_s, cpu_s = (after - before for before, after in zip(warm, end, strict=True))
    late = int(((done_s > end.sim_s / 2) & np.isfinite(done_s)).sum())
    at_work = spent.driving_loaded + spent.driving_empty + spent.served
    return CellFigures(
        real_time_factor=sim_s / wall_s if sim_s >= LEAST_SIM_S else None,
        memory_mb=peak_memory_mb(),
        tasks_per_h=late * 3600.0 / (end.sim_s / 2) if end.sim_s >= LEAST_TASKS_SIM_S else None,
        at_work_share=at_work / max(sum(vars(spent).values()), 1),
        contacts=contacts,
        first_move_s=first_move_s,
        sim_s=end.sim_s,
        core_share=cpu_s / max(wall_s, 1e-9),
    )


def peak_memory_mb() -> float:
    """The most that this process ever had in memory [MB]."""
    try:
        # Where the kernel tells of this process alone: what `getrusage` tells begins with its parent's.
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return next(float(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) / 1024.0
    except (OSError, StopIteration):
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return most / (2.0**20 if sys.platform == "darwin" else 1024.0)
