"""Allotment: which car should take which ready task, by the allocator that the run names, and why no other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.charging import Charging
from fleet.config import AllocationConfig
from fleet.errors import ConfigError
from fleet.executor import Executor
from fleet.outlook import STEP_S, Outlook
from fleet.stations.booking import Bookings
from fleet.stations.service_time import Direction, ServiceTimes
from fleet.stations.station import Station
from fleet.tasks.board import UNDER_WAY, Task, TaskBoard, TaskState
from fleet.tasks.order import Ability
from fleet.tasks.reasons import PAIR_REASONS, Decision, PairReason, ReasonBook, TaskReason
from fleet.traffic import Traffic
from planners.allocation import AllocatorError, allocator_named
from planners.allocation.problem import NO_TASK, AllocationProblem
from planners.allocation.reasons import Reason, reasons
from planners.allocation.shop import Shop
from planners.mapf.distance_table import UNREACHABLE

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
SLOT_S = 15.0
"""A slot is expected to become free so soon if no car is under way to empty one [s]."""
AGED_S = 150.0
"""In plans over cars and arms the end of a task of this age, times the weight of ageing, counts twice [s]."""
_CODE = {reason: code for code, reason in enumerate(PAIR_REASONS)}
_CODE_OF = np.array([_CODE[_PAIR_REASON[reason]] for reason in Reason], dtype=np.int8)
"""What the planners' reasons are called here, by their value."""


def require_allocator(name: str, what: str) -> None:
    """Refuse an allocator that does not exist.

    Args:
        name: Its name in the table of allocators, or `package.module.Class`.
        what: Name of the setting as a user types it.

    Raises:
        ConfigError: There is none of that name, or it cannot be made.
    """
    try:
        allocator_named(name)
    except AllocatorError as error:
        raise ConfigError(f"{what} is {name!r}: {str(error).partition(': ')[2]}") from error


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What an allocation changes."""

    taken: list[tuple[int, str]]
    """Cars that lose the task they had not picked yet, and why."""
    given: list[tuple[int, Task]]
    """Cars and their new tasks."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Costs:
    """What each task costs each car, tasks in the columns."""

    now_s: float
    tasks: list[Task]
    cost_s: npt.NDArray[np.float64]
    """Shape (n_cars, n_tasks); inf = not allowed."""
    codes: npt.NDArray[np.int8]
    """Why a pair is not allowed, as an index into `PAIR_REASONS`; `LEFT_OVER` where it is, same shape."""
    pressure_s: list[float]
    """How much a task presses for being served, the same for all cars [s]."""
    states: npt.NDArray[np.int_]
    """Where each car is when it is free, shape (n_cars,)."""
    free_s: npt.NDArray[np.float64]
    """Time until then, shape (n_cars,)."""


