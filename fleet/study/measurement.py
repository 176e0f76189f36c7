"""Measurement: one variant of a study from start to end, as a row."""

from __future__ import annotations

import numpy as np

from fleet.config import RunConfig
from fleet.insight.bounds import bounds_of, deliveries_of
from fleet.simulation import Simulation
from fleet.study.table import Row
from fleet.tasks.board import DONE_STATES, Task, TaskState


def measure(config: RunConfig) -> Row:
    """Run for the whole time; see `run_whole_time`."""
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
    times = [task.done_s - task.order.release_s for task in delivered if task.done_s is not None]
    tardiness, on_time = _lateness(released, config.duration_s)
    time_accounts, ticks = simulation.metrics.time_accounts, max(simulation.now, 1)
    cars = {name: round(spent / (ticks * config.robots), 4) for name, spent in vars(time_accounts.fleet_time()).items()}
    bounds = bounds_of(
        simulation.view, deliveries_of(delivered, simulation.stations), simulation.sim_s, from_start=True
    )
    times_of = {station.name: time_accounts.station_time(station.arm) for station in simulation.stations}
    return Row(
        allocator=config.allocation.allocator,
        robots=config.robots,
        seed=config.seed,
        released=len(released),
        done=len(delivered),
        failed=simulation.board.count(TaskState.FAILED),
        throughput_per_h=round(len(delivered) * 3600.0 / config.duration_s, 2),
        task_time_s=round(float(np.mean(times)), 2) if times else None,
        task_time_p95_s=round(float(np.percentile(times, 95)), 2) if times else None,
        tardiness_s=tardiness,
        on_time_share=on_time,
        **cars,
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


def _lateness(released: list[Task], end_s: float) -> tuple[float | None, float | None]:
    """Mean tardiness [s] and share on time, None without due dates; both are fixed by what is known at the end."""
    late, kept = [], []
    for task in released:
        due_s = task.order.due_s
        if due_s == np.inf:
            continue
        done_s = task.done_s if task.done_s is not None and task.state in DONE_STATES else np.inf
        late.append(max(0.0, min(done_s, end_s) - due_s))
        if due_s <= end_s:
            kept.append(done_s <= due_s)
    tardiness = round(float(np.mean(late)), 2) if late else None
    return tardiness, round(float(np.mean(kept)), 4) if kept else None
