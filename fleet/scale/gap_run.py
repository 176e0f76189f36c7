"""GapRun: one scenario at one fidelity, and when its cars and arms did what."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fleet.abstract.fleet import TIMESTEP_S
from fleet.abstract.kernel import Phase
from fleet.abstract.run import AbstractRun
from fleet.config import ArmConfig, Fidelity, RunConfig, StreamConfig, TrafficConfig, require
from fleet.insight.metrics import task_times_s
from fleet.insight.time_accounts import CarTime
from fleet.simulation import Simulation
from fleet.study.measurement import run_whole_time
from fleet.tasks.board import DONE_STATES, Task, TaskState
from fleet.tasks.order import Order


@dataclass(frozen=True, kw_only=True)
class GapDesign:
    """Everything that decides the runs: each fidelity on each seed's orders, all else alike."""

    site: str
    robots: int
    seeds: tuple[int, ...]
    fidelities: tuple[Fidelity, ...]
    """At least two; see `reference`."""
    duration_s: float
    """Length of every run [s]."""
    stream: StreamConfig | None
    """How orders arrive; None = all from the start."""
    orders: Path | None = None
    """File of orders in place of a stream."""

    def __post_init__(self) -> None:
        said = ",".join(self.fidelities)
        require(len(set(self.fidelities)) == len(self.fidelities), "--fidelities", said, "each once")
        require(len(self.fidelities) >= 2, "--fidelities", said, f"two or more of {', '.join(Fidelity)}")

    @property
    def reference(self) -> Fidelity:
        """What the others are compared with: physics, or the first where that is not among them."""
        return Fidelity.PHYSICS if Fidelity.PHYSICS in self.fidelities else self.fidelities[0]

    @property
    def others(self) -> tuple[Fidelity, ...]:
        """What is compared with it, in order."""
        return tuple(fidelity for fidelity in self.fidelities if fidelity is not self.reference)

    @property
    def configs(self) -> tuple[RunConfig, ...]:
        """All runs, seed by seed, the slowest fidelity first: it is under way while the others are done."""
        order = sorted(self.fidelities, key=list(Fidelity).index)
        return tuple(self._config(fidelity, seed) for seed in self.seeds for fidelity in order)

    def _config(self, fidelity: Fidelity, seed: int) -> RunConfig:
        return RunConfig(
            site=self.site,
            robots=self.robots,
            orders=self.orders,
            stream=self.stream,
            seed=seed,
            duration_s=self.duration_s,
            fidelity=fidelity,
            traffic=TrafficConfig.usual(fidelity),
            # The runs share the cores already.
            arms=ArmConfig(workers_n=0),
        )


@dataclass(frozen=True, kw_only=True)
class GapRow:
    """What one run achieved."""

    fidelity: str
    seed: int
    tasks_done: int
    tasks_failed: int
    throughput_per_h: float
    task_time_s: float | None
    """From release to delivery, mean of the tasks done [s]."""
    drive_s: float | None
    """From a parcel in the tray to the arrival at its drop dock, mean [s]."""
    service_s: float | None
    """From the arrival at a dock until the parcel is where it should be, mean over all docks [s]."""
    waiting_share: float
    """Share of the cars' time in which they stood in traffic or queued for a station."""
    robot_contacts: int
    static_contacts: int
    slip_max_m: float | None
    """The farthest that a parcel lay at release from where it was gripped; None without physics."""
    stalled: bool
    """Nothing went on any more before the time was up."""
    state_hash: str
    arrivals_s: Mapping[str, float]
    """From the release of each order to the first arrival at its docks [s], by ``ORDER pick`` and ``ORDER drop``."""


def measure_run(config: RunConfig) -> GapRow:
    """Run for the whole time; see `run_whole_time`."""
    docks = _Docks()
    if config.fidelity is Fidelity.ABSTRACT:
        run = AbstractRun(config)
        watch = _DockWatch(run, docks)
        run.run_whole_time(watch.look)
        return _abstract_row(run, docks)
    with Simulation(config) as simulation:
        simulation.board.subscribe(docks.moved)
        run_whole_time(simulation)
        return _row(config, simulation, docks)


