"""How the larger kernels of this family are compiled and kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numba import njit

from planners.kernel_stamp import keep_until, stamp_of

Int: TypeAlias = int | np.int64
"""A whole number in a kernel, where both are the same."""

_STAMP = stamp_of(Path(__file__).parent)


def kernel(function: Callable[..., Any], **more: Any) -> Callable[..., Any]:
    """Compile a kernel that gets all its memory handed in, bundled in named tuples, and allocates none.

    Without `_nrt=False` numba counts the references of every array of a bundle at every use, which takes two thirds
    of the time of a search. What is compiled is kept until any file of the family changes.
    """
    options: dict[str, Any] = {"cache": True, "nogil": True, "no_cfunc_wrapper": True, "_nrt": False, **more}
    compiled: Callable[..., Any] = njit(**options)(function)
    keep_until(compiled, _STAMP)
    return compiled


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """A kernel that is always compiled into its callers.

    To call one that is not hands every array of its named tuples over on the stack, seven words each. That is lost in
    kernels that work long, but not in one that is called for every agent.
    """
    return kernel(function, forceinline=True)
