"""Crew: threads that share the agents of a large fleet."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

_WORTH_THREADS = 2000
"""Agents from which on threads pay."""
_PARTS = 2


class Crew:
    """Threads that do what has to be done for each agent; it must run without the interpreter's lock.

    A large fleet is always cut into the same parts, so that what comes out depends on no number of cores.

    Args:
        n: Number of agents.
    """

    def __init__(self, n: int) -> None:
        parts = _PARTS if n >= _WORTH_THREADS else 1
        self._bounds = [(n * k // parts, n * (k + 1) // parts) for k in range(parts)]
        self._pool = ThreadPoolExecutor(parts) if parts > 1 else None

    @property
    def is_shared(self) -> bool:
        """Whether there is more than one part."""
        return self._pool is not None

    def each(self, work: Callable[[int, int], object]) -> None:
        """Do the work for the agents of every part, from one up to before another, and wait for all of it."""
        if self._pool is None:
            work(*self._bounds[0])
        else:
            list(self._pool.map(work, *zip(*self._bounds, strict=True)))
