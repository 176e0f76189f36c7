"""How the kernels of this family are compiled; a kernel keeps its type, so that calls of it are checked like any other.

Numba keeps a compiled kernel until the file it stands in changes, whatever happens to kernels of other files that are
compiled into it: here it is kept until any file of the family changes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_FILES = [path.stat() for path in sorted(Path(__file__).parent.rglob("*.py"))]
_STAMP = (max(file.st_mtime for file in _FILES), sum(file.st_size for file in _FILES))


def kernel(function: Kernel) -> Kernel:
    """Compile a function that gets all its memory handed in, and makes no array.

    The references to arrays that it is handed are not counted, which in bundles of twenty takes longer than the work.
    """
    options: dict[str, Any] = {"cache": True, "_nrt": False, "error_model": "numpy"}
    compiled: Any = njit(**options)(function)
    kept = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if kept is not None:
        kept._source_stamp = _STAMP
    return cast(Kernel, compiled)
