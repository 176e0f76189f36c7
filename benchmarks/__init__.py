"""Benchmarks: each module measures one promise of the project, after it has checked the results it measures on."""

from __future__ import annotations

BENCHMARKS: tuple[str, ...] = (
    "arms",
    "demo",
    "first_hour",
    "fleet_size",
    "flow",
    "insight",
    "interop",
    "mapf",
    "mapf_lanes",
    "reliability",
    "robots",
    "scale",
    "scheduling",
    "tracking",
    "training",
)
"""Names of the benchmark modules, in the order `python -m benchmarks` runs them; one module each in this folder."""
