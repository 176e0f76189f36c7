"""OutputFile: a file that a run writes while it lasts, whole up to the last thing that was written."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from fleet.recording.errors import OutputError


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
            self._file: BinaryIO = (directory / name).open("wb")
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
        """Write something out at once: a killed process leaves all that happened before."""
        self._file.write(content)
        self._file.flush()
