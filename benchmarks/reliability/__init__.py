"""Reliability: faults are survived, what is wrong is refused by name, and nothing hangs; one file per kind of groups.

`python -m benchmarks.reliability [--only chaos | wrecks | dips | day | worlds | hash | killed | fuzz | actions]`.
"""

from __future__ import annotations

from benchmarks.harness import grouped
from benchmarks.reliability.chaos import measure_chaos
from benchmarks.reliability.day import measure_day
from benchmarks.reliability.dips import measure_dips
from benchmarks.reliability.fuzz import measure_fuzz
from benchmarks.reliability.killed_runs import measure_killed_runs
from benchmarks.reliability.odd_actions import measure_actions
from benchmarks.reliability.one_hash import measure_one_hash
from benchmarks.reliability.worlds import measure_worlds
from benchmarks.reliability.wrecks import measure_wrecks

GROUPS = {
    "chaos": measure_chaos,
    "wrecks": measure_wrecks,
    "dips": measure_dips,
    "day": measure_day,
    "worlds": measure_worlds,
    "hash": measure_one_hash,
    "killed": measure_killed_runs,
    "fuzz": measure_fuzz,
    "actions": measure_actions,
}

BENCHMARK = grouped(
    GROUPS,
    name="reliability",
    summary="Runs with faults of all kinds, killed runs, random worlds; mutated files and odd actions",
)
