"""The view command: the viewer opens on a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fleet.cli.recordings.run_recording import moment_of, shown_recording_of
from fleet.cli.run_output import plain_console, show_recording


@dataclass(frozen=True, kw_only=True)
class View:
    """Open the viewer on the recording of a run; without a display, say how to look at it."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Directory of a run, or its recording."""
    at: str | None = None
    """Simulated time to show [s], or longest-wait; where the recording opens if not given."""

    def run(self) -> int:
        """Open it."""
        path = shown_recording_of(self.folder)
        show_recording(plain_console(), path, view=True, at_s=moment_of(self.at, path))
        return 0
