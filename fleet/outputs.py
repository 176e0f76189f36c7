"""Outputs: files and folders that a command is to write, refused before hours go into what they are for."""

from __future__ import annotations

import tempfile
from pathlib import Path

from fleet.errors import ConfigError
from fleet.whole_file import require_place


def require_file(option: str, path: Path | None, *inputs: Path, than: str = "what is read") -> None:
    """See that a file can be written, if there is to be one; leaves nothing behind.

    Args:
        option: What the command calls it.
        path: The file; None = there is to be none.
        inputs: See `require_other`.
        than: See `require_other`.

    Raises:
        ConfigError: Its folder is not there or cannot be written, it is no file, or it is one of the inputs.
    """
    if path is None:
        return
    require_other(option, path, *inputs, than=than)
    try:
        require_place(path)
    except OSError as error:
        raise ConfigError(f"{option} {path}: {error.strerror}; valid: a file that can be written") from error


def require_other(option: str, path: Path | None, *inputs: Path, than: str = "what is read") -> None:
    """Refuse an output that would take the place of an input.

    Args:
        option: What the command calls the output.
        path: The file; None = there is to be none.
        inputs: Files that are read; those that are not there do not count.
        than: What they are, in words.

    Raises:
        ConfigError: It is one of them.
    """
    if path is None or not path.exists():
        return
    if any(one.exists() and one.samefile(path) for one in inputs):
        raise ConfigError(f"{option} is {str(path)!r}; valid: another file than {than}")


def require_file_below(option: str, path: Path | None) -> None:
    """See that a file can be written whose folder will be made if it is missing; leaves nothing behind.

    Args:
        option: What the command calls it.
        path: The file; None = there is to be none.

    Raises:
        ConfigError: Its folder cannot be made or written, or it is no file.
    """
    if path is None:
        return
    _require_room(option, path, path.parent, "file")
    if path.parent.exists():
        require_file(option, path)


def require_folder(option: str, path: Path) -> None:
    """See that a folder is there or can be made, and that files can be written into it; leaves nothing behind.

    Args:
        option: What the command calls it.
        path: The folder.

    Raises:
        ConfigError: It is something else, or it cannot be made or written.
    """
    _require_room(option, path, path, "directory")


def _require_room(option: str, path: Path, folder: Path, what: str) -> None:
    """See that a folder, or the nearest one above it that is there, takes files."""
    try:
        with tempfile.TemporaryFile(dir=next(one for one in (folder, *folder.absolute().parents) if one.exists())):
            pass
    except OSError as error:
        raise ConfigError(f"{option} {path}: {error.strerror}; valid: a {what} that can be written") from error
