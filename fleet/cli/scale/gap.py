"""The gap command: one scenario at several fidelities, and how far they are apart."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.table import Table

from fleet.cli.run_output import INTERRUPTED, PLAIN_WIDTH, plain_console
from fleet.cli.scale.fidelities import EVERY_WHOLE, parse_fidelities
from fleet.config import StreamConfig, require
from fleet.outputs import require_folder
from fleet.study.design import MOST_SEEDS, usual_rate_per_h
from fleet.terminal.interrupts import interrupts
from fleet.terminal.progress_bar import Bar

if TYPE_CHECKING:
    from fleet.scale.gap import Gap

DONE = 0


@dataclass(frozen=True, kw_only=True)
class GapCommand:
    """Run one scenario at several fidelities; prints how far they are apart, writes CSV, JSON and a plot."""

    site: Annotated[str, tyro.conf.Positional]
    """Name of a shipped site or path of a site file."""
    robots: int = 3
    """Number of cars."""
    seeds: int = 3
    """Number of seeds; each has its own orders, the same at every fidelity. Intervals need two or more."""
    duration: float = 600.0
    """Simulated time of each run [s]."""
    fidelities: str = EVERY_WHOLE
    """Fidelities, separated by commas; the others are compared with physics, or with the first if it is not among
    them. There is one more, abstract."""
    rate: float | None = None
    """Orders per hour; default 90 for each car, more than it can deliver."""
    orders: Path | None = None
    """File of orders in place of generated ones, as in the demo."""
    jobs: int | None = None
    """Runs at once; default one per core."""
    out: Path = Path("runs/gap")
    """Directory for gap.csv, gap.json and the plot, as SVG and PNG."""

    def run(self) -> int:
        """Run, compare and print; returns the exit status."""
        require(self.robots >= 1, "--robots", self.robots, "an integer >= 1")
        require(1 <= self.seeds <= MOST_SEEDS, "--seeds", self.seeds, f"an integer from 1 to {MOST_SEEDS}")
        require(0.0 < self.duration < 1e6, "--duration", self.duration, "a number > 0, at most a million")
        require(self.jobs is None or self.jobs >= 1, "--jobs", self.jobs, "an integer >= 1")
        require(self.rate is None or self.orders is None, "--rate", self.rate, "without --orders")
        fidelities = parse_fidelities(self.fidelities)
        rate_per_h = usual_rate_per_h(self.robots) if self.rate is None else self.rate
        # The simulation takes a second to load: only for runs, not for --help.
        from fleet.scale.gap import PLOT, check_gap, find_gaps, gap_plot, run_gap, safety_sentences, write_gap
        from fleet.scale.gap_run import GapDesign

        design = GapDesign(
            site=self.site,
            robots=self.robots,
            seeds=tuple(range(self.seeds)),
            fidelities=fidelities,
            duration_s=self.duration,
            stream=StreamConfig(rate_per_h=rate_per_h) if self.orders is None else None,
            orders=self.orders,
        )
        refused = check_gap(design)
        require_folder("--out", self.out)
        with interrupts() as interrupted, Bar(len(design.configs), "runs", shown=True) as bar:

            def progress(done: int, total: int) -> None:
                if bar.due():
                    bar.show(done, f"{total - done} to go", f"{done} of {total} runs done")

            jobs = self.jobs or len(os.sched_getaffinity(0))
            rows = run_gap(design, jobs=jobs, interrupted=interrupted, progress=progress)
        console = plain_console(columns=PLAIN_WIDTH)
        gaps = find_gaps(rows, design.reference, design.others)
        if rows:
            seeds = f"{self.seeds} seed{'s' if self.seeds > 1 else ''} of {self.duration:g} s"
            title = f"{Path(self.site).stem}, {self.robots} car{'s' if self.robots > 1 else ''}, {seeds}"
            write_gap(self.out, design, rows, gaps, gap_plot(gaps, design.reference, design.others, title), refused)
            console.print(_table(gaps, design.reference, title))
            for sentence in (*refused, *safety_sentences(rows, design.fidelities)):
                console.print(sentence, soft_wrap=True)
            console.print(f"plot: {self.out / PLOT}.svg", soft_wrap=True)
        if n_open := len(design.configs) - len(rows):
            console.print(f"interrupted: {n_open} run{'s are' if n_open > 1 else ' is'} missing")
            return INTERRUPTED
        return DONE


def _table(gaps: Sequence[Gap], reference: str, title: str) -> Table:
    from fleet.study.conclusions import between

    table = Table(title=title)
    table.add_column("figure", no_wrap=True)
    table.add_column("fidelity")
    for name in ("mean", reference, "difference", "in %"):
        table.add_column(name, justify="right", no_wrap=True)
    for gap in gaps:
        table.add_row(
            gap.figure,
            gap.fidelity,
            between(gap.value),
            between(gap.reference),
            between(gap.difference, sign=True),
            between(gap.share, scale=100.0, sign=True),
        )
    return table
