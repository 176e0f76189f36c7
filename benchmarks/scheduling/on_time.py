"""On time: allocators against greedy and a rule for due dates on the same streams, by the runner of the study."""

from __future__ import annotations

import itertools
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from benchmarks.harness import Kind, Row, Trial
from fleet.charts.statistics import Estimate, estimate, paired
from fleet.config import Fidelity, StreamConfig, StreamKind
from fleet.study.design import Design
from fleet.study.study import check, run_study
from fleet.study.table import Row as Run

SITE, CARS = "medium", 16
REFERENCE, RULE = "greedy", "apparent_tardiness"
ALLOCATORS = ("hungarian", "regret_lns")
N_SEEDS, N_QUICK_SEEDS = 20, 2
HOURS, QUICK_HOURS = 2.0, 0.1
RATE_PER_H = 540.0
"""More than the fleet can do, so that the allocator decides how much is delivered, not only when."""


def measure_on_time(trial: Trial) -> Iterable[Row]:
    """On-time share, throughput and tardiness, and what allocators gain seed by seed, with 95 % intervals.

    On greedy they are to gain tasks in time and throughput, on the rule tardiness and throughput.
    """
    n_seeds, hours = (N_QUICK_SEEDS, QUICK_HOURS) if trial.quick else (N_SEEDS, HOURS)
    design = Design(
        allocators=(REFERENCE, RULE, *ALLOCATORS),
        robots=(CARS,),
        seeds=tuple(range(n_seeds)),
        site=SITE,
        fidelity=Fidelity.KINEMATIC,
        duration_s=3600.0 * hours,
        stream=StreamConfig(kind=StreamKind.SKEWED_WAVES, rate_per_h=RATE_PER_H),
    )
    check(design)
    with tempfile.TemporaryDirectory() as folder:
        outcome = run_study(
            design,
            Path(folder),
            jobs=len(os.sched_getaffinity(0)),
            resume=False,
            interrupted=[],
            progress=lambda done, total: None,
        )
    runs = {allocator: [run for run in outcome.rows if run.allocator == allocator] for allocator in design.allocators}
    for allocator, mine in runs.items():
        trial.check(len(mine) == n_seeds, f"{allocator}: {len(mine)} of {n_seeds} runs")
        trial.check(not any(run.stalled for run in mine), f"{allocator}: a run came to a stand")
        trial.check(not any(run.failed for run in mine), f"{allocator}: {sum(run.failed for run in mine)} tasks failed")
    released = {tuple((run.seed, run.released) for run in mine) for mine in runs.values()}
    trial.check(len(released) == 1, "the streams of the allocators differ")
    yield Row(name=f"{CARS} cars on {SITE}, {hours:g} h: seeds", value=n_seeds, unit="")
    for name, unit, scale, figure in FIGURES:
        for allocator, mine in runs.items():
            yield from _rows(f"{name}, {allocator}", unit, estimate([scale * figure(run) for run in mine]))
        for allocator, base in itertools.product(ALLOCATORS, (REFERENCE, RULE)):
            gain = paired([scale * figure(run) for run in runs[allocator]], [scale * figure(run) for run in runs[base]])
            target = "" if trial.quick else TARGETS.get((name, base), "")
            yield from _rows(f"{name}, {allocator} against {base}", unit, gain, target)


FIGURES: tuple[tuple[str, str, float, Callable[[Run], float]], ...] = (
    ("on time", "% of tasks due", 100.0, lambda run: run.on_time_share or 0.0),
    ("throughput", "tasks/h", 1.0, lambda run: run.throughput_per_h),
    ("tardiness", "s", 1.0, lambda run: run.tardiness_s or 0.0),
)


TARGETS = {
    ("on time", REFERENCE): ">= 0",
    ("throughput", REFERENCE): ">= 0",
    ("tardiness", RULE): "<= 0",
    ("throughput", RULE): ">= 0",
}
"""What is promised of the differences, by figure and by what they are from."""


def _rows(name: str, unit: str, value: Estimate | None, target: str = "") -> Iterable[Row]:
    if value is not None:
        yield Row(name=f"  {name}", value=value.mean, unit=unit, kind=Kind.PLAIN, target=target)
        yield Row(name="    ± (95 %)", value=value.half_width, unit=unit, kind=Kind.PLAIN)
