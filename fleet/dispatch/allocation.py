"""Allotment: which car should take which ready task, by the allocator that the run names, and why no other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.config import AllocationConfig
from fleet.dispatch.availability import Availability
from fleet.dispatch.costs import CostMatrix, CostModel
from fleet.dispatch.horizon import RollingHorizon
from fleet.missions.visit_routes import VisitRoutes
from fleet.stations.booking import Bookings
from fleet.stations.service_time import Direction, ServiceTimes
from fleet.stations.station import Station
from fleet.tasks.board import UNDER_WAY, Task, TaskBoard, TaskState
from fleet.tasks.reasons import CODE_OF_REASON, PAIR_REASONS, Decision, PairReason, ReasonBook, TaskReason
from planners.allocation.problem import NO_TASK, AllocationProblem, Assignment
from planners.allocation.reasons import Reason, reasons

_PAIR_REASON = {
    Reason.CHOSEN: PairReason.CHOSEN,
    Reason.NOT_ALLOWED: PairReason.NO_WAY,
    Reason.PLANNED_LATER: PairReason.PLANNED_LATER,
    Reason.CLASS_FIRST: PairReason.CLASS_FIRST,
    Reason.KEPT: PairReason.KEPT,
    Reason.TASK_GOT_NEARER: PairReason.TASK_GOT_BETTER,
    Reason.VEHICLE_GOT_BETTER: PairReason.CAR_GOT_BETTER,
    Reason.BETTER_FOR_ALL: PairReason.BETTER_FOR_ALL,
    Reason.LEFT_FOR_LATER: PairReason.LEFT_OVER,
}
QUEUE_S = 60.0
"""No task is given out at a station while those under way to it keep its arm busy for longer than this [s]."""
PLAN_N = 100
"""Tasks at most that are planned before their parcels lie on slots."""
_CODE = CODE_OF_REASON
_CODE_OF = np.array([_CODE[_PAIR_REASON[reason]] for reason in Reason], dtype=np.int8)
"""What the planners' reasons are called here, by their value."""


@dataclass(frozen=True, kw_only=True)
class Situation:
    """What cars are about, as far as it matters for who gets what."""

    standing: Sequence[PairReason | None]
    """Why each car cannot take a task now, shape (n_cars,); None = it can."""
    held: Mapping[int, Task]
    """Tasks that cars have but may still give away, by car; these cars can take another."""
    kept: Mapping[int, Task]
    """Tasks that no other car may have, by car; these cars can take no other."""
    busy: Mapping[int, Availability]
    """When cars will be free that cannot take a task now, as far as that is known, by car."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What an allocation changes."""

    taken: list[tuple[int, str]]
    """Cars that lose the task they had not picked yet, and why."""
    given: list[tuple[int, Task]]
    """Cars and their new tasks."""


