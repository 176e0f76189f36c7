"""Measurement: one variant of a study from start to end, as a row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from fleet.abstract.run import AbstractRun
from fleet.config import Fidelity, RunConfig
from fleet.insight.bounds import bounds_of, deliveries_of
from fleet.insight.metrics import late_of, lateness_s, mean_tardiness_s, on_time_share, task_times_s
from fleet.insight.time_accounts import CarTime
from fleet.simulation import Simulation
from fleet.study.table import Row
from fleet.tasks.board import DONE_STATES, TaskState


def measure(config: RunConfig) -> Row:
    """Run for the whole time; see `run_whole_time`."""
    if config.fidelity is Fidelity.ABSTRACT:
        run = AbstractRun(config)
        run.run_whole_time()
        return _abstract_row(run)
    with Simulation(config) as simulation:
        run_whole_time(simulation)
        return _row(config, simulation)


def run_whole_time(simulation: Simulation) -> None:
    """Run to the end of the time, even when all work is done before, so that all runs are of one length.

    A fleet that comes to a stand with work open is not driven on: nothing will change.
    """
    end_s = simulation.config.duration_s
    while simulation.sim_s < end_s and (simulation.board.finished or not simulation.stalled):
        simulation.tick()


def _row(config: RunConfig, simulation: Simulation) -> Row:
    released = [task for task in simulation.board.tasks if task.state is not TaskState.ORDERED]
    delivered = [task for task in released if task.state in DONE_STATES]
    times, late = task_times_s(delivered), lateness_s(released, config.duration_s)
    time_accounts, ticks = simulation.metrics.time_accounts, max(simulation.now, 1)
    # Bounds are about deliveries alone, of which a fleet that makes visits, too, could make more.
    deliveries = deliveries_of(delivered, simulation.stations)
    visits = any(task.visit is not None for task in released)
    bounds = None if visits else bounds_of(simulation.view, deliveries, simulation.sim_s, from_start=True)
    times_of = {station.name: time_accounts.station_time(station.arm) for station in simulation.stations}
    return Row(
        **_figures(config, len(delivered), times, late, time_accounts.fleet_time(), ticks),
        released=len(released),
        failed=simulation.board.count(TaskState.FAILED),
        stations=" ".join(
            f"{name}={time.busy / ticks:.4f}/{time.contended / ticks:.4f}" for name, time in times_of.items()
        ),
        bound_cars_per_h=None if bounds is None else bounds.cars_per_h,
        bound_arms_per_h=None if bounds is None else bounds.arms_per_h,
        bound_lanes_per_h=None if bounds is None else bounds.lanes_per_h,
        bound_orders_per_h=None if bounds is None else bounds.orders_per_h,
        stalled=simulation.stalled and not simulation.board.finished,
        state_hash=simulation.state_hash(),
    )


def _figures(
    config: RunConfig, n_done: int, times_s: Sequence[float], late_s: Sequence[float], spent: CarTime, ticks: int
) -> dict[str, Any]:
    """What is told of any run alike, by the name of its column."""
    return {
        "allocator": config.allocation.allocator,
        "robots": config.robots,
        "seed": config.seed,
        "done": n_done,
        "throughput_per_h": round(n_done * 3600.0 / config.duration_s, 2),
        "task_time_s": round(float(np.mean(times_s)), 2) if times_s else None,
        "task_time_p95_s": round(float(np.percentile(times_s, 95)), 2) if times_s else None,
        "tardiness_s": mean_tardiness_s(late_s),
        "on_time_share": on_time_share(late_s),
        **{name: round(own / (ticks * config.robots), 4) for name, own in vars(spent).items()},
    }


def _abstract_row(run: AbstractRun) -> Row:
    """The same of an abstract run; bounds are told of whole runs alone."""
    config, steps, told = run.config, max(run.accounts.n_steps, 1), run.told()
    times_s = told.times_s().tolist()
    ends = (None if math.isinf(end_s) else end_s for end_s in told.done_s.tolist())
    late_s = late_of(zip(ends, told.due_s.tolist(), strict=True), config.duration_s)
    shares = zip(run.fleet.place.site.stations, run.accounts.station_shares(), strict=True)
    return Row(
        **_figures(config, len(times_s), times_s, late_s, run.accounts.car_time(), steps),
        released=len(told.done_s),
        failed=0,
        stations=" ".join(f"{station.name}={share.busy:.4f}/{share.contended:.4f}" for station, share in shares),
        bound_cars_per_h=None,
        bound_arms_per_h=None,
        bound_lanes_per_h=None,
        bound_orders_per_h=None,
        stalled=run.stalled,
        state_hash=run.state_hash(),
    )
