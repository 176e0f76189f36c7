"""Capacity: which fleet this machine runs at which speed, cell by cell, and what is extrapolated from that."""

from __future__ import annotations

import json
import math
import os
import platform
import tempfile
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fleet.charts.drawing import Drawing
from fleet.charts.log_chart import LogPoint, LogSeries, draw_log
from fleet.config import Fidelity
from fleet.recording.run_file import plain
from fleet.scale.cell import WARM_UP_S, CellFigures, run_cell
from fleet.scale.floors import n_drop_stations
from fleet.stations.service_time import PRIOR_MEAN_S
from fleet.whole_file import write_whole

JSON_FILE = "capacity.json"
FIGURES: Mapping[str, str] = {
    "real_time_factor": "Real-time factor",
    "memory_mb": "Memory [MB]",
    "tasks_per_h": "Tasks per hour",
}
"""Figures that are drawn and, where they are missing, extrapolated; each with its title."""
N_NEAREST = 3
"""Measured sizes, the greatest ones, through which a line is laid."""
LEAST_CELL_S = 6.0
"""Wall time below which no cell is begun: a process alone needs a few seconds to load [s]."""
OWN_S = 5.0
"""Wall time for the command itself [s]."""
COMPILED_S = 20.0
"""A first cell that takes longer has compiled the kernels, which happens once: its time does not count [s]."""
WARM_UP_WALL_S = 600.0
"""Most wall time for that [s]."""
NO_TIME = "no time was left"
"""Why a cell was not begun."""
ORDERS_PER_CAR, MOST_ORDERS_MORE = 12, 10_000
"""So that orders last: of the fastest fleets a car makes ten deliveries in the time of a cell."""


CellKey = tuple[int, Fidelity]
"""Number of cars, and how they are moved."""


@dataclass(frozen=True, kw_only=True)
class CapacityCell:
    """One fleet size at one fidelity."""

    robots: int
    fidelity: str
    real_time_factor: float | None
    """None where it is neither measured nor can be extrapolated; this and the following two."""
    memory_mb: float | None
    tasks_per_h: float | None
    at_work_share: float | None
    """None where it was not measured, this and the following four; see `CellFigures`."""
    contacts: int | None
    first_move_s: float | None
    sim_s: float | None
    core_share: float | None
    extrapolated: tuple[str, ...]
    """Which of the figures are."""
    why: str
    """Why the cell was not measured; empty if it was."""


