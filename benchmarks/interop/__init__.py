"""Benchmark of open doors: what goes out is read by others, what comes in drives; one group per file.

The other side is that of the extra `interop`, and files of other projects are those of the folder that FLEET_INSTANCES
names. Rows for which something is missing are left out with a note.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from benchmarks.harness import Row, Trial, grouped
from benchmarks.interop.broken import measure_broken
from benchmarks.interop.lif import measure_lif
from benchmarks.interop.open_floor import measure_open_floor
from benchmarks.interop.opentcs import measure_opentcs
from benchmarks.interop.rmf import measure_rmf
from benchmarks.interop.ros import measure_ros
from benchmarks.interop.runs import measure_runs
from benchmarks.interop.vda5050 import measure_vda5050
from benchmarks.interop.yard import measure_yard

GROUPS: dict[str, Callable[[Trial], Iterable[Row]]] = {
    "runs": measure_runs,
    "lif": measure_lif,
    "opentcs": measure_opentcs,
    "rmf": measure_rmf,
    "broken": measure_broken,
    "open_floor": measure_open_floor,
    "ros": measure_ros,
    "yard": measure_yard,
    "vda5050": measure_vda5050,
}

BENCHMARK = grouped(
    GROUPS,
    name="interop",
    summary="runs and floors that others read, and floors of others that drive",
)
