"""Where a picture is to be written."""

from __future__ import annotations

from pathlib import Path

from fleet.config import require
from fleet.outputs import require_file


def require_writable(name: str, path: Path, suffix: str) -> None:
    """Refuse a picture that cannot be written, before a run or a viewer has taken its time for it.

    Args:
        name: What the command calls it.
        path: The file.
        suffix: How its name has to end: the only form that is written.

    Raises:
        ConfigError: Its name ends otherwise, its folder is not there or cannot be written, or it is a folder itself.
    """
    require(path.suffix.lower() == suffix, name, str(path), f"a file whose name ends in {suffix}")
    require_file(name, path)
