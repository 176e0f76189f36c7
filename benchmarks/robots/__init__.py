"""Benchmark of robots: by themselves, racecars and Huskies in one fleet, and stations with arms of other makers.

A group is a function from a `Trial` to rows; a new group is one file here and one line in `GROUPS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from benchmarks.harness import Row, Trial, grouped
from benchmarks.robots.alone import measure_alone
from benchmarks.robots.mixed import measure_mixed, measure_trays
from benchmarks.robots.pods import measure_pods
from benchmarks.robots.stations import measure_stations
from benchmarks.robots.walking import measure_shifts

GROUPS: dict[str, Callable[[Trial], Iterable[Row]]] = {
    "alone": measure_alone,
    "mixed": measure_mixed,
    "trays": measure_trays,
    "panda": measure_stations,
    "walking": measure_shifts,
    "pods": measure_pods,
}

BENCHMARK = grouped(
    GROUPS,
    name="robots",
    summary="racecar, Husky and A1 alone on a bare floor; mixed fleets; a Panda and an xArm at stations",
    seeds=tuple(range(20)),
    quick_seeds=(0,),
)
