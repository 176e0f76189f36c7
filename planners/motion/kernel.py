"""How the kernels of this family are compiled; a kernel keeps its type, so that calls of it are checked like any other.

Numba keeps a compiled kernel until the file it stands in changes, whatever happens to kernels of other files that are
compiled into it: who changes one removes the compiled files of `planners/motion`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba import njit

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def kernel(function: Kernel) -> Kernel:
    """Compile a function."""
    return cast(Kernel, njit(cache=True)(function))


def inlined(function: Kernel) -> Kernel:
    """Put a function's body where it is called: for those that are a line or two, or would have much handed to them."""
    return cast(Kernel, njit(cache=True, inline="always")(function))


def borrowing(function: Kernel) -> Kernel:
    """Compile a function that gets all its memory handed in, and makes no array.

    The references to arrays that it is handed are not counted, which for a bundle of twenty takes longer than a check.
    """
    options: dict[str, Any] = {"cache": True, "_nrt": False}
    return cast(Kernel, njit(**options)(function))


def entry_point(function: Kernel, *arguments: Any) -> Kernel:
    """What Python calls once numba knows the types: it is handed arguments of the types of these, and no others.

    Numba finds out the types of all arguments at every call, and of a bundle of arrays in 1.5 us.
    """
    known: Any = numba  # it has types for some of its functions only
    types = tuple(known.typeof(argument) for argument in arguments)
    return cast(Kernel, cast(Any, function).compile(types))
