"""Benchmark of scheduling: who gets which task, and the stations they share; one group per file.

A group is a function from a `Trial` to rows; it has every assignment checked by the referee before it counts a time. A
new group is one file here and one line in `GROUPS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from benchmarks.harness import Row, Trial, grouped
from benchmarks.scheduling.coupled import measure_coupled
from benchmarks.scheduling.day import measure_day
from benchmarks.scheduling.matching import measure_matching
from benchmarks.scheduling.on_time import measure_on_time
from benchmarks.scheduling.same_seed import measure_same_seed

GROUPS: dict[str, Callable[[Trial], Iterable[Row]]] = {
    "matching": measure_matching,
    "coupled": measure_coupled,
    "day": measure_day,
    "on_time": measure_on_time,
    "same_seed": measure_same_seed,
}


BENCHMARK = grouped(
    GROUPS,
    name="scheduling",
    summary="tasks, vehicles and stations: matching, and plans for all of them at once",
    seeds=(0, 1, 2),
    quick_seeds=(0,),
)
