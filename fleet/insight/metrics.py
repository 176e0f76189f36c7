"""Metrics: what a run achieved, counted from what was executed, never from what was planned."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.insight.bounds import Bounds, bounds_of, deliveries_of
from fleet.insight.causes import DETAILS
from fleet.insight.codebook import Codebook
from fleet.insight.slip import Slip
from fleet.insight.time_accounts import STANDING_MPS, ArmTime, CarTime, TimeAccounts, percentages
from fleet.insight.time_table import Blame, blame_of
from fleet.missions.parcels.perception import PoseSource
from fleet.run.view import RunView
from fleet.tasks.batches import Batches
from fleet.tasks.board import DONE_STATES, UNDER_WAY, Task, TaskState

BUSY = 0.5
"""A station that works a smaller share of the time keeps nobody up for long."""
_WAITING = (TaskState.BACKLOG, TaskState.READY, *UNDER_WAY)


@dataclass(frozen=True, kw_only=True)
class StationReport:
    """Figures of one station."""

    transfers_n: int
    service_mean_s: float | None
    """Time the arm is taken by one transfer, mean of the last ones; None if there was none [s]."""
    service_p90_s: float | None
    """The 90th percentile of these [s]."""
    busy_share: float
    """Share of the run in which the arm was at work for a car."""
    contended_share: float
    """Share of the run in which it was, and another car waited for it."""
    cap_n: int
    """Cars it takes at once, bound for it or standing at it."""
    most_cars_n: int
    """Most cars it ever had at once."""
    waiting_s: float
    """Time cars waited for it while it was busy, all cars together [s]."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Figures of a run."""

    tasks_total: int
    tasks_done: int
    tasks_failed: int
    tasks_cancelled: int
    visits_done: int
    """Moves, patrols, inspections, charging and parking among the tasks done."""
    batches: int
    batches_done: int
    """Batches of which everything was done."""
    batch_span_mean_s: float | None
    """From the release of a batch until the last of it was done, mean over those that are done [s]; None = none."""
    sim_s: float
    throughput_per_h: float
    task_time_mean_s: float | None
    """From release to delivery, or to the end of a visit [s]; None when nothing was done."""
    task_time_p95_s: float | None
    on_time_share: float | None
    """Share of the tasks with a due date that were done by then, of those done or overdue; None = none."""
    tardiness_mean_s: float | None
    """Time by which tasks with a due date were late, 0 for those in time, mean over the same tasks [s]."""
    oldest_open_s: float
    """Time since the release of the oldest task that is released and not done [s]."""
    distance_loaded_m: float
    distance_empty_m: float
    waiting_s: float
    """Time cars with a mission stood in the lanes, all cars together [s]."""
    arm_utilisation: float
    """Share of the time that arms planned or moved, mean over arms."""
    robot_contacts: int
    static_contacts: int
    min_clearance_m: float | None
    """None when no two robots ever came near each other."""
    parcel_balance: int
    parcels_misplaced: int
    """Parcels that are not where the books say, looked up in the world."""
    parcels_dropped: int
    """Parcels that arms have lost from their grips."""
    slip_median_m: float | None
    """How far parcels lay at release from where they were gripped, seen from the tool, median over what arms carried;
    None without physics, or if nothing was carried."""
    slip_max_m: float | None
    slip_turn_max_rad: float | None
    """The most that one turned in the grip."""
    parcels_located: int
    """Times a camera told where a parcel lies."""
    looks_failed: int
    """Times it could not."""
    pose_error_median_mm: float | None
    """Distance from the located to the true centre of a parcel, median [mm]; None if no camera located any."""
    pose_error_max_mm: float | None
    turn_error_median_deg: float | None
    """Turn between the located and the true edges of a parcel, median [deg]."""
    turn_error_max_deg: float | None
    lowest_charge: float | None
    """Least state of charge any car ever had, 0 to 1; None without batteries."""
    charging_sessions: int
    cars_stranded: int
    """Cars whose battery was ever empty."""
    stations: dict[str, StationReport]
    bounds: Bounds | None
    """What could be delivered at most; None if nothing was delivered."""
    bottleneck: str
    """What binds, and the station with the greatest shares of time busy and busy with cars waiting for it, in words."""
    car_ticks: dict[str, CarTime]
    """Ticks of each car by what they were spent on; the sum is the same for each: the ticks of the run."""
    arm_ticks: dict[str, ArmTime]
    """The same for each arm."""
    time_share_percent: dict[str, float]
    """The same for all cars together in per cent; adds up to 100."""
    idle_percent: dict[str, float]
    """Of that the share in which cars were idle, by why they had no task: `no_order` was left, orders were
    `not_released`, or as `explain_assignment` says of the task that the car could have had."""
    blame: Blame
    """Ticks of all robots, put down to the robots, cells and places that caused them."""
    state_hash: str


