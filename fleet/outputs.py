"""Outputs: files and folders that a command is to write, refused before hours go into what they are for."""

from __future__ import annotations

import tempfile
from pathlib import Path

from fleet.errors import ConfigError
from fleet.whole_file import require_place


def require_file(option: str, path: Path | None) -> None:
    """See that a file can be written, if there is to be one; leaves nothing behind.

    Args:
        option: What the command calls it.
        path: The file; None = there is to be none.

    Raises:
        ConfigError: Its folder is not there or cannot be written, or it is no file.
    """
    if path is None:
        return
    try:
        require_place(path)
    except OSError as error:
        raise ConfigError(f"{option} {path}: {error.strerror}; valid: a file that can be written") from error


def require_folder(option: str, path: Path) -> None:
    """See that a folder is there or can be made, and that files can be written into it; leaves nothing behind.

    Args:
        option: What the command calls it.
        path: The folder.

    Raises:
        ConfigError: It is something else, or it cannot be made or written.
    """
    try:
        with tempfile.TemporaryFile(dir=next(one for one in (path, *path.absolute().parents) if one.exists())):
            pass
    except OSError as error:
        raise ConfigError(f"{option} {path}: {error.strerror}; valid: a directory that can be written") from error
