"""Where a picture is to be written."""

from __future__ import annotations

import os
from pathlib import Path

from fleet.config import require


def require_writable(name: str, path: Path) -> None:
    """Refuse a picture that cannot be written, before a run or a viewer has taken its time for it.

    Args:
        name: What the command calls it.
        path: The file.

    Raises:
        ConfigError: Its folder is not there or cannot be written, or it is a folder itself.
    """
    folder = path.parent
    writable = folder.is_dir() and os.access(folder, os.W_OK) and not path.is_dir()
    require(writable, name, str(path), "a file in a folder that is there and can be written")
