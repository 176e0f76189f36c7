"""Reliability: what is wrong is refused by name, and nothing hangs; one file per kind of groups.

`python -m benchmarks.reliability [--only fuzz | actions]`.
"""

from __future__ import annotations

from benchmarks.harness import Benchmark, in_groups
from benchmarks.reliability.fuzz import measure_fuzz
from benchmarks.reliability.odd_actions import measure_actions

GROUPS = {
    "fuzz": measure_fuzz,
    "actions": measure_actions,
}

BENCHMARK = Benchmark(
    name="reliability",
    summary="Mutated files and odd actions: taken, or refused by name with what would be valid",
    measure=in_groups(GROUPS),
    groups=tuple(GROUPS),
)
