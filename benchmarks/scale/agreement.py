"""Agreement: the ends of the intervals of paired differences from physics."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.harness import Row, Trial
from fleet.config import Fidelity, StreamConfig
from fleet.scale.floors import floor_for
from fleet.scale.gap import find_gaps, run_gap
from fleet.scale.gap_run import GapDesign
from fleet.study.design import ORDERS_PER_CAR_H
from maps.site import save_site

FIGURES = ("deliveries [1/h]", "task time [s]")
WITHIN = {Fidelity.KINEMATIC: "<= 5", Fidelity.MIXED: "<= 3"}
"""How far from physics the ends of an interval may be [%]."""
JOBS = 2


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A fleet on a site, driven with several seeds."""

    site: str
    robots: int
    seeds: int
    duration_s: float


MEDIUM = Scene(site="medium", robots=20, seeds=10, duration_s=1200.0)
QUICK = Scene(site="small", robots=3, seeds=2, duration_s=120.0)
LARGE_ROBOTS = 300


def measure_agreement(trial: Trial) -> Iterator[Row]:
    """20 cars on `medium`, ten seeds of 20 minutes; with --quick three on `small`, two seeds of two minutes."""
    yield from _measure(trial, QUICK if trial.quick else MEDIUM)


def measure_large_agreement(trial: Trial) -> Iterator[Row]:
    """300 cars on a generated floor, three seeds of five minutes; hours, so left out with --quick."""
    if trial.quick:
        trial.notes.append(f"{LARGE_ROBOTS} cars at all fidelities: not with --quick")
        return
    with tempfile.TemporaryDirectory() as folder:
        site = Path(folder) / f"floor_{LARGE_ROBOTS}.toml"
        save_site(floor_for(LARGE_ROBOTS), site)
        yield from _measure(trial, Scene(site=str(site), robots=LARGE_ROBOTS, seeds=3, duration_s=300.0))


def _measure(trial: Trial, scene: Scene) -> Iterator[Row]:
    design = GapDesign(
        site=scene.site,
        robots=scene.robots,
        seeds=tuple(range(scene.seeds)),
        fidelities=(*WITHIN, Fidelity.PHYSICS),
        duration_s=scene.duration_s,
        stream=StreamConfig(rate_per_h=ORDERS_PER_CAR_H * scene.robots),
    )
    site = Path(scene.site).stem
    rows = run_gap(design, jobs=JOBS, interrupted=[], progress=lambda done, total: None)
    for row in rows:
        where = f"{site}, {row.fidelity}, seed {row.seed}"
        trial.check(row.robot_contacts + row.static_contacts == 0, f"{where}: contacts")
        trial.check(row.tasks_failed == 0, f"{where}: {row.tasks_failed} tasks failed")
    for gap in find_gaps(rows, design.reference, design.others):
        if gap.figure in FIGURES and gap.share is not None:
            figure = gap.figure.partition(" [")[0]
            name = f"{site}, {scene.robots} cars: {figure}, {gap.fidelity} less {design.reference}"
            far = 100.0 * max(abs(gap.share.low), abs(gap.share.high))
            yield Row(name=f"{name}, mean", value=100.0 * gap.share.mean, unit="%")
            target = "" if trial.quick else WITHIN[Fidelity(gap.fidelity)]
            yield Row(name=f"{name}, farther end of the interval", value=far, unit="%", target=target)
