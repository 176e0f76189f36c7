"""Agreement: the ends of the intervals of paired differences from physics."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.harness import Row, Trial
from fleet.config import Fidelity, StreamConfig
from fleet.scale.gap import find_gaps, run_gap
from fleet.scale.gap_run import GapDesign
from fleet.study.design import ORDERS_PER_CAR_H

FIGURES = ("deliveries [1/h]", "task time [s]")
WITHIN = {Fidelity.KINEMATIC: "<= 5", Fidelity.MIXED: "<= 3"}
"""How far from physics the ends of an interval may be [%]."""
JOBS = 2


def measure_agreement(trial: Trial) -> Iterator[Row]:
    """20 cars on `medium`, ten seeds of 20 minutes; with --quick three on `small`, two seeds of two minutes."""
    site, robots, seeds, duration_s = ("small", 3, 2, 120.0) if trial.quick else ("medium", 20, 10, 1200.0)
    design = GapDesign(
        site=site,
        robots=robots,
        seeds=tuple(range(seeds)),
        fidelities=(*WITHIN, Fidelity.PHYSICS),
        duration_s=duration_s,
        stream=StreamConfig(rate_per_h=ORDERS_PER_CAR_H * robots),
    )
    rows = run_gap(design, jobs=JOBS, interrupted=[], progress=lambda done, total: None)
    for row in rows:
        where = f"{site}, {row.fidelity}, seed {row.seed}"
        trial.check(row.robot_contacts + row.static_contacts == 0, f"{where}: contacts")
        trial.check(row.tasks_failed == 0, f"{where}: {row.tasks_failed} tasks failed")
    for gap in find_gaps(rows, design.reference, design.others):
        if gap.figure in FIGURES and gap.share is not None:
            name = f"{site}, {robots} cars: {gap.figure.partition(' [')[0]}, {gap.fidelity} less {design.reference}"
            far = 100.0 * max(abs(gap.share.low), abs(gap.share.high))
            yield Row(name=f"{name}, mean", value=100.0 * gap.share.mean, unit="%")
            target = "" if trial.quick else WITHIN[Fidelity(gap.fidelity)]
            yield Row(name=f"{name}, farther end of the interval", value=far, unit="%", target=target)
