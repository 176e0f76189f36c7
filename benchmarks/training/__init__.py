"""Training: what environments cost, and what policies and learning make of them; one file per kind of groups.

`python -m benchmarks.training [--only speed | grid | table]`.
"""

from benchmarks.harness import Benchmark, in_groups
from benchmarks.training import layers
from benchmarks.training.speed import measure_speed

GROUPS = {"speed": measure_speed, **layers.GROUPS}

BENCHMARK = Benchmark(
    name="training",
    summary="Environments: steps per second of CPU time, policies, learning",
    measure=in_groups(GROUPS),
    groups=tuple(GROUPS),
)