def measure_capacity(
    robots: Sequence[int],
    fidelities: Sequence[Fidelity],
    minutes: float,
    *,
    interrupted: Sequence[int],
    progress: Callable[[int, str], None],
) -> tuple[CapacityCell, ...]:
    """Measure what fits into the time and extrapolate the rest.

    The cells are measured one after the other, the small ones first, each in a process of its own with a share of the
    wall time that is left; the shares grow with the logarithm of the size. When a fidelity has failed at a size,
    greater ones are not tried. What is left in the end goes to the first cell of each fidelity that failed. Before all
    that a single car of each fidelity drives for a moment, so that the kernels are compiled.

    Args:
        robots: Fleet sizes, ascending.
        fidelities: At which they are measured.
        minutes: Wall time in all, without that of compiling [min].
        interrupted: Becomes non-empty when the user wants to stop: then the rest is extrapolated.
        progress: Told the number of cells that are done, and what is measured now.

    Raises:
        FleetError: A run was refused.
    """
    begin = time.monotonic()
    measured: dict[CellKey, CellFigures] = {}
    why: dict[CellKey, str] = {}
    cells = [(n, fidelity) for n in robots for fidelity in fidelities]
    with tempfile.TemporaryDirectory() as folder:

        def attempt(key: CellKey, share: float) -> None:
            n, fidelity = key
            left_s = until - time.monotonic()
            wall_s = max(LEAST_CELL_S, share * left_s)
            if interrupted or wall_s > left_s:
                why.setdefault(key, "interrupted" if interrupted else NO_TIME)
                return
            progress(len(measured), f"{n} robots, {fidelity}")
            floor = Path(folder) / f"{n}.toml"
            answer = run_cell(n, fidelity, floor, wall_s, interrupted, n_orders=enough_orders(n))
            if isinstance(answer, str):
                why[key] = answer
            elif answer.real_time_factor is None:
                why[key] = f"only {answer.sim_s:.1f} s were simulated within {wall_s:.0f} s"
            else:
                measured[key] = answer
                why.pop(key, None)

        for fidelity in fidelities:
            progress(0, f"kernels, {fidelity}")
            run_cell(1, fidelity, Path(folder) / "1.toml", WARM_UP_WALL_S, interrupted, most_sim_s=WARM_UP_S)
        compiled_s = time.monotonic() - begin
        until = begin + 60.0 * minutes - OWN_S + (compiled_s if compiled_s > COMPILED_S * len(fidelities) else 0.0)
        for k, key in enumerate(cells):
            failed = next((n for n, fidelity in why if fidelity is key[1]), None)
            if failed is None:
                attempt(key, time_share(cells[k:], why))
            elif interrupted:
                why[key] = "interrupted"
            else:
                why[key] = NO_TIME if why[failed, key[1]] == NO_TIME else f"{failed} robots did not fit"
        again = [next(key for key in why if key[1] is kind) for kind in fidelities if any(kind is f for _, f in why)]
        for k, key in enumerate(again):
            attempt(key, 1.0 / (len(again) - k))
            if key in measured:
                why |= {other: NO_TIME for other in why if other[1] is key[1]}
    return tuple(complete(key, measured, why.get(key, "")) for key in cells)


def time_share(cells: Sequence[CellKey], failed: Collection[CellKey]) -> float:
    """Which share of the time that is left the first of some cells may have, if no failed fidelity is tried again."""
    kinds = {kind for _, kind in failed}
    weights = [1.0 + math.log10(n) for n, fidelity in cells if fidelity not in kinds]
    return weights[0] / sum(weights)


def enough_orders(n_cars: int) -> int:
    """Orders of a cell, which are waiting from the start: with too few a fleet would run empty, and deliver less."""
    return 300 + min(ORDERS_PER_CAR * n_cars, 2 * n_cars + MOST_ORDERS_MORE)


def extrapolate(known: Mapping[int, float | None], size: int, *, power: bool = True) -> float | None:
    """Continue measured values to another size.

    A straight line is laid by least squares through the `N_NEAREST` greatest sizes, in logarithms for a power law: what
    a fleet costs grows with a power of its size, which itself grows a little, so the greatest sizes count alone. What
    limits anew beyond them is not foreseen.

    Args:
        known: What was measured, above zero, by size; None and zero do not count.
        size: The size that is asked for.
        power: False lays the line through the values themselves.

    Returns:
        None with fewer than two measured sizes.
    """
    points = sorted((n, value) for n, value in known.items() if value)[-N_NEAREST:]
    if len(points) < 2:
        return None
    x, y = np.array(points, dtype=np.float64).T
    if not power:
        slope, level = np.polyfit(x, y, 1)
        return float(level + slope * size)
    slope, level = np.polyfit(np.log(x), np.log(y), 1)
    return math.exp(level + slope * math.log(size))


