"""Group `explain`: true roots of staged waits, time accounts that add up, and the cost of watching."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from benchmarks.harness import Row, Trial
from benchmarks.insight.situations import SITUATIONS, play
from fleet.arrays import FloatArray
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.insight.cause_file import CauseWriter
from fleet.simulation import Simulation

SIZES = ((3, "small"), (20, "medium"))
DURATION_S, QUICK_S = 120.0, 30.0
WARM_TICKS = 100
"""Ticks before anything is timed: kernels are loaded in the first ones."""


def measure_explain(trial: Trial) -> Iterable[Row]:
    """Situations first, then runs of a fleet at work."""
    n_named = 0
    for name, situation in SITUATIONS.items():
        with tempfile.TemporaryDirectory() as folder:
            verdict = play(situation, Path(folder))
        trial.check(verdict.n_held > 0, f"{name}: never came about")
        for missed in verdict.missed:
            trial.check(False, f"{name}: {missed}")
        named = verdict.n_named == verdict.n_held and not verdict.n_early and not verdict.n_late
        n_named += named
        yield Row(name=f"{name}: root named", value=100.0 * verdict.n_named / max(verdict.n_held, 1), unit="% of ticks")
        yield Row(name="  named before or after", value=verdict.n_early + verdict.n_late, unit="ticks", target="<= 0")
    yield Row(name="situations explained", value=n_named, unit=f"of {len(SITUATIONS)}", target=f">= {len(SITUATIONS)}")
    for fidelity in (Fidelity.KINEMATIC, Fidelity.PHYSICS):
        for robots, site in SIZES:
            yield from _fleet(trial, robots, site, fidelity)


def _fleet(trial: Trial, robots: int, site: str, fidelity: Fidelity) -> Iterable[Row]:
    duration_s = QUICK_S if trial.quick else DURATION_S
    config = RunConfig(
        site=site,
        robots=robots,
        tasks=4 * robots,
        fidelity=fidelity,
        duration_s=duration_s,
        arms=ArmConfig(workers_n=0),
    )
    where = f"{robots} cars, {fidelity}"
    with Simulation(config) as simulation:
        for _ in range(WARM_TICKS):
            simulation.tick()
        watch, spent_s = simulation.causes, 0.0
        look = watch.tick

        def timed(tick: int, paces: FloatArray) -> None:
            nonlocal spent_s
            begin = time.process_time()
            look(tick, paces)
            spent_s += time.process_time() - begin

        watch.tick = timed  # type: ignore[method-assign]
        begin = time.process_time()
        while not simulation.finished:
            simulation.tick()
        whole_s = time.process_time() - begin
        time_accounts = simulation.metrics.time_accounts
        trial.check(
            (time_accounts.robots.sum(axis=0) == simulation.now).all(), f"{where}: the time accounts do not add up"
        )
        writer = CauseWriter(watch.log, simulation.codebook)
        size = sum(len(str(facts)) for _, facts in writer.lines())
        minutes = simulation.sim_s / 60.0
    yield Row(name=f"{where}: watching", value=100.0 * spent_s / whole_s, unit="% of CPU")
    yield Row(name="  causes in the run file", value=round(size / 1e3 / minutes, 1), unit="kB/min")