class TaskAllocation:
    """Poses the allocation problem, hands on its answer, and keeps the reasons.

    Args:
        config: Allocator and hysteresis.
        board: The tasks.
        stations: By name.
        bookings: Room at the stations.
        service_times: How long the arms take.
        cost_model: What each task costs each car.
        horizon: What can be given out, for allocators that plan ahead.
        filling: The same with what waits for a slot, which says in which order slots are filled.
        ways: Of visits.
        reason_book: Told about every decision.
        log: Called as ``log("allocator_note", **facts)`` when the allocator has something new to say.
    """

    def __init__(
        self,
        *,
        config: AllocationConfig,
        board: TaskBoard,
        stations: Mapping[str, Station],
        bookings: Bookings,
        service_times: ServiceTimes,
        cost_model: CostModel,
        horizon: RollingHorizon,
        filling: RollingHorizon,
        ways: VisitRoutes,
        reason_book: ReasonBook,
        log: Callable[..., None],
    ) -> None:
        self._config = config
        self._board = board
        self._stations = stations
        self._bookings = bookings
        self._service_times = service_times
        self._cost_model = cost_model
        self._horizon = horizon
        self._filling = filling
        self._ways = ways
        self._reasons = reason_book
        self._log = log
        self._notes: set[str] = set()
        self._allocator = config.make_allocator()
        self._plans_ahead = bool(getattr(self._allocator, "plans_ahead", False))
        self._soon_s = np.inf if self._plans_ahead else float(getattr(self._allocator, "soon_s", 0.0))

    def choose(self, situation: Situation, now_s: float) -> Choice:
        """Pairs of a car and a task, at most one for each.

        Raises:
            PlanningError: An allocator of one's own gave an answer that is not legal.
        """
        ready, held = self._board.in_state(TaskState.READY), situation.held
        if not ready and len(held) < 2:
            return Choice(taken=[], given=[])
        soon = {
            car: availability for car, availability in situation.busy.items() if availability.free_s <= self._soon_s
        }
        costs = self._cost_model.of([*ready, *held.values()], situation.standing, situation.kept, soon, now_s)
        offered, full = self._offered(costs, len(ready))
        column_of, later = self._allocate(costs, [*offered, *range(len(ready), len(costs.tasks))], held, soon)
        self._keep_reasons(costs, full, column_of, later)
        taken, given = [], []
        for car, task in held.items():
            if column_of[car] < 0 or costs.tasks[column_of[car]] is not task:
                taken.append((car, self._why_taken(costs, column_of, car, task)))
        for car, column in enumerate(column_of.tolist()):
            if column >= 0 and held.get(car) is not costs.tasks[column]:
                given.append((car, costs.tasks[column]))
        return Choice(taken=taken, given=given)

    def plan_filling(self, situation: Situation, now_s: float) -> None:
        """Plan also what waits for a slot, so that slots are filled in the order of the plan.

        Cars are not sent by this plan: what they are to do first is often not there yet.
        """
        waiting = self._to_come() if self._plans_ahead else []
        if not waiting:
            return
        tasks = [*self._board.in_state(TaskState.READY), *situation.held.values(), *waiting]
        costs = self._cost_model.of(tasks, situation.standing, situation.kept, situation.busy, now_s)
        columns = [column for column in range(len(tasks)) if costs.offers(column)]
        cars = np.flatnonzero(np.isfinite(costs.cost_s).any(axis=1))
        if columns and len(cars):
            problem = self._problem(costs, columns, cars, situation.held, self._filling)
            self._filling.keep(costs, problem, self._answer(problem), columns, cars)

    def _to_come(self) -> list[Task]:
        """Deliveries whose parcels do not lie on slots yet, the most urgent class first, then the oldest."""
        waiting = [task for task in self._board.in_state(TaskState.BACKLOG) if task.visit is None]
        free = [task for task in waiting if self._board.waits_for(task) is None]
        return sorted(free, key=lambda task: (task.order.priority.rank, task.index))[:PLAN_N]

    def _offered(self, costs: CostMatrix, n_ready: int) -> tuple[list[int], set[int]]:
        """Ready tasks that a car can take and that there is room for, the most urgent first; those without room."""
        room = self._room()
        place_room: dict[int, int] = {}
        offered: list[int] = []
        full: set[int] = set()
        order = sorted(
            range(n_ready),
            key=lambda k: (costs.tasks[k].order.priority.rank, -costs.pressure_s[k], costs.tasks[k].index),
        )
        for k in order:
            task = costs.tasks[k]
            if task.visit is not None:
                if costs.offers(k) and self._ways.take_room(task, place_room):
                    offered.append(k)
                elif costs.offers(k):
                    full.add(k)
                continue
            ends = (task.pick, task.delivery.drop)
            if any(room[name] <= 0 for name in ends):
                full.add(k)
            elif costs.offers(k):
                offered.append(k)
                # Who plans ahead knows that an arm serves one car at a time.
                for name in ends if not self._plans_ahead else ():
                    room[name] -= 1
        return offered, full

    def _room(self) -> dict[str, int]:
        """Tasks that can be given out at each station, by name."""
        room = {}
        for name, station in self._stations.items():
            service_s = self._service_times.of(station.arm, station.direction).mean_s
            # At least one car more than may be near: it is held back if it comes too early.
            room[name] = max(self._bookings.caps[station.arm] + 1, round(QUEUE_S / service_s))
            if station.direction is Direction.TO_CAR:
                room[name] -= len(self._bookings.bound(station.arm))
        for task in self._board.in_state(*UNDER_WAY):
            if task.visit is None:
                room[task.delivery.drop] -= 1
        return room

    def _allocate(
        self, costs: CostMatrix, columns: list[int], held: Mapping[int, Task], soon: Mapping[int, Availability]
    ) -> tuple[npt.NDArray[np.int64], dict[int, int]]:
        """Pose the problem; fills the codes of `costs`.

        Returns:
            The column of the task that each car has then, -1 for none, shape (n_cars,), and by column the car that is
            to take a task when it is free.
        """
        column_of = np.full(len(costs.cost_s), -1, dtype=np.int64)
        later: dict[int, int] = {}
        cars = np.flatnonzero(np.isfinite(costs.cost_s[:, columns]).any(axis=1))
        if not columns or not len(cars):
            return column_of, later
        horizon = self._horizon if self._plans_ahead else None
        problem = self._problem(costs, columns, cars, held, horizon)
        assignment = self._answer(problem)
        if horizon is not None:
            horizon.keep(costs, problem, assignment, columns, cars)
        pairs = np.ix_(cars, np.array(columns))
        told = _CODE_OF[reasons(problem, assignment)]
        costs.codes[pairs] = np.where(np.isfinite(problem.cost), told, costs.codes[pairs])
        for car in soon:
            costs.codes[car, costs.codes[car] != _CODE[PairReason.NO_WAY]] = _CODE[PairReason.CAR_BUSY]
        lists = assignment.sequence or [assignment.pairs[assignment.pairs[:, 0] == row, 1] for row in range(len(cars))]
        for car, planned in zip(cars.tolist(), lists, strict=True):
            for column in (columns[k] for k in planned):
                if car in soon:
                    later[column] = car
                    costs.codes[car, column] = _CODE[PairReason.PLANNED_LATER]
                elif column_of[car] < 0:
                    column_of[car] = column
                    costs.codes[car, column] = _CODE[PairReason.CHOSEN]
        return column_of, later

    def _answer(self, problem: AllocationProblem) -> Assignment:
        """What the allocator says; a note is logged once."""
        found = self._allocator.allocate(problem)
        if found.note and found.note not in self._notes:
            self._notes.add(found.note)
            self._log("allocator_note", allocator=self._config.allocator, note=found.note)
        return found

    def _problem(
        self,
        costs: CostMatrix,
        columns: list[int],
        cars: npt.NDArray[np.intp],
        held: Mapping[int, Task],
        horizon: RollingHorizon | None,
    ) -> AllocationProblem:
        """Some tasks and cars as the allocators read them."""
        tasks = [costs.tasks[column] for column in columns]
        at = {task.index: k for k, task in enumerate(tasks)}
        has = [at.get(held[car].index, NO_TASK) if car in held else NO_TASK for car in cars.tolist()]
        return AllocationProblem(
            cost=costs.cost_s[np.ix_(cars, np.array(columns))],
            class_of=np.array([task.order.priority.rank for task in tasks], dtype=np.int32),
            since_s=np.array([task.since_s[TaskState.BACKLOG] for task in tasks]),
            held=np.array(has, dtype=np.int32),
            keep_gain=self._config.keep_gain_s,
            keep_share=self._config.keep_share,
            shop=horizon.shop(costs, tasks, cars, held) if horizon is not None else None,
        )

    def _why_taken(self, costs: CostMatrix, column_of: npt.NDArray[np.int64], car: int, task: Task) -> str:
        """Why a car loses a task, in words."""
        column = next(k for k, other in enumerate(costs.tasks) if other is task)
        takers = np.flatnonzero(column_of == column)
        words = [f"cost car_{car} {costs.cost_s[car, column]:.1f} s"]
        if takers.size:
            words.append(f"costs car_{takers[0]} {costs.cost_s[takers[0], column]:.1f} s")
        if column_of[car] >= 0:
            words.append(f"car_{car} takes {costs.tasks[column_of[car]].order.name}")
        return "re-assigned: " + ", ".join(words)

    def _keep_reasons(
        self,
        costs: CostMatrix,
        full: set[int],
        column_of: npt.NDArray[np.int64],
        later: Mapping[int, int],
    ) -> None:
        took = self._names(costs, column_of)
        free = _CODE[PairReason.LEFT_OVER]
        taker_of = np.full(len(costs.tasks), -1)
        cars = np.flatnonzero(column_of >= 0)
        taker_of[column_of[cars]] = cars
        for k, (task, taker) in enumerate(zip(costs.tasks, taker_of.tolist(), strict=True)):
            codes = costs.codes[:, k].copy()
            if k in full:
                codes[codes == free] = _CODE[PairReason.NOT_OFFERED]
            cost_s = costs.cost_s[:, k].copy()
            decision = Decision(time_s=costs.now_s, codes=codes, cost_s=cost_s, took=took, taker=taker)
            self._reasons.decide(task, decision)
            if k in later:
                text = f"car_{later[k]} is to take it, and will be free in {costs.free_s[later[k]]:.0f} s"
                self._reasons.note(task, TaskReason.PLANNED, text, costs.now_s)
            elif taker < 0:
                self._reasons.note(task, *self._why_open(task, codes, k in full), costs.now_s)

    def _names(self, costs: CostMatrix, column_of: npt.NDArray[np.int64]) -> list[str]:
        """The name of the task each car has, empty for none."""
        names = [""] * len(column_of)
        for task in self._board.in_state(*UNDER_WAY):
            if task.car is not None:
                names[task.car] = task.order.name
        for car, column in enumerate(column_of.tolist()):
            if column >= 0:
                names[car] = costs.tasks[column].order.name
        return names

    def _why_open(self, task: Task, codes: npt.NDArray[np.int8], full: bool) -> tuple[TaskReason, str]:
        """Why nobody got a ready task; what lasts longest counts first."""
        reasons = {PAIR_REASONS[code] for code in codes.tolist()}
        ends = (task.pick, task.delivery.drop) if task.visit is None else (task.next_words,)
        unfit = {PairReason.TOO_HEAVY, PairReason.LACKS_CAPABILITY, PairReason.CAR_OUT}
        if reasons <= unfit:
            return TaskReason.NO_CAPABLE_CAR, "every car that could do it is out of service"
        if reasons <= unfit | {PairReason.NO_WAY}:
            return TaskReason.UNREACHABLE, f"no car has a way to {' and on to '.join(ends)}"
        if reasons <= unfit | {PairReason.NO_WAY, PairReason.LOW_CHARGE, PairReason.CAR_CHARGES}:
            return TaskReason.CARS_CHARGE, "every car that could take it has to charge before"
        if full:
            return TaskReason.STATION_FULL, f"{' or '.join(ends)} has no room for one more car"
        if PairReason.OTHER_CAR in reasons and PairReason.LEFT_OVER not in reasons:
            return TaskReason.WAITS_FOR_ITS_CAR, "the car that did the leg before it cannot go on yet"
        if PairReason.LEFT_OVER in reasons:
            return TaskReason.LEFT_OVER, "the allocator left it and a free car over"
        return TaskReason.NO_FREE_CAR, "every car that could take it has another task"
