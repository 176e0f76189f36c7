"""Training: what an environment costs, beside the bare engine, and what agents learn; one group per file.

`python -m benchmarks.training [--only speed learning]`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from benchmarks.harness import Benchmark, Row, Trial, in_groups
from benchmarks.training.learning import measure_learning
from benchmarks.training.speed import measure_speed

GROUPS: dict[str, Callable[[Trial], Iterable[Row]]] = {
    "speed": measure_speed,
    "learning": measure_learning,
}

BENCHMARK = Benchmark(
    name="training",
    summary="Environments: steps per second of CPU time, learning",
    measure=in_groups(GROUPS),
    seeds=(0, 1, 2, 3, 4),
    quick_seeds=(0,),
    groups=tuple(GROUPS),
)
