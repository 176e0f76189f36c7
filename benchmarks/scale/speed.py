"""Speed: real-time factor, memory and first move of whole runs, each in a process of its own, without recording."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.harness import Kind, Row, Trial
from fleet.config import Fidelity
from fleet.scale.cell import CellFigures, run_cell

SIM_S, QUICK_SIM_S = 300.0, 20.0
"""Simulated time of a run [s]."""
PHYSICS_SIM_S = 10.0
"""The same with physics, which costs alike from the first second on."""
WALL_S, QUICK_WALL_S = 1800.0, 60.0
"""Most wall time of a run [s]."""
SHARED_BY_TWO, QUICK_SHARED = 1_000, 100
"""Cars of the fleet whose physics two processes share."""
QUICK_MOST = 200
"""Greatest fleet that --quick makes."""
AT_WORK = 0.8
"""Share of their time that cars drive or are served: parked cars cost nothing, so a run of them shows nothing."""


def measure_kinematic(trial: Trial) -> Iterator[Row]:
    """50, 200 and 1,000 cars without physics."""
    for n, speed in ((50, ">= 250"), (200, ">= 100"), (1000, ">= 25")):
        most = ("<= 500", "<= 4") if n == 1000 else ("", "")
        yield from _rows(trial, n, Fidelity.KINEMATIC, speed, memory=most[0], first_move=most[1])


def measure_large(trial: Trial) -> Iterator[Row]:
    """10,000 cars without physics."""
    yield from _rows(trial, 10_000, Fidelity.KINEMATIC, ">= 2", memory="<= 3000")


def measure_grid(trial: Trial) -> Iterator[Row]:
    """1,000 and 10,000 cars on the grid, where a timestep is one simulated second: abstract, then whole runs."""
    for fidelity in (Fidelity.ABSTRACT, Fidelity.GRID):
        yield from _rows(trial, 1000, fidelity, ">= 150")
        yield from _rows(trial, 10_000, fidelity, ">= 15", memory="<= 4000")


def measure_mixed(trial: Trial) -> Iterator[Row]:
    """100, 300 and 1,000 cars with physics where arms work."""
    for n, speed in ((100, ">= 8"), (300, ">= 4"), (1000, ">= 1.5")):
        yield from _rows(trial, n, Fidelity.MIXED, speed, memory="<= 1500")


def measure_physics(trial: Trial) -> Iterator[Row]:
    """What a car costs with physics, from 50 to 1,000 of them."""
    costs = {}
    for n in (50, 200, 1000):
        cell = _cell(trial, n, Fidelity.PHYSICS, PHYSICS_SIM_S)
        if cell is None or cell.real_time_factor is None:
            continue
        costs[n] = 1000.0 / (cell.real_time_factor * n)
        yield Row(name=f"{n:,} cars, physics: a car and second", value=costs[n], unit="ms", kind=Kind.TIME)
        yield _memory(n, Fidelity.PHYSICS, cell, "<= 2000" if n == 1000 else "")
    if len(costs) > 1:
        least, most = min(costs), max(costs)
        target = "<= 1.3" if most == 1000 else ""
        name = f"physics: cost of a car among {most:,}, by that among {least:,}"
        yield Row(name=name, value=costs[most] / costs[least], unit="", target=target)
    yield from _measure_workers(trial)


def _measure_workers(trial: Trial) -> Iterator[Row]:
    """Two processes that share the physics of a fleet, by two fleets at once that share nothing."""
    n = SHARED_BY_TWO if not trial.quick else QUICK_SHARED
    shared = _cell(trial, n, Fidelity.PHYSICS, PHYSICS_SIM_S, n_workers=2)
    with ThreadPoolExecutor() as pool:
        apart = list(pool.map(lambda _: _cell(trial, n, Fidelity.PHYSICS, PHYSICS_SIM_S), range(2)))
    factors = [cell.real_time_factor if cell is not None else None for cell in (shared, *apart)]
    if None in factors:
        return
    one, *both = (factor or 0.0 for factor in factors)
    name = f"{n:,} cars, physics: two processes share it, by two fleets at once"
    yield Row(name=name, value=100.0 * one / sum(both), unit="%", target="" if trial.quick else ">= 85")


def _rows(
    trial: Trial, n: int, fidelity: Fidelity, speed: str, *, memory: str = "", first_move: str = ""
) -> Iterable[Row]:
    cell = _cell(trial, n, fidelity, SIM_S)
    if cell is None:
        return
    where = f"{n:,} cars, {fidelity}"
    factor = math.nan if cell.real_time_factor is None else cell.real_time_factor
    yield Row(name=f"{where}: real-time factor", value=factor, unit="x", kind=Kind.RATE, target=speed)
    yield Row(name=f"{where}: driving or served", value=cell.at_work_share, unit="", target=f">= {AT_WORK}")
    yield _memory(n, fidelity, cell, memory)
    name = f"{where}: first move"
    yield Row(name=name, value=cell.first_move_s, unit="s", kind=Kind.TIME, target=first_move)


def _memory(n: int, fidelity: Fidelity, cell: CellFigures, target: str) -> Row:
    return Row(name=f"{n:,} cars, {fidelity}: memory", value=cell.memory_mb, unit="MB", target=target)


def _cell(trial: Trial, n: int, fidelity: Fidelity, sim_s: float, *, n_workers: int = 1) -> CellFigures | None:
    """Measure one fleet; what could not be is said below the table."""
    if trial.quick and n > QUICK_MOST:
        trial.notes.append(f"{n:,} cars, {fidelity}: not with --quick")
        return None
    nobody: Sequence[int] = ()
    with tempfile.TemporaryDirectory() as folder:
        wall_s, most_sim_s = (QUICK_WALL_S, min(sim_s, QUICK_SIM_S)) if trial.quick else (WALL_S, sim_s)
        floor = Path(folder) / "floor.toml"
        answer = run_cell(n, fidelity, floor, wall_s, nobody, most_sim_s=most_sim_s, n_workers=n_workers)
    if isinstance(answer, str):
        trial.notes.append(f"{n:,} cars, {fidelity}: {answer}")
        return None
    trial.check(answer.contacts == 0, f"{n:,} cars, {fidelity}: {answer.contacts} contacts")
    return answer
