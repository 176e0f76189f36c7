"""A working day: eight simulated hours without physics, with skewed waves of orders and batteries."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.config import AllocationConfig, ArmConfig, BatteryConfig, Fidelity, RunConfig, StreamConfig, StreamKind
from fleet.missions.phases import CarPhase
from fleet.simulation import Simulation
from fleet.tasks.board import OPEN_STATES, TaskState

SITE, CARS, CHARGERS = "medium", 16, 4
HOURS, QUICK_HOURS = 8.0, 0.25
RATE_PER_H = 300.0
"""Work never ends and no backlog grows for ever; the most popular of six stations gets 41 % of a skewed stream."""
STARVED_S = 3600.0
"""A task that is open for longer has been starved; waves come every ten minutes, a delivery takes two or three [s]."""
LOOK_S = 1.0
"""Simulated time between two looks at the stations [s]."""
ALLOCATOR = "hungarian"


@dataclass(frozen=True, kw_only=True)
class Day:
    """What was seen while it ran."""

    simulation: Simulation
    n_over_cap: int
    """Most cars that a station or charger ever had beyond its cap."""
    longest_open_s: float
    """Longest time from release to delivery, or to the end of the day [s]."""
    cpu_s: float


def measure_day(trial: Trial) -> Iterable[Row]:
    """No task lost or starved, no car stranded, no queue beyond its cap, all time accounted for."""
    hours = QUICK_HOURS if trial.quick else HOURS
    config = RunConfig(
        site=SITE,
        robots=CARS,
        seed=trial.seeds[0],
        duration_s=3600.0 * hours,
        fidelity=Fidelity.KINEMATIC,
        stream=StreamConfig(kind=StreamKind.SKEWED_WAVES, rate_per_h=RATE_PER_H),
        allocation=AllocationConfig(allocator=ALLOCATOR),
        battery=BatteryConfig(enabled=True, chargers_n=CHARGERS),
        arms=ArmConfig(workers_n=0),
    )
    with Simulation(config) as simulation:
        day = _run(simulation)
        summary = simulation.summary()
        where = f"{hours:g} h on {SITE}"
        trial.check(summary.parcel_balance == 0, f"{where}: parcel balance {summary.parcel_balance}")
        trial.check(summary.parcels_misplaced == 0, f"{where}: {summary.parcels_misplaced} parcels misplaced")
        trial.check(not simulation.stalled, f"{where}: came to a stand at {simulation.sim_s:.0f} s")
        sums = {sum(vars(spent).values()) for spent in summary.car_ticks.values()}
        trial.check(sums == {simulation.now}, f"{where}: accounts of the cars add up to {sums}, not {simulation.now}")
        stranded = sum(phase is CarPhase.DEAD for phase in simulation.missions.phase)
        yield Row(name=f"{where}, {CARS} cars, {CHARGERS} chargers: delivered", value=summary.tasks_done, unit="tasks")
        yield Row(name="  lost or failed", value=summary.tasks_failed, unit="tasks", target="<= 0")
        yield Row(
            name="  longest open", value=day.longest_open_s, unit="s", kind=Kind.PLAIN, target=f"<= {STARVED_S:g}"
        )
        yield Row(name="  cars stranded", value=stranded, unit="", target="<= 0")
        yield Row(name="  cars beyond a cap", value=day.n_over_cap, unit="", target="<= 0")
        yield Row(name="  robot contacts", value=summary.robot_contacts, unit="", target="<= 0")
        yield Row(
            name="  time accounted for",
            value=round(sum(summary.time_share_percent.values()), 6),
            unit="%",
            target=">= 100",
        )
        for account, share in summary.time_share_percent.items():
            yield Row(name=f"  {account.replace('_', ' ')}", value=share, unit="% of the cars' time")
        yield Row(name="  throughput", value=summary.throughput_per_h, unit="tasks/h")
        yield Row(name="  simulated seconds per second", value=simulation.sim_s / day.cpu_s, unit="CPU", kind=Kind.RATE)


def _run(simulation: Simulation) -> Day:
    period = max(1, round(LOOK_S / simulation.tick_s))
    bookings, over, begin = simulation.missions.bookings, 0, time.process_time()
    while not simulation.finished:
        simulation.tick()
        if simulation.now % period == 0:
            over = max(over, *(len(bookings.cars(place)) - cap for place, cap in enumerate(bookings.caps)))
    cpu_s = time.process_time() - begin
    ages = [
        (simulation.sim_s if task.state in OPEN_STATES else task.since_s[TaskState.DELIVERED]) - task.order.release_s
        for task in simulation.board.tasks
        if task.state not in (TaskState.ORDERED, TaskState.DELIVERED, TaskState.FAILED)
    ]
    return Day(simulation=simulation, n_over_cap=over, longest_open_s=float(np.max(ages, initial=0.0)), cpu_s=cpu_s)
