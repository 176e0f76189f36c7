"""The film command: a part of a run as a moving picture."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fleet.cli.recordings.picture_file import require_writable
from fleet.cli.recordings.run_recording import run_of
from fleet.cli.run_output import plain_console
from fleet.config import require
from fleet.whole_file import write_whole

WIDTH_PX = 1000
LEAST_PX_PER_M, MOST_PX_PER_M = 8.0, 60.0
MOST_S = 120.0
"""A longer film is too large a file for pages: five cars and twelve arms make 0.2 MB in 40 s."""


@dataclass(frozen=True, kw_only=True)
class FilmOfRun:
    """Run a run again and draw a part of it as a moving picture (SVG), which browsers and pages play."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Directory of the run, or its run.jsonl; it may have been killed."""
    svg: Annotated[Path, tyro.conf.Positional]
    """Moving picture to write."""
    at: float = 0.0
    """Simulated time at which it begins [s]."""
    length: float = 30.0
    """How long it is [s], or less where the run ends."""

    def run(self) -> int:
        """Draw."""
        from fleet.replay.again import load_recorded
        from fleet.replay.film import SAMPLE_S, film
        from fleet.simulation import Simulation
        from fleet.terminal.progress_bar import Bar

        require(SAMPLE_S <= self.length <= MOST_S, "--length", self.length, f"a number from {SAMPLE_S} to {MOST_S:g}")
        require_writable("SVG", self.svg, ".svg")
        recorded = load_recorded(run_of(self.folder))
        latest_s = recorded.end_s - SAMPLE_S
        long_enough = f"a run of more than {SAMPLE_S:g} s"
        require(latest_s > 0.0, "FOLDER", f"a run of {recorded.end_s:g} s", long_enough)
        within = math.isfinite(self.at) and 0.0 <= self.at <= latest_s
        require(within, "--at", self.at, f"a number from 0 to {latest_s:g}, before the run ends")
        length_s = min(self.length, recorded.end_s - self.at)
        until_s = self.at + length_s
        with Simulation(recorded.config) as run, Bar(round(until_s), "s", shown=sys.stdout.isatty()) as bar:

            def told(now_s: float) -> None:
                if bar.due():
                    bar.show(round(now_s), "running", f"{now_s:.0f} of {until_s:.0f} s")

            width_m = run.site.grid.cols * run.site.grid.cell_m
            px_per_m = min(max(WIDTH_PX / width_m, LEAST_PX_PER_M), MOST_PX_PER_M)
            text = film(run, begin_s=self.at, length_s=length_s, px_per_m=px_per_m, told=told)
        write_whole(self.svg, text)
        plain_console().print(f"film: {self.svg}", soft_wrap=True)
        return 0
