"""How kernels are compiled into which those of several files go."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

from planners.mapf import kernel as mapf_kernel

_FOLDERS = (Path(__file__).parents[1], Path(mapf_kernel.__file__).parent)
_FILES = [path.stat() for folder in _FOLDERS for path in sorted(folder.rglob("*.py"))]
_STAMP = (max(file.st_mtime for file in _FILES), sum(file.st_size for file in _FILES))


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that calls those of other files.

    numba keeps a compiled kernel until the file it stands in changes, whatever happens to the kernels in other files
    that are compiled into it: here it is kept until any file of the environments or of `planners.mapf` changes.
    """
    made: Callable[..., Any] = njit(cache=True, nogil=True)(function)
    kept = getattr(getattr(made, "_cache", None), "_cache_file", None)
    if kept is not None:
        kept._source_stamp = _STAMP
    return made
