"""Planning time: how long a planner took, which is told and decides nothing."""

from __future__ import annotations

import time
from collections.abc import Callable

from planners.mapf.problem import Plan


class PlanningTime:
    """Wall time of calls of a planner."""

    def __init__(self) -> None:
        self._n_calls = 0
        self._total_s = 0.0
        self._longest_s = 0.0

    def of(self, call: Callable[[], Plan]) -> Plan:
        """Call it, in whichever thread, and note how long that took."""
        begin = time.perf_counter()
        plan = call()
        took_s = time.perf_counter() - begin
        self._n_calls += 1
        self._total_s += took_s
        self._longest_s = max(self._longest_s, took_s)
        return plan

    @property
    def mean_ms(self) -> float | None:
        """Of all calls so far [ms]; None before the first."""
        return round(1000.0 * self._total_s / self._n_calls, 3) if self._n_calls else None

    @property
    def longest_ms(self) -> float | None:
        """Of the longest call so far [ms]; None before the first."""
        return round(1000.0 * self._longest_s, 3) if self._n_calls else None
