"""Kernel stamp: until when compiled kernels of a family are kept.

Numba keeps a compiled kernel until the file it stands in changes, whatever happens to kernels of other files that are
compiled into it. With a stamp it is kept until any file of some folders changes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

Stamp = tuple[float, int]


def stamp_of(*folders: Path) -> Stamp:
    """Latest change of any Python file below some folders, and the size of all."""
    files = [path.stat() for folder in folders for path in sorted(folder.rglob("*.py"))]
    return max(file.st_mtime for file in files), sum(file.st_size for file in files)


def keep_until(compiled: Any, stamp: Stamp) -> None:
    """Let what numba has kept of a kernel count only as long as the stamp is the same."""
    kept = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if kept is not None:
        kept._source_stamp = stamp