@dataclass(kw_only=True)
class _Docks:
    """When cars came to docks, and how long they were served there."""

    arrivals_s: dict[str, float] = field(default_factory=dict)
    drives_s: list[float] = field(default_factory=list)
    services_s: list[float] = field(default_factory=list)

    def arrive(self, order: Order, end: str, now_s: float) -> None:
        """A car has come to the dock at an end of an order, ``pick`` or ``drop``."""
        self.arrivals_s.setdefault(f"{order.name} {end}", round(now_s - order.release_s, 3))

    def moved(self, task: Task, before: TaskState, now_s: float) -> None:
        """Take in one step of a task."""
        if task.state is TaskState.LOADING:
            self.arrive(task.order, "pick", now_s)
        elif task.state is TaskState.UNLOADING:
            self.arrive(task.order, "drop", now_s)
            self.drives_s.append(now_s - task.since_s[TaskState.CARRIED])
        elif (before, task.state) in (
            (TaskState.LOADING, TaskState.CARRIED),
            (TaskState.UNLOADING, TaskState.DELIVERED),
        ):
            self.services_s.append(now_s - task.since_s[before])


def _row(config: RunConfig, simulation: Simulation, docks: _Docks) -> GapRow:
    done = simulation.board.in_state(*DONE_STATES)
    times = task_times_s(done)
    contacts = simulation.world.contacts()
    return GapRow(
        **_figures(config, len(done), times, simulation.metrics.time_accounts.fleet_time(), docks),
        tasks_failed=simulation.board.count(TaskState.FAILED),
        robot_contacts=contacts.robot,
        static_contacts=contacts.static,
        slip_max_m=simulation.summary().slip_max_m,
        stalled=simulation.stalled and not simulation.board.finished,
        state_hash=simulation.state_hash(),
    )


def _figures(config: RunConfig, n_done: int, times_s: list[float], spent: CarTime, docks: _Docks) -> dict[str, Any]:
    """What is told of any run alike, by the name of its column."""
    waited = spent.traffic + spent.queue + spent.plan_late
    return {
        "fidelity": config.fidelity.value,
        "seed": config.seed,
        "tasks_done": n_done,
        "throughput_per_h": round(n_done * 3600.0 / config.duration_s, 3),
        "task_time_s": _mean(times_s),
        "drive_s": _mean(docks.drives_s),
        "service_s": _mean(docks.services_s),
        "waiting_share": round(waited / max(sum(vars(spent).values()), 1), 5),
        "arrivals_s": docks.arrivals_s,
    }


class _DockWatch:
    """Looks, timestep by timestep, which cars of an abstract run have come to docks and which have been served.

    Args:
        run: The run.
        docks: Receives what is seen.
    """

    def __init__(self, run: AbstractRun, docks: _Docks) -> None:
        self._docks = docks
        self._phase = run.fleet.cars.phase.copy()
        self._since_s = np.zeros(len(self._phase))
        # Tasks of one order follow each other.
        first = run.fleet.tasks.order
        floor = run.fleet.place.floor
        # As in whole runs, who brakes into a dock has not come to it yet.
        self._docking_s = TIMESTEP_S * (np.array([floor.load_steps, floor.unload_steps]) - run.handling)
        self._order_of = np.cumsum(first == np.arange(len(first))) - 1

    def look(self, run: AbstractRun) -> None:
        """Take in a timestep."""
        cars, phase = run.fleet.cars, run.fleet.cars.phase
        for car in np.flatnonzero(phase != self._phase).tolist():
            if self._phase[car] in (Phase.LOADING, Phase.UNLOADING):
                self._docks.services_s.append(run.sim_s - self._since_s[car])
            now_s = run.sim_s
            if phase[car] in (Phase.LOADING, Phase.UNLOADING):
                is_drop = int(phase[car] == Phase.UNLOADING)
                now_s += self._docking_s[is_drop, cars.station[car]]
                order = run.orders[self._order_of[cars.task[car]]]
                self._docks.arrive(order, "drop" if is_drop else "pick", now_s)
                if is_drop:
                    self._docks.drives_s.append(now_s - self._since_s[car])
            self._since_s[car] = now_s
        self._phase[:] = phase


def _abstract_row(run: AbstractRun, docks: _Docks) -> GapRow:
    times_s = run.told().times_s().tolist()
    return GapRow(
        **_figures(run.config, len(times_s), times_s, run.accounts.car_time(), docks),
        tasks_failed=0,
        robot_contacts=0,
        static_contacts=0,
        slip_max_m=None,
        stalled=run.stalled,
        state_hash=run.state_hash(),
    )


def _mean(values: list[float]) -> float | None:
    return round(float(np.mean(values)), 4) if values else None
