"""The capacity command: how large a fleet this machine runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from fleet.cli.run_output import INTERRUPTED, PLAIN_WIDTH, plain_console
from fleet.cli.scale.fidelities import EVERY, parse_fidelities
from fleet.config import require
from fleet.outputs import require_folder
from fleet.study.design import parse_range
from fleet.terminal.interrupts import interrupts
from fleet.terminal.progress_bar import Bar

if TYPE_CHECKING:
    from fleet.scale.capacity import CapacityCell

DONE = 0
MOST_ROBOTS = 100_000
MOST_MINUTES = 600.0
QUIET = 0.9
"""Share of a core below which a cell was held up by other programs."""
MARK = "~"
"""Before a figure that was extrapolated."""


@dataclass(frozen=True, kw_only=True)
class CapacityCommand:
    """Measure how large a fleet this machine runs at which speed; prints a table, writes JSON and a plot."""

    robots: str = "10,100,1000,10000"
    """Numbers of cars, as in the study: a number, a range, a range with a step, or a list."""
    fidelities: str = EVERY
    """Fidelities, separated by commas."""
    minutes: float = 3.0
    """Wall time in all; what does not fit is extrapolated, and marked [min]."""
    out: Path = Path("runs/capacity")
    """Directory for capacity.json and a plot of each figure, as SVG and PNG."""

    def run(self) -> int:
        """Measure, print and write; returns the exit status."""
        robots = parse_range(self.robots, "--robots")
        require(max(robots) <= MOST_ROBOTS, "--robots", self.robots, f"numbers from 1 to {MOST_ROBOTS}")
        fidelities = parse_fidelities(self.fidelities)
        minutes_ok = 0.0 < self.minutes <= MOST_MINUTES
        require(minutes_ok, "--minutes", self.minutes, f"a number > 0, at most {MOST_MINUTES:g}")
        # The simulation takes a second to load: only for runs, not for --help.
        from fleet.scale.capacity import JSON_FILE, capacity_plots, measure_capacity, write_capacity

        require_folder("--out", self.out)
        n_cells = len(robots) * len(fidelities)
        with interrupts() as interrupted, Bar(n_cells, "cells", shown=True) as bar:

            def progress(done: int, now: str) -> None:
                bar.show(done, now, f"{done} of {n_cells} cells done; now {now}")

            cells = measure_capacity(robots, fidelities, self.minutes, interrupted=interrupted, progress=progress)
        plots = capacity_plots(cells)
        write_capacity(self.out, cells, plots, self.minutes)
        console = plain_console(columns=PLAIN_WIDTH)
        console.print(_table(cells))
        if any(cell.extrapolated for cell in cells):
            console.print(
                f"{MARK} was not measured: continued from smaller fleets of the same fidelity, memory by a line and "
                "speed by a power law; tasks/h are those of another fidelity, or at most what the arms could do.",
                soft_wrap=True,
            )
        shares = [cell.core_share for cell in cells if cell.core_share is not None]
        if shares and min(shares) < QUIET:
            console.print(
                f"The machine was busy: cells had {100.0 * min(shares):.0f} to {100.0 * max(shares):.0f} % of a core, "
                "so speeds are low.",
                soft_wrap=True,
            )
        for cell in cells:
            if cell.why:
                console.print(f"{cell.robots} robots, {cell.fidelity}, not measured: {cell.why}", soft_wrap=True)
        beside = f"; beside it {', '.join(plots)} as SVG and PNG" if plots else ", none of which could be drawn"
        console.print(f"{self.out / JSON_FILE}: the figures{beside}", soft_wrap=True)
        return INTERRUPTED if interrupted else DONE


def _table(cells: Sequence[CapacityCell]) -> Table:
    table = Table(title="what this machine runs")
    table.add_column("robots", justify="right")
    table.add_column("fidelity")
    for heading in ("real-time factor", "memory [MB]", "tasks/h", "cars at work", "first move [s]", "simulated [s]"):
        table.add_column(heading, justify="right")
    for cell in cells:
        table.add_row(
            f"{cell.robots:,}",
            cell.fidelity,
            _figure(cell, "real_time_factor", ".3g"),
            _figure(cell, "memory_mb", ",.0f"),
            _figure(cell, "tasks_per_h", ",.0f"),
            "-" if cell.at_work_share is None else f"{100.0 * cell.at_work_share:.0f} %",
            "-" if cell.first_move_s is None else f"{cell.first_move_s:.1f}",
            "-" if cell.sim_s is None else f"{cell.sim_s:.0f}",
        )
    return table


def _figure(cell: CapacityCell, name: str, form: str) -> str:
    value = getattr(cell, name)
    if value is None:
        return "-"
    return f"{MARK if name in cell.extrapolated else ''}{value:{form}}"
