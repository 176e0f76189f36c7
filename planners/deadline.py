"""Deadline: how much work a solver may do before it must hand back what it has."""

from __future__ import annotations

import time
from collections.abc import Callable

from planners.errors import PlanningError


class Deadline:
    """A budget of iterations, and for one-shot commands and benchmarks also of wall-clock time.

    What an iteration is, each solver says. A budget of iterations alone never reads a clock, so the same
    problem gives the same answer on any machine.

    Args:
        iterations: Iterations allowed, >= 0; None = no limit.
        wall_s: Time allowed from now [s], >= 0; None = no limit.
        clock: Source of the time [s]; only read when `wall_s` is given.

    Raises:
        PlanningError: A budget is negative.
    """

    def __init__(
        self,
        iterations: int | None = None,
        *,
        wall_s: float | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        for name, budget in (("iterations", iterations), ("wall_s", wall_s)):
            if budget is not None and not budget >= 0:
                raise PlanningError(f"deadline: {name} = {budget}; valid: a number >= 0, or None for no limit")
        self.iterations = 0
        """Iterations spent so far."""
        self._limit = iterations
        self._clock = clock
        self._end_s = None if wall_s is None else clock() + wall_s

    @property
    def reads_clock(self) -> bool:
        """Whether the time that has passed counts."""
        return self._end_s is not None

    @property
    def counts(self) -> bool:
        """Whether iterations are limited."""
        return self._limit is not None

    def spend(self, iterations: int = 1) -> bool:
        """Take iterations out of the budget.

        Returns:
            False, with nothing taken, when the budget does not cover them any more.
        """
        if self._limit is not None and self.iterations + iterations > self._limit:
            return False
        if self._end_s is not None and self._clock() >= self._end_s:
            return False
        self.iterations += iterations
        return True
