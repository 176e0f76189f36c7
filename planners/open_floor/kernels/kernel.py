"""How the kernels of this family are compiled; a kernel keeps its type, so that calls of it are checked like any other.

What is compiled is kept until any file of this folder changes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

from planners.kernel_stamp import keep_until, stamp_of

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_STAMP = stamp_of(Path(__file__).parent)


def kernel(function: Kernel) -> Kernel:
    """Compile a function that gets all its memory handed in, and makes no array.

    The references to arrays that it is handed are not counted, which in bundles of twenty takes longer than the work.
    """
    options: dict[str, Any] = {"cache": True, "_nrt": False, "error_model": "numpy"}
    compiled: Any = njit(**options)(function)
    keep_until(compiled, _STAMP)
    return cast(Kernel, compiled)
