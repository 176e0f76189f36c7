"""Which run or recording a command is about."""

from __future__ import annotations

from pathlib import Path

from fleet.errors import ConfigError


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


def run_of(path: Path) -> Path:
    """Directory of the run that is meant by that directory, or by the run file in it."""
    from fleet.recording.run_file import EVENTS

    return path.parent if path.name == EVENTS else path