class Metrics:
    """Sums per car, updated every tick.

    Args:
        n_cars: Number of cars.
        tick_s: Length of a tick [s].
        time_accounts: Where the time goes.
    """

    def __init__(self, n_cars: int, tick_s: float, time_accounts: TimeAccounts) -> None:
        self.time_accounts = time_accounts
        self._tick_s = tick_s
        self._distance_m = np.zeros((2, n_cars))
        self._waiting_s = np.zeros(n_cars)

    def tick(
        self, speeds: FloatArray, paces: FloatArray, loaded: npt.NDArray[np.int64], bound: npt.NDArray[np.bool_]
    ) -> None:
        """Add one tick.

        Args:
            speeds: Signed speeds [m/s], shape (n_cars,).
            paces: How fast cars move along their paths, where turns on the spot have a length [m/s], shape (n_cars,).
            loaded: 1 for a car with a parcel, else 0, shape (n_cars,).
            bound: True for a car on its way to a station, shape (n_cars,).
        """
        _add(speeds, paces, loaded, bound, self._tick_s, self._distance_m, self._waiting_s)

    def summary(self, run: RunView, batches: Batches, slips: Sequence[Slip], codebook: Codebook) -> Summary:
        """Figures of the run so far.

        Args:
            run: The run.
            batches: Its batches.
            slips: How far parcels slipped in the grip, one for each carry; empty if that is not measured.
            codebook: Names robots, places and tasks.
        """
        board, world = run.board, run.world
        done = board.in_state(*DONE_STATES)
        times = task_times_s(done)
        spans_s = batches.spans_s
        late = lateness_s(board.tasks, run.sim_s)
        waiting = [task for task in board.in_state(*_WAITING) if TaskState.BACKLOG in task.since_s]
        contacts = world.contacts()
        clearance = world.min_clearance_m()
        sim_s = run.sim_s
        slips_m = [slip.slip_m for slip in slips]
        batteries, charging = run.batteries, run.charging
        bounds = bounds_of(run, deliveries_of(done, run.stations), sim_s, from_start=True)
        return Summary(
            tasks_total=len(board.tasks),
            tasks_done=len(done),
            tasks_failed=board.count(TaskState.FAILED),
            tasks_cancelled=board.count(TaskState.CANCELLED),
            visits_done=board.count(TaskState.DONE),
            batches=batches.n,
            batches_done=len(spans_s),
            batch_span_mean_s=round(float(np.mean(spans_s)), 2) if spans_s else None,
            sim_s=round(sim_s, 3),
            throughput_per_h=round(len(done) * 3600.0 / sim_s, 2) if sim_s > 0 else 0.0,
            task_time_mean_s=round(float(np.mean(times)), 2) if times else None,
            task_time_p95_s=round(float(np.percentile(times, 95)), 2) if times else None,
            on_time_share=on_time_share(late),
            tardiness_mean_s=mean_tardiness_s(late),
            oldest_open_s=round(max((sim_s - task.since_s[TaskState.BACKLOG] for task in waiting), default=0.0), 2),
            distance_loaded_m=round(float(self._distance_m[1].sum()), 2),
            distance_empty_m=round(float(self._distance_m[0].sum()), 2),
            waiting_s=round(float(self._waiting_s.sum()), 2),
            arm_utilisation=round(float(np.mean(run.arm_manager.busy_s())) / sim_s, 4) if sim_s > 0 else 0.0,
            robot_contacts=contacts.robot,
            static_contacts=contacts.static,
            min_clearance_m=round(clearance, 4) if np.isfinite(clearance) else None,
            parcel_balance=run.inventory.balance(),
            parcels_misplaced=len(run.inventory.misplaced()),
            parcels_dropped=run.arm_manager.n_dropped,
            slip_median_m=round(float(np.median(slips_m)), 6) if slips_m else None,
            slip_max_m=round(max(slips_m), 6) if slips_m else None,
            slip_turn_max_rad=round(max(slip.turn_rad for slip in slips), 5) if slips else None,
            **_seen(run.perception),
            lowest_charge=round(batteries.lowest, 4) if batteries is not None else None,
            charging_sessions=charging.n_sessions if charging is not None else 0,
            cars_stranded=int(batteries.emptied.sum()) if batteries is not None else 0,
            stations=self._stations(run),
            bounds=bounds,
            bottleneck=f"{bounds}; {self._busiest(run)}" if bounds is not None else self._busiest(run),
            car_ticks={f"car_{car}": self.time_accounts.car_time(car) for car in range(world.n_cars)},
            arm_ticks={f"arm_{arm}": self.time_accounts.arm_time(arm) for arm in range(world.n_arms)},
            time_share_percent=_shares(self.time_accounts.fleet_time()),
            idle_percent=self._idle(),
            blame=blame_of(self.time_accounts, codebook),
            state_hash=run.state_hash(),
        )

    def _stations(self, run: RunView) -> dict[str, StationReport]:
        ticks = max(run.now, 1)
        reports = {}
        for station in run.stations:
            service = run.stations.times.of(station.arm, station.direction)
            time = self.time_accounts.station_time(station.arm)
            reports[station.name] = StationReport(
                transfers_n=service.n,
                service_mean_s=round(service.mean_s, 2) if service.n else None,
                service_p90_s=round(service.p90_s, 2) if service.n else None,
                busy_share=round(time.busy / ticks, 4),
                contended_share=round(time.contended / ticks, 4),
                cap_n=run.bookings.caps[station.arm],
                most_cars_n=run.bookings.most[station.arm],
                waiting_s=round(time.waiting * self._tick_s, 2),
            )
        return reports

    def _idle(self) -> dict[str, float]:
        idle, total = self.time_accounts.idle, max(int(self.time_accounts.cars.sum()), 1)
        return {DETAILS[k] or "no_order": round(100.0 * int(idle[k]) / total, 1) for k in idle.nonzero()[0].tolist()}

    def _busiest(self, run: RunView) -> str:
        worst = self.time_accounts.bottleneck()
        if worst is None:
            return "no car waited for a busy station"
        time, ticks = self.time_accounts.station_time(worst), max(run.now, 1)
        name = f"{run.stations[worst].name} (arm_{worst})"
        if time.busy < BUSY * ticks:
            return f"no station: the busiest one, {name}, works {100.0 * time.busy / ticks:.0f} % of the time"
        busy, contended = 100.0 * time.busy / ticks, 100.0 * time.contended / ticks
        return f"{name}: busy {busy:.0f} % of the time, cars waiting for it {contended:.0f} %"


