"""Benchmark of the first hour: from an empty folder to pictures, an own site, allocator and planner, as the pages say.

One file per group. The reader's own time, and that of the network, is not in it: what pip takes is a row of its own.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from benchmarks.first_hour.blocks import measure_blocks
from benchmarks.first_hour.guest import measure_guest
from benchmarks.first_hour.newcomer import Newcomer
from benchmarks.first_hour.pages import measure_pages
from benchmarks.first_hour.start import measure_start
from benchmarks.harness import Benchmark, Row, Trial

GROUPS: dict[str, Callable[[Trial, Newcomer], Iterable[Row]]] = {
    "pages": measure_pages,
    "start": measure_start,
    "guest": measure_guest,
    "blocks": measure_blocks,
}


def measure(trial: Trial) -> Iterable[Row]:
    """Walk through the groups that are wanted, with one installation for all of them."""
    with tempfile.TemporaryDirectory(prefix="fleet-first-hour-") as folder:
        newcomer = Newcomer(Path(folder))
        for group in trial.groups:
            yield from GROUPS[group](trial, newcomer)


BENCHMARK = Benchmark(
    name="first_hour",
    summary="from an empty folder to pictures, an own site, allocator and planner, by the pages alone",
    measure=measure,
    groups=tuple(GROUPS),
)
