"""How the kernels of abstract fleets, and of environments on them, are compiled and kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

from planners.kernel_stamp import keep_until, stamp_of
from planners.mapf import kernel as mapf_kernel

_STAMP = stamp_of(Path(__file__).parent, Path(__file__).parents[1] / "envs", Path(mapf_kernel.__file__).parent)


def compiled(function: Callable[..., Any], **more: Any) -> Callable[..., Any]:
    """Compile a kernel that gets all its memory handed in, bundled in named tuples, and allocates none.

    For `_nrt=False` see `planners.mapf.kernel`. What it calls is compiled alike, unless that says `_nrt=True` itself; a
    kernel that returns arrays must not be called by one that counts references, which would count it down. What is
    compiled is kept until any file of this folder, of the environments or of `planners.mapf` changes.
    """
    options: dict[str, Any] = {"cache": True, "nogil": True, "no_cfunc_wrapper": True, "_nrt": False, **more}
    made: Callable[..., Any] = njit(**options)(function)
    keep_until(made, _STAMP)
    return made


def allocating(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that allocates, and that kernels call which count no references."""
    options: dict[str, Any] = {"cache": True, "nogil": True, "no_cfunc_wrapper": True, "_nrt": True}
    made: Callable[..., Any] = njit(**options)(function)
    return made


def inner(function: Callable[..., Any], **more: Any) -> Callable[..., Any]:
    """A kernel that only other kernels call: a call from Python would crash the process.

    Numba writes a second function for each kernel, which takes its arguments from Python. For the arrays of a fleet
    that takes longer to compile than the kernel.
    """
    return compiled(function, no_cpython_wrapper=True, **more)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """An `inner` kernel that is always compiled into its callers: one that is called for every car or cell, and is
    handed named tuples, works shorter than it takes to hand them over."""
    return inner(function, forceinline=True)
