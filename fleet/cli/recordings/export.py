"""The export command: a run in the format of another world's tools."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fleet.cli.recordings.run_recording import run_of
from fleet.cli.run_output import plain_console
from fleet.config import require
from fleet.outputs import require_file

MOST_HZ = 1000.0


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a run as an MCAP file of ROS 2 messages, for Foxglove, PlotJuggler or `ros2 bag play`."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Directory of the run, or its run.jsonl; it may have been killed."""
    mcap: Path
    """The file to write."""
    rate_hz: float = 30.0
    """Samples per simulated second at most."""

    def run(self) -> int:
        """Make the run again and write it down; one that does not come out the same raises."""
        from fleet.recording.run_file import RUN_FILES
        from fleet.replay.again import load_recorded
        from fleet.replay.export import export_mcap
        from fleet.terminal.progress_bar import Bar

        require(0.0 < self.rate_hz <= MOST_HZ, "--rate-hz", self.rate_hz, f"a number > 0, at most {MOST_HZ:g}")
        folder = run_of(self.folder)
        require_file("--mcap", self.mcap, *(folder / name for name in RUN_FILES))
        recorded = load_recorded(folder)
        n_ticks = recorded.run.trace.n_ticks
        with Bar(n_ticks, "ticks", shown=sys.stdout.isatty()) as bar:

            def look(done: int) -> None:
                if bar.due():
                    bar.show(done, "the run again", f"ticks made again: {done} of {n_ticks}")

            made = export_mcap(recorded, self.mcap, rate_hz=self.rate_hz, look=look)
        size_mb = self.mcap.stat().st_size / 1e6
        said = f"{made.n_messages:,} messages, {made.sim_s:.1f} s, {size_mb:.1f} MB; every tick is as recorded"
        plain_console().print(f"{self.mcap}: {said}", soft_wrap=True)
        return 0
