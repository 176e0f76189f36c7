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
from fleet.places import Places
from fleet.stations.booking import Bookings
from fleet.stations.service_time import Direction, ServiceTimes
from fleet.stations.station import Station
from fleet.tasks.board import UNDER_WAY, Task, TaskBoard, TaskState
from fleet.tasks.order import Ability
from fleet.tasks.reasons import PAIR_REASONS, Decision, PairReason, ReasonBook, TaskReason
from fleet.traffic import Traffic
from fleet.visit_ways import VisitWays
from planners.allocation import AllocatorError, allocator_named
from planners.allocation.problem import NO_TASK, AllocationProblem
from planners.allocation.reasons import Reason, reasons
from planners.allocation.shop import NO_STATION, Shop
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
FULL_S = 300.0
"""To charge a car that is full costs so much more than to charge an empty one, as seconds of travel [s]."""
STEP_S = 1.0
"""Time of one move in traffic [s]: cells are 1 m, and cars in traffic average 1 m/s."""
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
        places: Where visits go.
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
        places: Places,
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
        self._ways = VisitWays(places, bookings)
        self._traffic = traffic
        self._executor = executor
        self._reasons = reason_book
        self._allocator = allocator_named(config.allocator)
        self._plans_ahead = bool(getattr(self._allocator, "plans_ahead", False))
        self._unfit: dict[int, npt.NDArray[np.int8]] = {}

    def choose(
        self,
        standing: Sequence[PairReason | None],
        held: Mapping[int, Task],
        kept: Mapping[int, Task],
        now_s: float,
    ) -> Choice:
        """Pairs of a car and a task, at most one for each.

        Args:
            standing: Why each car cannot take a task now, shape (n_cars,); None = it can.
            held: Tasks that cars have but may still give away, by car; these cars can take another.
            kept: Tasks that no other car may have, by car; these cars can take no other.
            now_s: Simulated time [s].
        """
        ready = self._board.in_state(TaskState.READY)
        if not ready and len(held) < 2:
            return Choice(taken=[], given=[])
        costs = self._costs([*ready, *held.values()], standing, kept, now_s)
        offered, full = self._offered(costs, len(ready))
        column_of = self._allocate(costs, [*offered, *range(len(ready), len(costs.tasks))], held)
        self._keep_reasons(costs, full, column_of)
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
        return nearest + self._moves(pick, task.delivery.drop)

    def least_s(self, task: Task, move_s: float) -> float:
        """The least time from the best pick station to the delivery, or from the first place of a visit to its end [s].

        It is inf if there is no way.

        Args:
            task: The task.
            move_s: Time of one move at full speed [s].
        """
        if task.visit is not None:
            rest_n, stand_s = self._ways.rest(task)
            return rest_n * move_s + stand_s if rest_n < UNREACHABLE else np.inf
        order = task.delivery
        moves = min(self._moves(pick, order.drop) for pick in order.picks)
        return moves * move_s + self._service_s(task.pick, order.drop) if moves < UNREACHABLE else np.inf

    def _moves(self, pick: str, drop: str) -> int:
        return int(self._traffic.tables.to(self._by_name[drop].dock_state)[self._by_name[pick].dock_state])

    def _service_s(self, pick: str, drop: str) -> float:
        """Time at both docks [s]."""
        load = self._service_times.of(self._by_name[pick].arm, Direction.TO_CAR)
        unload = self._service_times.of(self._by_name[drop].arm, Direction.FROM_CAR)
        return load.mean_s + unload.mean_s

    def _costs(
        self, tasks: list[Task], standing: Sequence[PairReason | None], kept: Mapping[int, Task], now_s: float
    ) -> _Costs:
        config = self._config
        tails = self._executor.tail_states()
        out = np.array([_CODE[reason] if reason is not None else _CODE[PairReason.LEFT_OVER] for reason in standing])
        cost = np.empty((len(tails), len(tasks)))
        codes = np.empty(cost.shape, dtype=np.int8)
        pressure = []
        # Many tasks share few ways.
        to_pick = {
            pick: self._traffic.tables.to(self._by_name[pick].dock_state)[tails].astype(np.float64)
            for pick in dict.fromkeys(task.pick for task in tasks if task.visit is None)
        }
        ways = {
            way: (self._moves(*way), self._service_s(*way))
            for way in dict.fromkeys((task.pick, task.delivery.drop) for task in tasks if task.visit is None)
        }
        for k, task in enumerate(tasks):
            if task.visit is not None:
                moves = self._ways.to_stop(task, tails)
                rest_n, service_s = self._ways.rest(task)
            else:
                moves = to_pick[task.pick]
                rest_n, service_s = ways[task.pick, task.delivery.drop]
            codes[:, k] = self._refusals(task, out, (moves >= UNREACHABLE) | (rest_n >= UNREACHABLE))
            self._refuse_kept(codes[:, k], task, kept)
            if self._charging is not None:
                self._refuse_low(self._charging, codes[:, k], task, moves)
            to_pick_s = moves * STEP_S
            eta_s = now_s + to_pick_s + rest_n * STEP_S + service_s
            late_s = np.maximum(0.0, eta_s - task.order.due_s)
            best_s = float(eta_s.min())
            late_next_turn_s = max(0.0, best_s + (best_s - now_s) - task.order.due_s)
            age_s = now_s - task.since_s[TaskState.BACKLOG]
            pressure.append(config.ageing * age_s + config.lateness * late_next_turn_s)
            cost[:, k] = to_pick_s + config.lateness * late_s - pressure[-1]
            if task.visit is not None and task.visit.until_full and self._charging is not None:
                cost[:, k] += FULL_S * self._charging.batteries.charge
        cost[codes != _CODE[PairReason.LEFT_OVER]] = np.inf
        return _Costs(now_s=now_s, tasks=tasks, cost_s=cost, codes=codes, pressure_s=pressure)

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
                    free if a.fits(order) else heavy if order.payload_kg > a.max_payload_kg else lacks
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

    def _refuse_kept(self, codes: npt.NDArray[np.int8], task: Task, kept: Mapping[int, Task]) -> None:
        """Refuse the cars, of those that could take a task, that are kept for another, or that it is not kept for."""
        mine = next((car for car, leg in kept.items() if leg is task), None)
        for car in np.flatnonzero(codes == _CODE[PairReason.LEFT_OVER]).tolist() if kept else ():
            if mine is not None and car != mine:
                codes[car] = _CODE[PairReason.OTHER_CAR]
            elif car in kept and kept[car] is not task:
                codes[car] = _CODE[PairReason.KEPT_FOR_LEG]

    def _refuse_low(
        self, charging: Charging, codes: npt.NDArray[np.int8], task: Task, moves: npt.NDArray[np.float64]
    ) -> None:
        """Refuse the cars, of those that could take a task, that have too little charge for it."""
        cars = np.flatnonzero(codes == _CODE[PairReason.LEFT_OVER])
        if task.visit is None:
            order = task.delivery
            stations = self._by_name[task.pick], self._by_name[order.drop]
            allowed = charging.allows(cars.tolist(), moves[cars], *stations, order.mass_kg)
        elif task.visit.until_full:
            return
        else:
            stops = self._ways.stops(task)
            rest_n, stand_s = self._ways.rest(task)
            home_n = float(charging.moves_home(np.array(stops[-1][0].states[:1]))[0])
            allowed = charging.allows_way(cars.tolist(), moves[cars] + rest_n + home_n, stand_s)
        codes[cars[~allowed]] = _CODE[PairReason.LOW_CHARGE]

    def _offered(self, costs: _Costs, n_ready: int) -> tuple[list[int], set[int]]:
        """Ready tasks that a car can take and that there is room for, the most urgent first; those without room."""
        pick_room, drop_room = {}, {}
        for name, station in self._by_name.items():
            pick_room[name] = self._bookings.room(station.arm)
            # A drop station may have one more under way: it is held back if it arrives too early.
            drop_room[name] = self._bookings.caps[station.arm] + 1
        for task in self._board.in_state(*UNDER_WAY):
            if task.visit is None:
                drop_room[task.delivery.drop] -= 1
        place_room: dict[int, int] = {}
        offered, full = [], set()
        order = sorted(
            range(n_ready),
            key=lambda k: (costs.tasks[k].order.priority.rank, -costs.pressure_s[k], costs.tasks[k].index),
        )
        for k in order:
            if costs.tasks[k].visit is not None:
                possible = bool(np.isfinite(costs.cost_s[:, k]).any())
                if possible and self._ways.take_room(costs.tasks[k], place_room):
                    offered.append(k)
                elif possible:
                    full.add(k)
                continue
            pick, drop = costs.tasks[k].pick, costs.tasks[k].delivery.drop
            if pick_room[pick] <= 0 or drop_room[drop] <= 0:
                full.add(k)
            elif np.isfinite(costs.cost_s[:, k]).any():
                pick_room[pick] -= 1
                drop_room[drop] -= 1
                offered.append(k)
        return offered, full

    def _allocate(self, costs: _Costs, columns: list[int], held: Mapping[int, Task]) -> npt.NDArray[np.int64]:
        """The column of the task that each car has then, -1 for none, shape (n_cars,); fills the codes of `costs`."""
        column_of = np.full(len(costs.cost_s), -1, dtype=np.int64)
        cars = np.flatnonzero(np.isfinite(costs.cost_s[:, columns]).any(axis=1))
        if not columns or not len(cars):
            return column_of
        at = {costs.tasks[column].index: k for k, column in enumerate(columns)}
        tasks = [costs.tasks[column] for column in columns]
        problem = AllocationProblem(
            cost=costs.cost_s[np.ix_(cars, np.array(columns))],
            class_of=np.array([task.order.priority.rank for task in tasks], dtype=np.int32),
            since_s=np.array([task.since_s[TaskState.BACKLOG] for task in tasks]),
            held=np.array([at[held[car].index] if car in held else NO_TASK for car in cars.tolist()], dtype=np.int32),
            keep_gain=self._config.keep_gain_s,
            keep_share=self._config.keep_share,
            shop=self._shop(cars, tasks, held, costs.now_s) if self._plans_ahead else None,
        )
        assignment = self._allocator.allocate(problem)
        for row, k in assignment.pairs.tolist():
            column_of[cars[row]] = columns[k]
        pairs = np.ix_(cars, np.array(columns))
        told = _CODE_OF[reasons(problem, assignment)]
        costs.codes[pairs] = np.where(np.isfinite(problem.cost), told, costs.codes[pairs])
        return column_of

    def _shop(self, cars: npt.NDArray[np.int64], tasks: list[Task], held: Mapping[int, Task], now_s: float) -> Shop:
        """The same cars and tasks with the arms they book; the clock starts now."""
        stations = list(self._by_name.values())
        visited = list(
            dict.fromkeys(stop for task in tasks if task.visit is not None for stop in self._ways.stops(task))
        )
        n_stations, n_known = len(stations), len(stations) + len(cars)
        n_places = n_known + len(visited)
        # Stations in their order, then where each car is, then what is visited; nobody drives to where a car was.
        docks, stops = [station.dock_state for station in stations], [stop[0].states[0] for stop in visited]
        states = np.concatenate((docks, self._executor.tail_states()[cars], stops)).astype(np.int32)
        travel_s = np.full((n_places, n_places), np.inf)
        for k, station in enumerate(stations):
            moves = self._traffic.tables.to(station.dock_state)[states].astype(np.float64)
            travel_s[:, k] = np.where(moves >= UNREACHABLE, np.inf, moves * STEP_S)
        for k, stop in enumerate(visited, start=n_known):
            moves = self._ways.moves_from(stop, states)
            travel_s[:, k] = np.where(moves >= UNREACHABLE, np.inf, moves * STEP_S)
        np.fill_diagonal(travel_s, 0.0)
        service_s = np.array(
            [self._service_times.of(k, station.direction).mean_s for k, station in enumerate(stations)]
        )
        # Cars that are not planned come before those that are.
        others_n = [len([car for car in self._bookings.cars(k) if car not in held]) for k in range(n_stations)]
        left_s = np.array([self._service_times.left_s(k, now_s) for k in range(n_stations)])
        number_of = {stop: k for k, stop in enumerate(visited, start=n_known)}
        jobs = [
            [self._by_name[name].arm for name in (task.pick, task.delivery.drop)]
            if task.visit is None
            else [number_of[stop] for stop in self._ways.stops(task)]
            for task in tasks
        ]
        place = np.concatenate(jobs).astype(np.int32)
        served = np.concatenate([np.full(len(job), task.visit is None) for task, job in zip(tasks, jobs, strict=True)])
        stand_s = np.concatenate(
            [np.full(len(job), self._ways.stand_s(task)) for task, job in zip(tasks, jobs, strict=True)]
        )
        age_s = np.array([now_s - task.since_s[TaskState.BACKLOG] for task in tasks])
        return Shop(
            travel_s=travel_s,
            start=np.arange(n_stations, n_known, dtype=np.int32),
            ready_s=np.zeros(len(cars)),
            first_stop=np.cumsum([0, *map(len, jobs)], dtype=np.int32),
            place=place,
            station=np.where(served, place, NO_STATION).astype(np.int32),
            service_s=np.where(served, service_s[np.where(served, place, 0)], stand_s),
            free_s=left_s + service_s * np.array(others_n),
            buffer_n=np.array(self._bookings.caps[:n_stations], dtype=np.int32),
            due_s=np.array([task.order.due_s - now_s for task in tasks]),
            weight=1.0 + self._config.ageing * age_s / AGED_S,
            late_weight=np.full(len(tasks), self._config.lateness),
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

    def _keep_reasons(self, costs: _Costs, full: set[int], column_of: npt.NDArray[np.int64]) -> None:
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
            self._reasons.decide(task, Decision(time_s=costs.now_s, codes=codes, cost_s=cost_s, took=took, taker=taker))
            if taker < 0:
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