def complete(key: CellKey, measured: Mapping[CellKey, CellFigures], why: str) -> CapacityCell:
    """One cell with what is missing extrapolated from the smaller ones of its fidelity.

    Memory is that of an empty process and more for each car, so a line is laid through it as it is. Deliveries hardly
    depend on the fidelity, as the gap command shows: where there was no time for them, those of the others at the same
    size stand for them, or else they are continued from the smaller sizes of all, up to what the arms could do.

    Args:
        key: Which cell.
        measured: All cells that were measured.
        why: Why this one was not; empty if it was.
    """
    n, fidelity = key
    mine = measured.get(key)
    smaller = {size: cell for (size, kind), cell in measured.items() if kind is fidelity and size < n}
    speed = mine.real_time_factor if mine is not None else None
    memory = mine.memory_mb if mine is not None else None
    tasks = mine.tasks_per_h if mine is not None else None
    known = (speed is not None, memory is not None, tasks is not None)
    if speed is None:
        speed = _speed(smaller, n)
    if memory is None:
        memory = extrapolate({size: cell.memory_mb for size, cell in smaller.items()}, n, power=False)
    if tasks is None:
        tasks = _tasks_of_all(n, measured)
    values = {"real_time_factor": speed, "memory_mb": memory, "tasks_per_h": tasks}
    missed = [name for name, was_known in zip(FIGURES, known, strict=True) if not was_known]
    return CapacityCell(
        robots=n,
        fidelity=fidelity.value,
        **values,
        at_work_share=None if mine is None else mine.at_work_share,
        contacts=None if mine is None else mine.contacts,
        first_move_s=None if mine is None else mine.first_move_s,
        sim_s=None if mine is None else mine.sim_s,
        core_share=None if mine is None else mine.core_share,
        extrapolated=tuple(name for name in missed if values[name] is not None),
        why=why,
    )


def _speed(smaller: Mapping[int, CellFigures], n: int) -> float | None:
    """Real-time factor of `n` cars, with as much of a core as the smaller fleets had on average.

    Without that, one of them that was held up by other programs would bend the line.
    """
    shares = {size: max(cell.core_share, 1e-3) for size, cell in smaller.items()}
    alone = {size: (cell.real_time_factor or 0.0) / shares[size] for size, cell in smaller.items()}
    found = extrapolate(alone, n)
    return None if found is None else found * sum(shares.values()) / len(shares)


def _tasks_of_all(n: int, measured: Mapping[CellKey, CellFigures]) -> float | None:
    """Tasks per hour of `n` cars, whatever moves them."""
    by_size: dict[int, list[float]] = {}
    for (size, _), cell in measured.items():
        if cell.tasks_per_h is not None:
            by_size.setdefault(size, []).append(cell.tasks_per_h)
    means = {size: sum(values) / len(values) for size, values in by_size.items()}
    if n in means:
        return means[n]
    found = extrapolate({size: mean for size, mean in means.items() if size < n}, n)
    return None if found is None else min(found, n_drop_stations(n) * 3600.0 / PRIOR_MEAN_S)


def capacity_plots(cells: Sequence[CapacityCell]) -> dict[str, Drawing]:
    """One chart for each figure that anything is known of, by its name."""
    plots = {}
    fidelities = list(dict.fromkeys(cell.fidelity for cell in cells))
    for name, title in FIGURES.items():
        series = []
        for fidelity in fidelities:
            points = [
                LogPoint(x=cell.robots, y=getattr(cell, name), measured=name not in cell.extrapolated)
                for cell in cells
                if cell.fidelity == fidelity and getattr(cell, name)
            ]
            series.append(LogSeries(name=fidelity, points=tuple(points)))
        if any(one.points for one in series):
            plots[name] = draw_log(title, "over the number of robots; rings and dashes are extrapolated", series)
    return plots


def write_capacity(out: Path, cells: Sequence[CapacityCell], plots: Mapping[str, Drawing], minutes: float) -> None:
    """Write all cells as JSON, with the machine they were measured on, and the plots as SVG and PNG."""
    out.mkdir(parents=True, exist_ok=True)
    machine = {"processor": platform.processor() or platform.machine(), "cores": len(os.sched_getaffinity(0))}
    whole = {"machine": machine, "minutes": minutes, "cells": plain(cells)}
    write_whole(out / JSON_FILE, json.dumps(whole, indent=2) + "\n")
    for name, plot in plots.items():
        plot.write(out, name)