def _seen(perception: PoseSource) -> dict[str, Any]:
    """Figures of what cameras located."""
    apart_mm = [1000.0 * error.distance_m for error in perception.errors]
    turn_deg = [math.degrees(error.turn_rad) for error in perception.errors]
    return {
        "parcels_located": len(apart_mm),
        "looks_failed": perception.n_blind,
        "pose_error_median_mm": round(float(np.median(apart_mm)), 3) if apart_mm else None,
        "pose_error_max_mm": round(max(apart_mm), 3) if apart_mm else None,
        "turn_error_median_deg": round(float(np.median(turn_deg)), 3) if turn_deg else None,
        "turn_error_max_deg": round(max(turn_deg), 3) if turn_deg else None,
    }


def _shares(time: CarTime) -> dict[str, float]:
    names = [field.name for field in fields(CarTime)]
    return dict(zip(names, percentages([getattr(time, name) for name in names]), strict=True))


@njit(cache=True)
def _add(speeds, paces, loaded, bound, tick_s, distance_m, waiting_s):
    for car in range(len(speeds)):
        distance_m[loaded[car], car] += abs(speeds[car]) * tick_s
        if bound[car] and abs(paces[car]) < STANDING_MPS:
            waiting_s[car] += tick_s


def task_times_s(done: Iterable[Task]) -> list[float]:
    """How long tasks took from the tick in which their order came in [s]."""
    return [task.done_s - task.since_s[TaskState.BACKLOG] for task in done if task.done_s is not None]


def on_time_share(late_s: Sequence[float]) -> float | None:
    """Share of what `lateness_s` tells that is not late; None without due dates."""
    return round(float(np.mean(np.array(late_s) <= 0.0)), 4) if late_s else None


def mean_tardiness_s(late_s: Sequence[float]) -> float | None:
    """Mean of what `lateness_s` tells, where early ones count as on time [s]; None without due dates."""
    return round(float(np.mean(np.maximum(late_s, 0.0))), 2) if late_s else None


def lateness_s(tasks: Iterable[Task], now_s: float) -> list[float]:
    """End less due date of the tasks that have both, and for overdue ones the time since their due date [s]."""
    kept = (task for task in tasks if task.state is not TaskState.CANCELLED)
    return late_of(((task.done_s, task.order.due_s) for task in kept), now_s)


def late_of(times: Iterable[tuple[float | None, float]], now_s: float) -> list[float]:
    """The same of pairs of end and due date: None = not ended, inf = due at any time [s]."""
    late = []
    for end_s, due_s in times:
        if math.isinf(due_s):
            continue
        if end_s is not None:
            late.append(end_s - due_s)
        elif now_s > due_s:
            late.append(now_s - due_s)
    return late
