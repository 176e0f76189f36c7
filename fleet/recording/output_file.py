"""OutputFile: a file that a run writes while it lasts, whole up to the last thing that was written."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import TracebackType
from typing import Self

from fleet.recording.errors import OutputError

LEAST_FREE_BYTES = 20_000_000
"""With less room on the disk nothing is begun, and a recording ends: rerun waits for minutes on a disk that is full,
and the other files of a run need some of it to come to their end."""


def require_room(directory: Path) -> None:
    """Ask whether there is room for files in a directory that exists.

    Raises:
        OutputError: There is not.
    """
    free = shutil.disk_usage(directory).free
    if free < LEAST_FREE_BYTES:
        raise OutputError(
            f"{directory}: {free / 1e6:.1f} MB are free on its disk; valid: at least {LEAST_FREE_BYTES / 1e6:.0f} MB, "
            "or another directory (--out)"
        )


class OutputFile:
    """One file in the directory of a run; use as a context manager, or call `close`.

    Args:
        directory: As returned by `prepare_output`.
        name: Of the file, which is replaced.

    Raises:
        OutputError: The file cannot be opened.
    """

    def __init__(self, directory: Path, name: str) -> None:
        try:
            self._file = (directory / name).open("wb", buffering=0)
        except OSError as error:
            raise OutputError(f"--out {directory}: {name} cannot be written: {error.strerror}") from error

    def close(self) -> None:
        """Close the file; calling twice is harmless."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _append(self, content: bytes) -> None:
        """Write something out at once: a killed process leaves all that happened before.

        Raises:
            OutputError: It cannot be written, such as on a disk that is full.
        """
        left = memoryview(content)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(
                f"{self._file.name}: {reason}; valid: room on its disk, or another directory (--out)"
            ) from error
