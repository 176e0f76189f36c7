"""The shot command: a picture of a recording."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fleet.cli.recordings.picture_file import require_writable
from fleet.cli.recordings.run_recording import moment_of, shown_recording_of
from fleet.cli.run_output import plain_console
from fleet.config import require

COMPLAINED = 1
MOST_PX = 8192


@dataclass(frozen=True, kw_only=True)
class Shot:
    """Paint a recording at one time and save the picture; needs no display."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Directory of a run, or its recording."""
    png: Annotated[Path, tyro.conf.Positional]
    """Picture to write."""
    at: str | None = None
    """Simulated time [s], or longest-wait; where the recording opens if not given."""
    size: str = "1600x900"
    """Width and height in pixels."""
    view: str | None = None
    """Name of the one view to paint; the whole window if not given."""

    def run(self) -> int:
        """Paint; exit status 1 if the viewer complained."""
        from fleet.recording.shot import parse_size, screenshot

        width, height = parse_size(self.size) or (0, 0)
        fits = 0 < width <= MOST_PX and 0 < height <= MOST_PX
        require(fits, "--size", self.size, f"WIDTHxHEIGHT, each from 1 to {MOST_PX}")
        path = shown_recording_of(self.folder)
        at_s = moment_of(self.at, path)
        require_writable("PNG", self.png, ".png")
        complaints = screenshot(path, self.png, time_s=at_s, size=(width, height), view=self.view)
        sys.stderr.writelines(f"{complaint}\n" for complaint in complaints)
        plain_console().print(f"picture: {self.png}", soft_wrap=True)
        return COMPLAINED if complaints else 0
