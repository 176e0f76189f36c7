"""Benchmark of insight: whether a run can be understood, and what that costs; one group per file.

A new group is one file here and one line in `GROUPS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from benchmarks.harness import Row, Trial, grouped
from benchmarks.insight.explain import measure_explain
from benchmarks.insight.recording import measure_recording

GROUPS: dict[str, Callable[[Trial], Iterable[Row]]] = {"explain": measure_explain, "recording": measure_recording}

BENCHMARK = grouped(
    GROUPS,
    name="insight",
    summary="why robots wait, where the time went, and what it costs to know",
)
