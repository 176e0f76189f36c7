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
    return _compiled(function)


def inlined(function: Kernel) -> Kernel:
    """Put a function's body where it is called: for those that are a line or two, or would have much handed to them."""
    return _compiled(function, inline="always")


def borrowing(function: Kernel) -> Kernel:
    """Compile a function that gets all its memory handed in, and makes no array.

    The references to arrays that it is handed are not counted, which for a bundle of twenty takes longer than a check.
    """
    return _compiled(function, _nrt=False)


def inner_borrowing(function: Kernel) -> Kernel:
    """Compile a `borrowing` function that only other kernels call: a call from Python would crash the process.

    What it calls must make no array either. Numba writes a second function for each kernel, which takes its arguments
    from Python. For a bundle of fifty arrays that takes longer to compile than the kernel.
    """
    return _compiled(function, no_cpython_wrapper=True, _nrt=False)


def _compiled(function: Kernel, **more: Any) -> Kernel:
    """Nothing calls kernels from C, for which numba would write a function, too."""
    options: dict[str, Any] = {"cache": True, "no_cfunc_wrapper": True, **more}
    return cast(Kernel, njit(**options)(function))


def entry_point(function: Kernel, *arguments: Any) -> Kernel:
    """What Python calls once numba knows the types: it is handed arguments of the types of these, and no others.

    Numba finds out the types of all arguments at every call, and of a bundle of arrays in 1.5 us.
    """
    known: Any = numba  # it has types for some of its functions only
    types = tuple(known.typeof(argument) for argument in arguments)
    return cast(Kernel, cast(Any, function).compile(types))
