"""The mend command: the recording of a killed run is made whole."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fleet.cli.recordings.run_recording import recording_of
from fleet.cli.run_output import plain_console, show_recording


@dataclass(frozen=True, kw_only=True)
class Mend:
    """Make the recording of a killed run whole: it keeps all that can be read and passes `rerun rrd verify`."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Directory of a run that has ended, or its recording."""

    def run(self) -> int:
        """Mend and say what there is; bad input raises."""
        from fleet.recording.mend import mend_recording

        path = recording_of(self.folder)
        found = mend_recording(path)
        console = plain_console()
        said = f"mended: all {found.rows} rows that could be read" if found.changed else f"whole: {found.rows} rows"
        console.print(said, soft_wrap=True)
        show_recording(console, path, view=False)
        return 0