class Allotment:
    """Poses the allocation problem, hands on its answer, and keeps the reasons.

    What a task costs a car is its travel to the pick station, plus a weight times the time it would be late with that
    car, less what the task presses for: a weight times its age, and a weight times the time it would be late if it were
    left to the next turn, as long as itself, even with the best car. So of the tasks a late one goes first, and of the
    cars the one that brings it in time. (That a late task must get cheaper, not dearer, by waiting is the idea of the
    apparent tardiness cost rule: Vepsalainen, Morton, "Priority rules for job shops with weighted tardiness costs",
    Management Science 33(8), 1987.)

    Args:
        config: Allocator, ageing, lateness, hysteresis.
        board: The tasks.
        stations: All stations.
        bookings: Room at the stations.
        service_times: How long the arms take.
        abilities: What each car can carry.
        charging: Tells which cars have the charge for a task; None = all.
        traffic: Gives distances on the lane graph.
        executor: Gives the states cars can be sent from.
        reason_book: Told about every decision.
    """

    def __init__(
        self,
        *,
        config: AllocationConfig,
        board: TaskBoard,
        stations: list[Station],
        bookings: Bookings,
        service_times: ServiceTimes,
        abilities: Sequence[Ability],
        charging: Charging | None,
        traffic: Traffic,
        executor: Executor,
        reason_book: ReasonBook,
    ) -> None:
        self._config = config
        self._board = board
        self._by_name = {station.name: station for station in stations}
        self._bookings = bookings
        self._service_times = service_times
        self._abilities = abilities
        self._charging = charging
        self._traffic = traffic
        self._executor = executor
        self._reasons = reason_book
        self._allocator = allocator_named(config.allocator)
        self._plans_ahead = bool(getattr(self._allocator, "plans_ahead", False))
        self._soon_s = np.inf if self._plans_ahead else float(getattr(self._allocator, "soon_s", 0.0))
        self._unfit: dict[int, npt.NDArray[np.int8]] = {}
        self._plan: list[tuple[int, int]] = []
        self._turn_s: dict[int, float] = {}

    def turn_s(self, task: Task) -> float:
        """When a task is planned to be picked [s]; inf = that is not planned."""
        return self._turn_s.get(task.index, np.inf)

    def choose(
        self,
        standing: Sequence[PairReason | None],
        held: Mapping[int, Task],
        busy: Mapping[int, Outlook],
        now_s: float,
    ) -> Choice:
        """Pairs of a car and a task, at most one for each.

        Args:
            standing: Why each car cannot take a task now, shape (n_cars,); None = it can.
            held: Tasks that cars have but may still give away, by car; these cars can take another.
            busy: When cars will be free that cannot take a task now, as far as that is known, by car.
            now_s: Simulated time [s].
        """
        ready = self._board.in_state(TaskState.READY)
        if not ready and len(held) < 2:
            return Choice(taken=[], given=[])
        soon = {car: outlook for car, outlook in busy.items() if outlook.free_s <= self._soon_s}
        costs = self._costs([*ready, *held.values(), *self._backlog()], standing, soon, now_s)
        offered, full = self._offered(costs, len(ready))
        column_of, later = self._allocate(costs, [*offered, *range(len(ready), len(costs.tasks))], held, soon)
        self._keep_reasons(costs, len(ready) + len(held), full, column_of, later)
        taken, given = [], []
        for car, task in held.items():
            if column_of[car] < 0 or costs.tasks[column_of[car]] is not task:
                taken.append((car, self._why_taken(costs, column_of, car, task)))
        for car, column in enumerate(column_of.tolist()):
            if column >= 0 and held.get(car) is not costs.tasks[column]:
                given.append((car, costs.tasks[column]))
        return Choice(taken=taken, given=given)

    def source_cost(self, pick: str, task: Task) -> float:
        """Moves from the nearest car to a pick station and on to the task's drop station."""
        state = self._by_name[pick].dock_state
        nearest = int(self._traffic.tables.to(state)[self._executor.tail_states()].min())
        return nearest + self._moves(pick, task.order.drop)

    def least_s(self, task: Task, move_s: float) -> float:
        """The least time from a car's stand at the best pick station to the delivery [s]; inf = there is no way.

        Args:
            task: The task.
            move_s: Time of one move at full speed [s].
        """
        moves = min(self._moves(pick, task.order.drop) for pick in task.order.picks)
        return moves * move_s + self._service_s(task.pick, task.order.drop) if moves < UNREACHABLE else np.inf

    def _moves(self, pick: str, drop: str) -> int:
        return int(self._traffic.tables.to(self._by_name[drop].dock_state)[self._by_name[pick].dock_state])

    def _service_s(self, pick: str, drop: str) -> float:
        """Time at both docks [s]."""
        load = self._service_times.of(self._by_name[pick].arm, Direction.TO_CAR)
        unload = self._service_times.of(self._by_name[drop].arm, Direction.FROM_CAR)
        return load.mean_s + unload.mean_s

    def _backlog(self) -> list[Task]:
        """Tasks to plan whose parcels do not lie on slots yet, the most urgent class first, then the oldest."""
        if not self._plans_ahead:
            return []
        tasks = [task for task in self._board.in_state(TaskState.BACKLOG) if self._board.waits_for(task) is None]
        return sorted(tasks, key=lambda task: (task.order.priority.rank, task.index))[:PLAN_N]

    def _costs(
        self, tasks: list[Task], standing: Sequence[PairReason | None], soon: Mapping[int, Outlook], now_s: float
    ) -> _Costs:
        config = self._config
        tails = self._executor.tail_states().copy()
        free_s = np.zeros(len(tails))
        out = np.array([_CODE[reason] if reason is not None else _CODE[PairReason.LEFT_OVER] for reason in standing])
        for car, outlook in soon.items():
            tails[car], free_s[car], out[car] = outlook.state, outlook.free_s, _CODE[PairReason.LEFT_OVER]
        cost = np.empty((len(tails), len(tasks)))
        codes = np.empty(cost.shape, dtype=np.int8)
        pressure = []
        # Many tasks share few ways.
        to_pick = {
            pick: self._traffic.tables.to(self._by_name[pick].dock_state)[tails].astype(np.float64)
            for pick in dict.fromkeys(task.pick for task in tasks)
        }
        ways = {
            way: (self._moves(*way), self._service_s(*way))
            for way in dict.fromkeys((task.pick, task.order.drop) for task in tasks)
        }
        for k, task in enumerate(tasks):
            moves = to_pick[task.pick]
            loaded, service_s = ways[task.pick, task.order.drop]
            codes[:, k] = self._refusals(task, out, (moves >= UNREACHABLE) | (loaded >= UNREACHABLE))
            if self._charging is not None:
                self._refuse_low(self._charging, codes[:, k], task, moves)
            to_pick_s = free_s + moves * STEP_S
            eta_s = now_s + to_pick_s + loaded * STEP_S + service_s
            late_s = np.maximum(0.0, eta_s - task.order.due_s)
            best_s = float(eta_s.min())
            late_next_turn_s = max(0.0, best_s + (best_s - now_s) - task.order.due_s)
            age_s = now_s - task.since_s[TaskState.BACKLOG]
            pressure.append(config.ageing * age_s + config.lateness * late_next_turn_s)
            cost[:, k] = to_pick_s + config.lateness * late_s - pressure[-1]
        cost[codes != _CODE[PairReason.LEFT_OVER]] = np.inf
        return _Costs(
            now_s=now_s, tasks=tasks, cost_s=cost, codes=codes, pressure_s=pressure, states=tails, free_s=free_s
        )

    def _refusals(
        self, task: Task, out: npt.NDArray[np.int64], unreachable: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.int8]:
        """Why each car cannot take a task, `LEFT_OVER` for those that can; what lasts longest counts first."""
        free = _CODE[PairReason.LEFT_OVER]
        codes = np.where(unreachable, _CODE[PairReason.NO_WAY], out).astype(np.int8)
        codes[out == _CODE[PairReason.CAR_OUT]] = _CODE[PairReason.CAR_OUT]
        unfit = self._unfit.get(task.index)
        if unfit is None:
            heavy, lacks = _CODE[PairReason.TOO_HEAVY], _CODE[PairReason.LACKS_CAPABILITY]
            order = task.order
            unfit = np.array(
                [
                    free if a.fits(order) else heavy if order.mass_kg > a.max_payload_kg else lacks
                    for a in self._abilities
                ],
                dtype=np.int8,
            )
            self._unfit[task.index] = unfit
        codes = np.where(unfit != free, unfit, codes)
        if task.shunned:
            shunned = np.isin(np.arange(len(codes)), list(task.shunned)) & (codes == free)
            # Better one that failed before than nobody.
            if ((codes == free) & ~shunned).any():
                codes[shunned] = _CODE[PairReason.SHUNNED]
        return codes

    def _refuse_low(
        self, charging: Charging, codes: npt.NDArray[np.int8], task: Task, moves: npt.NDArray[np.float64]
    ) -> None:
        """Refuse the cars, of those that could take a task, that have too little charge for it."""
        cars = np.flatnonzero(codes == _CODE[PairReason.LEFT_OVER])
        stations = self._by_name[task.pick], self._by_name[task.order.drop]
        low = cars[~charging.allows(cars.tolist(), moves[cars], *stations, task.order.mass_kg)]
        codes[low] = _CODE[PairReason.LOW_CHARGE]

    def _offered(self, costs: _Costs, n_ready: int) -> tuple[list[int], set[int]]:
        """Ready tasks that a car can take and that there is room for, the most urgent first; those without room."""
        room = {}
        for name, station in self._by_name.items():
            service_s = self._service_times.of(station.arm, station.direction).mean_s
            # A station may have one more under way than it takes: it is held back if it comes too early.
            room[name] = max(self._bookings.caps[station.arm] + 1, round(QUEUE_S / service_s))
            if station.direction is Direction.TO_CAR:
                room[name] -= len(self._bookings.bound(station.arm))
        for task in self._board.in_state(*UNDER_WAY):
            room[task.order.drop] -= 1
        offered, full = [], set()
        order = sorted(
            range(n_ready),
            key=lambda k: (costs.tasks[k].order.priority.rank, -costs.pressure_s[k], costs.tasks[k].index),
        )
        for k in order:
            pick, drop = costs.tasks[k].pick, costs.tasks[k].order.drop
            if room[pick] <= 0 or room[drop] <= 0:
                full.add(k)
            elif np.isfinite(costs.cost_s[:, k]).any():
                if not self._plans_ahead:
                    room[pick] -= 1
                    room[drop] -= 1
                offered.append(k)
        return offered, full

    def _allocate(
        self, costs: _Costs, columns: list[int], held: Mapping[int, Task], soon: Mapping[int, Outlook]
    ) -> tuple[npt.NDArray[np.int64], dict[int, int]]:
        """The column of the task that each car has then, -1 for none, shape (n_cars,); fills the codes of `costs`.

        Also the car that is to take a task when it is free, by column.
        """
        column_of, later = np.full(len(costs.cost_s), -1, dtype=np.int64), {}
        cars = np.flatnonzero(np.isfinite(costs.cost_s[:, columns]).any(axis=1))
        if not columns or not len(cars):
            return column_of, later
        at = {costs.tasks[column].index: k for k, column in enumerate(columns)}
        tasks = [costs.tasks[column] for column in columns]
        problem = AllocationProblem(
            cost=costs.cost_s[np.ix_(cars, np.array(columns))],
            class_of=np.array([task.order.priority.rank for task in tasks], dtype=np.int32),
            since_s=np.array([task.since_s[TaskState.BACKLOG] for task in tasks]),
            held=np.array([at[held[car].index] if car in held else NO_TASK for car in cars.tolist()], dtype=np.int32),
            keep_gain=self._config.keep_gain_s,
            keep_share=self._config.keep_share,
            shop=self._shop(costs, cars, tasks, held) if self._plans_ahead else None,
        )
        assignment = self._allocator.allocate(problem)
        pairs = np.ix_(cars, np.array(columns))
        told = _CODE_OF[reasons(problem, assignment)]
        costs.codes[pairs] = np.where(np.isfinite(problem.cost), told, costs.codes[pairs])
        for car in soon:
            costs.codes[car, costs.codes[car] != _CODE[PairReason.NO_WAY]] = _CODE[PairReason.CAR_BUSY]
        for row, car in enumerate(cars.tolist()):
            planned = assignment.sequence[row] if assignment.sequence else assignment.pairs[assignment.pairs[:, 0] == row, 1]
            for k in planned:
                column = columns[k]
                if car in soon:
                    later[column] = car
                    costs.codes[car, column] = _CODE[PairReason.PLANNED_LATER]
                elif column_of[car] < 0 and costs.tasks[column].state is not TaskState.BACKLOG:
                    column_of[car] = column
                    costs.codes[car, column] = _CODE[PairReason.CHOSEN]
        self._keep_plan(costs, tasks, cars, assignment, problem)
        return column_of, later

    def _keep_plan(self, costs, tasks, cars, assignment, problem) -> None:
        self._plan, self._turn_s = [], {}
        if not assignment.sequence or assignment.timetable is None or problem.shop is None:
            return
        first = problem.shop.first_stop[:-1]
        start_s = assignment.timetable.start_s[first]
        car_of = {k: int(cars[row]) for row, seq in enumerate(assignment.sequence) for k in seq}
        for k in sorted(car_of, key=lambda k: (float(start_s[k]), k)):
            self._plan.append((tasks[k].index, car_of[k]))
            self._turn_s[tasks[k].index] = costs.now_s + float(start_s[k])

    def _shop(
        self, costs: _Costs, cars: npt.NDArray[np.int64], tasks: list[Task], held: Mapping[int, Task]
    ) -> Shop:
        """The same cars and tasks with the arms they book; the clock starts now."""
        now_s = costs.now_s
        stations = list(self._by_name.values())
        n_stations, n_places = len(stations), len(stations) + len(cars)
        # Stations in their order, then where each car is; nobody drives to where a car was.
        states = np.concatenate(([station.dock_state for station in stations], costs.states[cars]))
        travel_s = np.full((n_places, n_places), np.inf)
        for k, station in enumerate(stations):
            moves = self._traffic.tables.to(station.dock_state)[states].astype(np.float64)
            travel_s[:, k] = np.where(moves >= UNREACHABLE, np.inf, moves * STEP_S)
        np.fill_diagonal(travel_s, 0.0)
        service_s = np.array(
            [self._service_times.of(k, station.direction).mean_s for k, station in enumerate(stations)]
        )
        left_s = np.array([self._service_times.left_s(k, now_s) for k in range(n_stations)])
        place = np.array([[self._by_name[task.pick].arm, self._by_name[task.order.drop].arm] for task in tasks]).ravel()
        age_s = np.array([now_s - task.since_s[TaskState.BACKLOG] for task in tasks])
        eta_s = dict.fromkeys((station.name for station in stations), np.inf)
        for car, task in held.items():
            eta_s[task.pick] = min(eta_s[task.pick], float(travel_s[n_stations + int(np.searchsorted(cars, car)), self._by_name[task.pick].arm]) if car in cars else np.inf)
        release_s = np.array([
            0.0 if task.state is not TaskState.BACKLOG else eta_s[task.pick] if np.isfinite(eta_s[task.pick]) else SLOT_S
            for task in tasks
        ])
        row_of = {int(car): row for row, car in enumerate(cars)}
        at = {task.index: k for k, task in enumerate(tasks)}
        plan = [(at[index], row_of[car]) for index, car in self._plan if index in at and car in row_of]
        vehicle = np.full(len(tasks), -1, dtype=np.int32)
        for k, row in plan:
            vehicle[k] = row
        return Shop(
            travel_s=travel_s,
            start=np.arange(n_stations, n_places, dtype=np.int32),
            ready_s=costs.free_s[cars],
            first_stop=np.arange(0, 2 * len(tasks) + 1, 2, dtype=np.int32),
            place=place.astype(np.int32),
            station=place.astype(np.int32),
            service_s=service_s[place],
            free_s=left_s,
            buffer_n=np.array(self._bookings.caps[:n_stations], dtype=np.int32),
            release_s=release_s,
            due_s=np.array([task.order.due_s - now_s for task in tasks]),
            weight=1.0 + self._config.ageing * age_s / AGED_S,
            late_weight=np.full(len(tasks), self._config.lateness),
            late_cost=np.full(len(tasks), self._config.late_s),
            first_order=np.array([k for k, _ in plan], dtype=np.int32),
            first_vehicle=vehicle,
        )

    def _why_taken(self, costs: _Costs, column_of: npt.NDArray[np.int64], car: int, task: Task) -> str:
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
        self, costs: _Costs, asked_n: int, full: set[int], column_of: npt.NDArray[np.int64], later: Mapping[int, int]
    ) -> None:
        took = self._names(costs, column_of)
        free = _CODE[PairReason.LEFT_OVER]
        taker_of = np.full(len(costs.tasks), -1)
        cars = np.flatnonzero(column_of >= 0)
        taker_of[column_of[cars]] = cars
        for k, (task, taker) in enumerate(zip(costs.tasks[:asked_n], taker_of.tolist(), strict=False)):
            codes = costs.codes[:, k].copy()
            if k in full:
                codes[codes == free] = _CODE[PairReason.NOT_OFFERED]
            cost_s = costs.cost_s[:, k].copy()
            self._reasons.decide(task, Decision(time_s=costs.now_s, codes=codes, cost_s=cost_s, took=took, taker=taker))
            if k in later:
                text = f"car_{later[k]} is to take it, and will be free in {costs.free_s[later[k]]:.0f} s"
                self._reasons.note(task, TaskReason.PLANNED, text, costs.now_s)
            elif taker < 0:
                self._reasons.note(task, *self._why_open(task, codes, k in full), costs.now_s)

    def _names(self, costs: _Costs, column_of: npt.NDArray[np.int64]) -> list[str]:
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
        pick, drop = task.pick, task.order.drop
        unfit = {PairReason.TOO_HEAVY, PairReason.LACKS_CAPABILITY, PairReason.CAR_OUT}
        if reasons <= unfit:
            return TaskReason.NO_CAPABLE_CAR, "every car that could carry it is out of service"
        if reasons <= unfit | {PairReason.NO_WAY}:
            return TaskReason.UNREACHABLE, f"no car has a way to {pick} and on to {drop}"
        if full:
            return TaskReason.STATION_FULL, f"{pick} or {drop} has no room for one more car"
        if PairReason.LEFT_OVER in reasons:
            return TaskReason.LEFT_OVER, "the allocator left it and a free car over"
        return TaskReason.NO_FREE_CAR, "every car that could take it has another task"
