"""Lanes: what a whole fleet delivers with multi-step PIBT, beside what it delivers with PIBT."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from benchmarks.flow import MEDIUM, Case, Layout, run_flows
from benchmarks.harness import Row, Trial
from fleet.charts.statistics import estimate
from fleet.config import Fidelity, TrafficConfig

PIBT, MULTI_STEP = TrafficConfig(planner="pibt"), TrafficConfig(planner="multi_step_pibt")
HALL = Layout(name="60 x 100", rows=60, cols=100, stations=18, parking=200)
SEEDS = (0, 1, 2, 3, 4)
FIDELITIES = (Fidelity.GRID, Fidelity.KINEMATIC)


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """A fleet on a site, and what is promised of its gain [%]."""

    layout: Layout
    cars: int
    mean: str = ""
    lower: str = ""


BUSY = {"mean": ">= 3", "lower": ">= 0"}
FLEETS = (
    Fleet(layout=MEDIUM, cars=40, mean=">= 0"),
    Fleet(layout=MEDIUM, cars=80, **BUSY),
    Fleet(layout=MEDIUM, cars=100, **BUSY),
    Fleet(layout=HALL, cars=200, mean=">= 0"),
    Fleet(layout=HALL, cars=400, **BUSY),
)


def measure_lanes(trial: Trial) -> Iterable[Row]:
    """Both planners with the same orders, of which more are open than can be done."""
    seeds = SEEDS[:1] if trial.quick else SEEDS
    for fidelity in FIDELITIES:
        for fleet in FLEETS:
            end_s = fleet.layout.counted_to(quick=trial.quick)
            cases = [
                Case(layout=fleet.layout, cars=fleet.cars, seed=seed, end_s=end_s, fidelity=fidelity, traffic=PIBT)
                for seed in seeds
            ]
            yield from _compare(trial, fleet, cases)


def _compare(trial: Trial, fleet: Fleet, cases: list[Case]) -> Iterable[Row]:
    """One fleet with both planners: what it delivers, the gain paired by seed, and where its time goes."""
    what = f"{fleet.layout.name}, {fleet.cars} cars, {cases[0].fidelity}"
    before = list(run_flows(cases))
    after = list(run_flows([replace(case, traffic=MULTI_STEP) for case in cases]))
    trial.check(not any(flow.contacts for flow in before + after), f"{what}: robots touched")
    for name, flows in (("pibt", before), ("multi_step_pibt", after)):
        per_h, traffic, queue = (
            sum(values) / len(flows)
            for values in zip(*((flow.bounds.delivered_per_h, flow.traffic, flow.queue) for flow in flows), strict=True)
        )
        yield Row(name=f"{what}: {name}", value=per_h, unit="/h")
        yield Row(name="  stand in traffic", value=100.0 * traffic, unit="%")
        yield Row(name="  stand in queues", value=100.0 * queue, unit="%")
    gains = [
        100.0 * (new.bounds.delivered_per_h / old.bounds.delivered_per_h - 1.0)
        for old, new in zip(before, after, strict=True)
    ]
    gain = estimate(gains)
    if gain is not None:
        yield Row(name="  gain", value=gain.mean, unit="%", target="" if trial.quick else fleet.mean)
    if gain is not None and gain.n > 1:
        yield Row(name="  gain, lower end (95 %)", value=gain.low, unit="%", target="" if trial.quick else fleet.lower)
