"""Benchmark of path planning: speed, throughput and cost against the best published planners, one group per file.

A group is a function from a `Trial` to rows; it checks every plan with the referee before it counts a time. A new
group is one file here and one line in `GROUPS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from benchmarks.harness import Row, Trial, grouped
from benchmarks.mapf.crowded import measure_crowded
from benchmarks.mapf.floors import measure_floors, measure_floors_anytime
from benchmarks.mapf.frozen import measure_frozen
from benchmarks.mapf.lanes import measure_lanes
from benchmarks.mapf.league import measure_league, measure_league_anytime
from benchmarks.mapf.learned import measure_learned
from benchmarks.mapf.one_shot import measure_one_shot
from benchmarks.mapf.pibt import measure_pibt
from benchmarks.mapf.pogema import measure_pogema
from benchmarks.mapf.two_way import measure_two_way

GROUPS: dict[str, Callable[[Trial], Iterable[Row]]] = {
    "pibt": measure_pibt,
    "crowded": measure_crowded,
    "one_shot": measure_one_shot,
    "league": measure_league,
    "league_anytime": measure_league_anytime,
    "floors": measure_floors,
    "floors_anytime": measure_floors_anytime,
    "frozen": measure_frozen,
    "lanes": measure_lanes,
    "pogema": measure_pogema,
    "learned": measure_learned,
    "two_way": measure_two_way,
}


BENCHMARK = grouped(
    GROUPS,
    name="mapf",
    summary="path planning for fleets, against the best published planners",
    seeds=(0, 1, 2),
    quick_seeds=(0,),
)
