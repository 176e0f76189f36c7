"""Which run or recording a command is about."""

from __future__ import annotations

import math
from pathlib import Path

from fleet.cli.run_output import longest_wait_in
from fleet.config import require
from fleet.errors import ConfigError

LONGEST_WAIT = "longest-wait"
"""What may be said instead of a time."""
_BEGINNING = b"RRF"
"""Of every file of rerun's."""


def recording_of(folder: Path) -> Path:
    """Find the recording of a run.

    Args:
        folder: Directory of a run, or the recording itself.

    Raises:
        ConfigError: There is none.
    """
    from fleet.recording.run_file import RECORDING

    if not folder.exists():
        raise ConfigError(f"FOLDER is {str(folder)!r}; valid: the --out directory of a run, or a recording")
    path = folder / RECORDING if folder.is_dir() else folder
    if not path.exists():
        raise ConfigError(f"no recording at {path}; valid: the --out directory of a run without --no-record")
    return path


def shown_recording_of(folder: Path) -> Path:
    """The recording of a run, which a viewer is to show.

    Args:
        folder: Directory of a run, or the recording itself.

    Raises:
        ConfigError: There is none, or it is something else.
    """
    path = recording_of(folder)
    with path.open("rb") as file:
        is_recording = file.read(len(_BEGINNING)) == _BEGINNING
    require(is_recording, "FOLDER", str(folder), "the --out directory of a run, or a recording (.rrd)")
    return path


def run_of(path: Path) -> Path:
    """Directory of the run that is meant by that directory, or by the run file in it."""
    from fleet.recording.run_file import EVENTS

    return path.parent if path.name == EVENTS else path


def moment_of(at: str | None, recording: Path) -> float | None:
    """The time that is meant by an option `--at` [s]; None if it is not given.

    Args:
        at: A number, or `LONGEST_WAIT`.
        recording: Of the run, beside its other files.

    Raises:
        ConfigError: It is neither, or no car waited.
        OutputError: There is no run beside the recording that could tell.
    """
    if at == LONGEST_WAIT:
        wait = longest_wait_in(recording.parent)
        require(wait is not None, "--at", at, "a time [s]: no car of this run waited for a second")
        return wait.at_s if wait is not None else None
    try:
        time_s = math.nan if at is None else float(at)
    except ValueError:
        time_s = -1.0
    require(at is None or 0.0 <= time_s < math.inf, "--at", at, f"a number >= 0, or {LONGEST_WAIT}")
    return None if at is None else time_s
