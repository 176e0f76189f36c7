"""Mend: a recording that a killed run left becomes one that the viewer's own check accepts."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess

from fleet.recording.errors import RecordingError
from fleet.recording.rerun_cli import run_rerun
from fleet.whole_file import draft_of

_ROWS = re.compile(r"^num_rows = ([\d\s]+)$", re.MULTILINE)
"""The line of ``rerun rrd stats`` with the number of rows, in groups of three digits."""
_LONGEST_S = 3600.0
"""Wall time that reading a large recording may take [s]."""


@dataclass(frozen=True, kw_only=True)
class Mended:
    """What became of a recording."""

    rows: int
    """Rows that the viewer can read; after mending as many as before."""
    changed: bool
    """False if it was whole already, and was left as it was."""


def mend_recording(path: Path) -> Mended:
    """Write a recording anew with the index at its end that a killed run did not come to write.

    The viewer's own program reads all that is whole and writes it to a second file. Only when that one passes
    ``rerun rrd verify`` and has every row that could be read does it take the place of the first, in one step: whatever
    happens before, the recording is there as it was.

    Args:
        path: The recording of a run that has ended.

    Returns:
        What is in it now.

    Raises:
        RecordingError: There is no recording, none of it can be read, or it is still being written.
    """
    if not path.is_file():
        raise RecordingError(f"no recording at {path}; valid: the recording of a run")
    before = path.stat()
    rows = readable_rows(path)
    if not rows:
        raise RecordingError(f"{path}: nothing in it can be read; valid: a recording with data")
    if _verified(path):
        return Mended(rows=rows, changed=False)
    with draft_of(path) as part:
        done = _rerun("optimize", str(path.resolve()), "-o", str(part))
        if done.returncode or not part.is_file() or not _verified(part):
            said = (done.stderr.strip().splitlines() or ["it gave no reason"])[-1]
            raise RecordingError(f"{path} cannot be mended: {said}; it was left as it was")
        kept = readable_rows(part)
        if kept != rows:
            raise RecordingError(f"{path}: {kept} of {rows} rows would be kept; it was left as it was")
        now = path.stat()
        if (now.st_size, now.st_mtime_ns) != (before.st_size, before.st_mtime_ns):
            raise RecordingError(f"{path} is still being written; valid: the recording of a run that has ended")
    return Mended(rows=rows, changed=True)


def readable_rows(path: Path) -> int:
    """How many rows the viewer's program can read, also of a file that ends anywhere."""
    found = _ROWS.search(_rerun("stats", str(path.resolve())).stdout)
    return int("".join(found.group(1).split())) if found else 0


def _verified(path: Path) -> bool:
    return _rerun("verify", str(path.resolve())).returncode == 0


def _rerun(*arguments: str) -> CompletedProcess[str]:
    return run_rerun(["rrd", *arguments], timeout_s=_LONGEST_S)
