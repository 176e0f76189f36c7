"""Yard: racecars that deliver over a floor without lanes, in physics."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.world.bullet.world import BulletWorld
from fleet.world.kinematic import KinematicWorld
from fleet.yard.run import YardRun
from maps.yard import load_yard

CARS = 20


def measure_yard(trial: Trial) -> Iterable[Row]:
    """Let twenty cars deliver for an hour, or a minute if it has to be quick."""
    yard, duration_s = load_yard("depot"), 60.0 if trial.quick else 3600.0
    YardRun(yard, 1, KinematicWorld).tick_until_planned()  # loads the kernels
    run = YardRun(yard, CARS, BulletWorld, clock=time.process_time)
    try:
        while run.time_s < duration_s:
            run.tick()
        result = run.result()
    finally:
        run.world.close()
    trial.check(result.deliveries > 0, f"O4: {result.deliveries} deliveries of {CARS} cars in {duration_s:g} s")
    what = f"O4 yard, {CARS} cars, {duration_s:g} s"
    yield Row(name=f"{what}: deliveries", value=result.deliveries, unit="")
    yield Row(name=f"{what}: contacts", value=result.contacts, unit="", target="<= 0")
    yield Row(name=f"{what}: least clearance", value=result.min_clearance_m, unit="m")
    yield Row(
        name=f"{what}: longest that a car stood",
        value=result.longest_still_s,
        unit="s",
        target="<= 30",
        kind=Kind.PLAIN,
    )
    yield Row(name=f"{what}: median plan", value=float(np.median(result.plan_s)), unit="s", kind=Kind.TIME)
    yield Row(name=f"{what}: longest plan", value=max(result.plan_s), unit="s", target="<= 0.1", kind=Kind.TIME)
