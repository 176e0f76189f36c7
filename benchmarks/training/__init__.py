"""Training: what an environment costs, beside the bare engine.

`python -m benchmarks.training [--only speed]`.
"""

from benchmarks.harness import Benchmark, in_groups
from benchmarks.training.speed import measure_speed

GROUPS = {"speed": measure_speed}

BENCHMARK = Benchmark(
    name="training",
    summary="Environments: steps per second of CPU time, learning",
    measure=in_groups(GROUPS),
    groups=tuple(GROUPS),
)
