"""Scale: how fast fleets of 50 to 10,000 cars are simulated, and how far fidelities agree; one file per kind of groups.

`python -m benchmarks.scale [--only GROUP]`, a group of `GROUPS`.
"""

from __future__ import annotations

from benchmarks.harness import grouped
from benchmarks.scale.agreement import measure_agreement, measure_large_agreement
from benchmarks.scale.bare_loop import measure_bare_loop
from benchmarks.scale.recorded import measure_recorded
from benchmarks.scale.speed import measure_grid, measure_kinematic, measure_large, measure_mixed, measure_physics
from benchmarks.scale.studies import measure_study

GROUPS = {
    "kinematic": measure_kinematic,
    "large": measure_large,
    "grid": measure_grid,
    "mixed": measure_mixed,
    "physics": measure_physics,
    "recorded": measure_recorded,
    "bare": measure_bare_loop,
    "study": measure_study,
    "agreement": measure_agreement,
    "agreement_large": measure_large_agreement,
}

BENCHMARK = grouped(
    GROUPS,
    name="scale",
    summary="Speed and memory of fleets of 50 to 10,000 cars at each fidelity, and how far the fidelities agree",
)
