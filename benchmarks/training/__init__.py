"""Training: what environments cost, and what policies and learning make of them; one file per kind of groups.

`python -m benchmarks.training [--only speed | grid | table | due | vec | subproc | slack | traffic | play | together |
RECIPE]`, where RECIPE is one of those that lessons train, such as `navigate`.
"""

from __future__ import annotations

from benchmarks.harness import grouped
from benchmarks.training import layers, learning
from benchmarks.training.congestion import measure_traffic
from benchmarks.training.due_dates import measure_due_dates
from benchmarks.training.slack import measure_slack
from benchmarks.training.speed import measure_speed
from benchmarks.training.subproc import measure_subproc
from benchmarks.training.vec import measure_vec
from benchmarks.training.whole.fleet_play import measure_fleet_play
from benchmarks.training.whole.together import measure_together

GROUPS = {
    "speed": measure_speed,
    **layers.GROUPS,
    "due": measure_due_dates,
    "vec": measure_vec,
    "subproc": measure_subproc,
    **learning.GROUPS,
    "slack": measure_slack,
    "traffic": measure_traffic,
    "play": measure_fleet_play,
    "together": measure_together,
}

BENCHMARK = grouped(
    GROUPS,
    name="training",
    summary="Environments: steps per second of CPU time, policies, learning",
    seeds=(0, 1, 2, 3, 4),
    quick_seeds=(0,),
)
