"""Dispatcher: connects tasks, cars and stations: who does what next, and when a station may begin."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from fleet.allotment import Allotment
from fleet.charging import Charging
from fleet.config import RunConfig
from fleet.errors import FleetError
from fleet.executor import Executor
from fleet.fetching import Fetching
from fleet.robots.battery import Batteries
from fleet.stations.arm_desk import ArmDesk
from fleet.stations.booking import Bookings
from fleet.stations.service import ServiceState
from fleet.stations.service_time import Direction, ServiceTimes
from fleet.stations.station import Station
from fleet.stations.transfer import TRAY, TransferRequest
from fleet.stock import Log, Stock
from fleet.tasks.board import CANCELLABLE, Task, TaskBoard, TaskState
from fleet.tasks.order import Ability, Priority
from fleet.tasks.reasons import PairReason, ReasonBook
from fleet.traffic import Traffic
from fleet.world.protocol import World
from maps.lane_graph import LaneGraph
from maps.site import Site

ALLOCATE_S = 1.0
"""Longest time between two allocations; every change of tasks or cars asks for one at once [s]."""
CALL_S = 0.25
"""Time between two looks at the cars that are held back [s]."""
MOVE_S = 1.1
"""Time of a move without traffic: a cell of 1 m at 1 m/s, and some turns [s]."""
EARLY_S = 4.0
"""A car should come to its station this long before the arm is free, so that traffic does not let the arm wait [s]."""
SLOW_SERVICE_S, USUAL_SERVICE_S = 12.0, 9.0
"""Cars that only pass go round a dock whose last transfers took longer than the first, until they take less than the
second; at 7 s, which is usual, going round all docks cost 2.5 % of the throughput [s]."""
LOADED_RANK_S = 30.0
"""Head start of a loaded car over an empty one in the right of way, as seconds of waiting."""
EMERGENCY_RANK_S = 60.0
"""Head start of a car with a task of the class `emergency` [s]."""
MAX_ATTEMPTS = 3
"""Transfers tried for one errand before its task fails."""


class CarPhase(StrEnum):
    """What a car is about."""

    IDLE = "idle"
    TO_PICK = "to_pick"
    LOADING = "loading"
    HELD = "held"
    """Waits where it is in nobody's way: its station has no room, or the arm will not be free when it comes."""
    TO_DROP = "to_drop"
    UNLOADING = "unloading"
    TO_CHARGER = "to_charger"
    CHARGING = "charging"
    RECOVERING = "recovering"
    RETIRED = "retired"
    """Drives, but takes no task: a parcel that could not be unloaded lies in its tray."""
    DEAD = "dead"


PHASES = tuple(CarPhase)
_AT_CHARGER = frozenset({CarPhase.TO_CHARGER, CarPhase.CHARGING})
_BOOKED = _AT_CHARGER | {CarPhase.TO_PICK, CarPhase.LOADING, CarPhase.HELD, CarPhase.TO_DROP, CarPhase.UNLOADING}
"""Phases of a car that has a booking or waits for one."""
_PARKED = frozenset({CarPhase.IDLE, CarPhase.RETIRED, CarPhase.HELD})
"""Phases of a car that waits in a parking place."""


_STANDING = (
    dict.fromkeys(CarPhase, PairReason.CAR_BUSY)
    | dict.fromkeys((CarPhase.IDLE, *_AT_CHARGER), PairReason.CAR_CHARGES)
    | dict.fromkeys((CarPhase.RECOVERING, CarPhase.RETIRED, CarPhase.DEAD), PairReason.CAR_OUT)
)
"""Why a car in a phase cannot take a task; one that is idle and cannot is about to charge."""


class CannotCancel(FleetError):
    """A task is asked back whose parcel the fleet already has, or that has ended."""


class CannotRequeue(FleetError):
    """A task is to be taken from a car that is not to pick it."""


class Dispatcher:
    """Missions of all cars.

    Args:
        site: Floor, stations, parking.
        graph: Its lane graph.
        config: Allocation, collection time.
        board: The tasks.
        stations: In the order of the arms.
        desk: Arm planning and playback.
        traffic: Takes goals.
        executor: Tells where cars are.
        world: Where parcels appear and vanish.
        abilities: What each car can carry.
        batteries: State of charge of the cars; None for cars that never need to charge.
        log: Called as ``log(kind, **facts)`` for every event.
    """

    def __init__(
        self,
        *,
        site: Site,
        graph: LaneGraph,
        config: RunConfig,
        board: TaskBoard,
        stations: list[Station],
        desk: ArmDesk,
        traffic: Traffic,
        executor: Executor,
        world: World,
        abilities: Sequence[Ability],
        batteries: Batteries | None,
        log: Log,
    ) -> None:
        self.board = board
        self.stations = stations
        self.phase = [CarPhase.IDLE] * world.n_cars
        self.phase_index = np.zeros(world.n_cars, dtype=np.int64)
        """The same as an index into `PHASES`, shape (n_cars,)."""
        self.served = np.full(len(stations), -1, dtype=np.int64)
        """The car each arm is at work on, or on its way home from, -1 for none, shape (n_stations,)."""
        self.awake = np.zeros(world.n_cars, dtype=np.bool_)
        """True for a car that is not parked, shape (n_cars,)."""
        self.charges = np.zeros(world.n_cars, dtype=np.bool_)
        """True for a car that stands at a charger and charges, shape (n_cars,)."""
        self.load_kg = np.zeros(world.n_cars)
        """Mass of the parcel in each car's tray [kg], shape (n_cars,)."""
        chargers = _states_of(site.chargers[: config.battery.chargers_n], graph) if batteries is not None else ()
        caps = [config.allocation.station_cap_n] * len(stations) + [1] * len(chargers)
        self.bookings = Bookings(caps, world.n_cars)
        self.task_of: list[Task | None] = [None] * world.n_cars
        self.loaded = np.zeros(world.n_cars, dtype=np.int64)
        """1 for a car with a parcel, else 0."""
        self.bound = np.zeros(world.n_cars, dtype=np.bool_)
        """True for a car on its way to a station."""
        self.service_times = ServiceTimes(len(stations))
        self.reasons = ReasonBook(log)
        self._graph = graph
        self._config = config
        self._desk = desk
        self._traffic = traffic
        self._executor = executor
        self._world = world
        self._log = log
        self._by_name = {station.name: station for station in stations}
        self.charging: Charging | None = None
        if batteries is not None:
            self.charging = Charging(batteries, chargers, len(stations), self.bookings, traffic, self.service_times)
        self._allotment = Allotment(
            config=config.allocation,
            board=board,
            stations=stations,
            bookings=self.bookings,
            service_times=self.service_times,
            abilities=abilities,
            charging=self.charging,
            traffic=traffic,
            executor=executor,
            reason_book=self.reasons,
        )
        self.stock = Stock(board, stations, desk.car, world, log, self.reasons, self._allotment.source_cost)
        self._fetching = Fetching(stations, desk, self.stock, traffic, executor, world.tick_s, log)
        self._attempts: dict[int, int] = {}
        self._serving: dict[int, int] = {}
        self._dock_cells = [self._dock_cell(station) for station in stations]
        self._dock_cells += [int(graph.state_cell[state]) for state in chargers]
        self._parking = _states_of(site.parking, graph)
        self._changed = True
        self._call_period = max(1, round(CALL_S / world.tick_s))
        self._period = max(1, round(ALLOCATE_S / world.tick_s))
        self._fastest_move_s = site.grid.cell_m / desk.car.max_speed_mps

    def tick(self, tick: int, now_s: float) -> None:
        """Release, collect, allocate, and start or end services."""
        for task in self.board.release_due(now_s):
            self._warn_of_due(task)
        self._changed |= self.stock.tick(now_s)
        self._changed |= self.bookings.clear(self._stands_at)
        if tick % self._call_period == 0:
            self._call(tick, now_s)
        if self._changed or tick % self._period == 0:
            self._changed = False
            self._take_back(now_s)
            self._time_out(now_s)
            if self.charging is not None:
                self._charge_low(self.charging, tick, now_s)
            self._allocate(tick, now_s)
            if self.charging is not None:
                self._charge_idle(self.charging, tick)
            self._park(tick)
        self._start_services(tick, now_s)
        self._end_services(tick, now_s)
        coming = [
            task if phase is CarPhase.TO_PICK else None for phase, task in zip(self.phase, self.task_of, strict=True)
        ]
        self._fetching.tick(tick, coming, self.served.tolist())

    def cancel(self, task: Task, now_s: float, reason: str) -> None:
        """Take a task back whose parcel was not picked yet; its car is free, and its parcel leaves the warehouse.

        Raises:
            CannotCancel: It is too late.
        """
        if task.state not in CANCELLABLE:
            valid = ", ".join(state for state in TaskState if state in CANCELLABLE)
            raise CannotCancel(f"task {task.order.name} is {task.state}; valid to cancel: {valid}")
        car = task.car if task.state is TaskState.ASSIGNED else None
        self.stock.withdraw(task, now_s, reason)
        if car is not None:
            self._stand_down(car)

    def requeue(self, task: Task, now_s: float, reason: str) -> None:
        """Take a task away from the car that is to pick it; another car gets it, if there is one.

        Raises:
            CannotRequeue: No car is under way to pick it.
        """
        if task.state is not TaskState.ASSIGNED or task.car is None:
            raise CannotRequeue(f"task {task.order.name} is {task.state}; valid to requeue: {TaskState.ASSIGNED}")
        car = task.car
        task.shunned.add(car)
        self._unassign(task, now_s, reason)
        self._stand_down(car)

    def retire(self, car: int, phase: CarPhase, now_s: float, reason: str) -> None:
        """Take a car out of service; a task whose parcel it has not got yet goes back to the pool.

        An arm that is at work on the car goes on: what becomes of the task is judged when it is clear.
        """
        task = self.task_of[car]
        self._enter(car, phase)
        if task is None:
            return
        if task.state is TaskState.ASSIGNED:
            self._unassign(task, now_s, reason)
        elif task.state is TaskState.CARRIED and phase is CarPhase.DEAD:
            self._strand(task, car, now_s, reason)

    def is_served(self, car: int) -> bool:
        """True while an arm is at work on a car, or still on its way home from it."""
        return car in self._serving.values()

    def resume(self, car: int, tick: int, now_s: float) -> None:
        """Bring a recovered car back into service with what it was doing."""
        task = self.task_of[car]
        if task is not None and task.state is TaskState.CARRIED:
            self._set_off(car, task, tick, now_s)
        else:
            self._enter(car, CarPhase.RETIRED if self.stock.tray_is_loaded(car) else CarPhase.IDLE)
        self._changed = True

    def _enter(self, car: int, phase: CarPhase) -> None:
        self.phase[car] = phase
        self.phase_index[car] = PHASES.index(phase)
        task = self.task_of[car]
        waits = phase in _AT_CHARGER or phase is CarPhase.HELD
        carries = waits and task is not None and task.state is TaskState.CARRIED
        self.loaded[car] = carries or phase in (CarPhase.TO_DROP, CarPhase.UNLOADING)
        self.load_kg[car] = task.order.mass_kg if self.loaded[car] and task is not None else 0.0
        self.awake[car] = phase not in _PARKED and phase is not CarPhase.DEAD
        self.charges[car] = phase is CarPhase.CHARGING
        self.bound[car] = phase in (CarPhase.TO_PICK, CarPhase.TO_DROP, CarPhase.TO_CHARGER)
        if phase not in _BOOKED:
            self._leave(car)

    def _stands_at(self, car: int, place: int) -> bool:
        """Whether a car still holds the dock of a station."""
        return self._dock_cells[place] in self._executor.dependencies.held_cells(car)

    def _leave(self, car: int) -> None:
        place = int(self.bookings.place_of[car])
        self.bookings.leave(car, stands_there=place >= 0 and self._stands_at(car, place))

    def _set_off(self, car: int, task: Task, tick: int, now_s: float) -> None:
        """Send a loaded car to its drop station, or hold it back while there is no room."""
        station = self._by_name[task.order.drop]
        self._leave(car)
        if not self.bookings.waiting(station.arm) and self.bookings.book(car, station.arm):
            self._approach(car, task, tick, now_s)
            return
        self.bookings.wait(car, station.arm)
        there = ", ".join(f"car_{other}" for other in self.bookings.cars(station.arm))
        self._hold(car, task, f"{station.name} is full ({there})")

    def _approach(self, car: int, task: Task, tick: int, now_s: float) -> None:
        """Send a car with a booking on its way, unless it would only stand in the lanes before a busy arm."""
        picks = task.state is not TaskState.CARRIED
        station = self._by_name[task.pick if picks else task.order.drop]
        early_s = self._free_s(car, station, now_s) - self._way_s(car, station)
        if early_s <= EARLY_S:
            if self.phase[car] is CarPhase.HELD:
                self._log("called", car=f"car_{car}", task=task.order.name, station=station.name)
            self._enter(car, CarPhase.TO_PICK if picks else CarPhase.TO_DROP)
            self._send_to(car, station, tick)
        elif self.phase[car] is not CarPhase.HELD:
            self._hold(car, task, f"{station.name} is busy and it would come {early_s:.0f} s too early")

    def _hold(self, car: int, task: Task, why: str) -> None:
        """Let a car wait in a parking place."""
        self._enter(car, CarPhase.HELD)
        self._changed = True
        task.reason = f"car_{car} is held: {why}"
        self._log("held", car=f"car_{car}", task=task.order.name, cause=why)

    def _is_free(self, car: int) -> bool:
        """Whether a car may be given a task."""
        phase, charging = self.phase[car], self.charging
        if charging is None or phase not in _AT_CHARGER:
            return phase is CarPhase.IDLE and (charging is None or not charging.is_critical(car))
        return self.task_of[car] is None and charging.has_enough(car)

    def _charge_low(self, charging: Charging, tick: int, now_s: float) -> None:
        """Send cars with low batteries to chargers, emptiest first, and those that have enough away from them."""
        for car, phase in enumerate(self.phase):
            task = self.task_of[car]
            going = phase in (CarPhase.TO_PICK, CarPhase.HELD)
            if going and task is not None and task.state is TaskState.ASSIGNED and charging.is_critical(car):
                self._unassign(task, now_s, f"the battery of car_{car} is at {charging.batteries.charge[car]:.0%}")
                self._release_car(car)
        low = [car for car in range(len(self.phase)) if charging.is_low(car) and self._may_charge(car)]
        for car in charging.by_need(low):
            if not self._charge(charging, car, tick):
                break
        else:
            low = []
        for car, phase in enumerate(self.phase):
            if phase is not CarPhase.CHARGING or not (charging.is_full(car) or (low and charging.has_enough(car))):
                continue
            task = self.task_of[car]
            self._log("charged", car=f"car_{car}", charge=round(float(charging.batteries.charge[car]), 3))
            if task is not None:
                self._set_off(car, task, tick, now_s)
            else:
                self._enter(car, CarPhase.IDLE)

    def _charge_idle(self, charging: Charging, tick: int) -> None:
        """Let parked cars that nobody needs at present charge where there is room."""
        idle = [
            car
            for car, phase in enumerate(self.phase)
            if phase is CarPhase.IDLE
            and charging.batteries.charge[car] < charging.batteries.config.idle_below
            and self._executor.idle(car)
        ]
        for car in charging.by_need(idle):
            if not self._charge(charging, car, tick):
                break

    def _may_charge(self, car: int) -> bool:
        """Whether a car is free to go to a charger: without a task, or held back with its parcel."""
        task = self.task_of[car]
        held = self.phase[car] is CarPhase.HELD and task is not None and task.state is TaskState.CARRIED
        return held or self.phase[car] is CarPhase.IDLE

    def _charge(self, charging: Charging, car: int, tick: int) -> bool:
        """Send a car to a charger; False if none is free."""
        place = charging.free_charger(int(self._executor.tail_states()[car]))
        if place is None:
            return False
        self._leave(car)
        self.bookings.book(car, place)
        self._enter(car, CarPhase.TO_CHARGER)
        self._traffic.rank[car] = LOADED_RANK_S
        self._traffic.send(car, charging.state_of(place), stay=True, tick=tick)
        self._log("to_charger", car=f"car_{car}", charge=round(float(charging.batteries.charge[car]), 3))
        return True

    def _plug_in(self, charging: Charging) -> None:
        """Begin to charge cars that have come to their charger, and free those that have no way to theirs."""
        tails = self._executor.tail_states()
        for car, phase in enumerate(self.phase):
            if phase is not CarPhase.TO_CHARGER:
                continue
            goal = charging.state_of(int(self.bookings.place_of[car]))
            if tails[car] == goal and self._executor.idle(car):
                self._enter(car, CarPhase.CHARGING)
                charging.sessions_n += 1
            elif not self._traffic.reachable(int(tails[car]), goal):
                self._changed = True
                task = self.task_of[car]
                self._enter(car, CarPhase.IDLE)
                if task is not None:
                    self.bookings.wait(car, self._by_name[task.order.drop].arm)
                    self._hold(car, task, "no way to its charger")

    def _call(self, tick: int, now_s: float) -> None:
        """Let cars that are held back go on when their time has come."""
        if self.charging is not None:
            self._plug_in(self.charging)
        for car, place in self.bookings.callable_cars():
            self.bookings.book(car, place)
        for car, phase in enumerate(self.phase):
            task = self.task_of[car]
            if phase is CarPhase.HELD and task is not None and self.bookings.has(car):
                self._approach(car, task, tick, now_s)

    def _way_s(self, car: int, station: Station) -> float:
        """Time a car needs to a station without traffic [s]."""
        tail = int(self._executor.dependencies.tail_states()[car])
        return MOVE_S * int(self._traffic.tables.to(station.dock_state)[tail])

    def _free_s(self, car: int, station: Station, now_s: float) -> float:
        """Time until the arm has done with everybody who comes before a car [s]."""
        arm = station.arm
        service_s = self.service_times.of(arm, station.direction).recent_s
        free_s = self.service_times.left_s(arm, now_s)
        own_s = self._way_s(car, station)
        for other in self.bookings.cars(arm):
            comes_s = 0.0 if other in (car, self.served[arm]) else self._way_s(other, station)
            if other not in (car, self.served[arm]) and comes_s <= own_s and self.bookings.place_of[other] == arm:
                free_s = max(free_s, comes_s) + service_s
        return free_s

    def _warn_of_due(self, task: Task) -> None:
        """Say at once when not even a car that stands at the pick dock could bring a task in time."""
        least_s = self._allotment.least_s(task, self._fastest_move_s)
        if task.order.release_s + least_s > task.order.due_s:
            left_s = task.order.due_s - task.order.release_s
            text = f"it is due {left_s:.1f} s after its release, and takes {least_s:.1f} s from {task.pick}"
            self.reasons.warn(task, text)

    def _allocate(self, tick: int, now_s: float) -> None:
        """Give tasks to cars that are free, and exchange those that are not picked yet where much is gained."""
        tails = self._executor.tail_states()
        held: dict[int, Task] = {}
        standing: list[PairReason | None] = []
        for car, phase in enumerate(self.phase):
            task = self.task_of[car]
            # A car whose way ends in the dock is about to be served.
            before_pick = phase in (CarPhase.TO_PICK, CarPhase.HELD) and tails[car] != self._goal_of(task)
            if task is not None and before_pick and task.state is TaskState.ASSIGNED:
                held[car] = task
            standing.append(None if car in held or self._is_free(car) else _STANDING[phase])
        choice = self._allotment.choose(standing, held, now_s)
        for car, reason in choice.taken:
            self._unassign(held[car], now_s, reason)
            self._stand_down(car)
        for car, task in choice.given:
            self._assign(car, task, tick, now_s)

    def _goal_of(self, task: Task | None) -> int:
        """State of the dock where a task is picked, -1 for no task."""
        return self._by_name[task.pick].dock_state if task is not None else -1

    def _stand_down(self, car: int) -> None:
        """Free a car that was to pick a task."""
        self.task_of[car] = None
        self._traffic.rank[car] = 0.0
        self._changed = True
        if self.phase[car] in (CarPhase.TO_PICK, CarPhase.HELD):
            self._enter(car, CarPhase.IDLE)

    def _time_out(self, now_s: float) -> None:
        """End what has lasted too long."""
        limits = self._config.timeouts
        for task in self.board.in_state(TaskState.BACKLOG, TaskState.READY):
            if now_s - task.since_s[TaskState.BACKLOG] > limits.waiting_s:
                self.cancel(task, now_s, f"no car had it {limits.waiting_s:g} s after its release")
        for task in self.board.in_state(TaskState.ASSIGNED):
            if now_s - task.since_s[TaskState.ASSIGNED] > limits.assigned_s:
                self.requeue(task, now_s, f"car_{task.car} was not at {task.pick} after {limits.assigned_s:g} s")
        for task in self.board.in_state(TaskState.LOADING, TaskState.UNLOADING):
            if now_s - task.since_s[task.state] > limits.service_s:
                self.board.move(task, TaskState.FAILED, now_s, f"was {task.state} for {limits.service_s:g} s")
        for task in self.board.in_state(TaskState.CARRIED):
            if now_s - task.since_s[TaskState.CARRIED] > limits.carried_s and task.car is not None:
                self._fail(task, now_s, f"car_{task.car} was not at {task.order.drop} after {limits.carried_s:g} s")
                self._release_car(task.car, CarPhase.RETIRED)

    def _assign(self, car: int, task: Task, tick: int, now_s: float) -> None:
        self._leave(car)
        if not self.bookings.book(car, self._by_name[task.pick].arm):
            return
        task.car = car
        self.task_of[car] = task
        self.board.move(task, TaskState.ASSIGNED, now_s, f"car_{car} was the allocator's choice")
        self.reasons.assigned(task)
        self._approach(car, task, tick, now_s)

    def _unassign(self, task: Task, now_s: float, reason: str) -> None:
        if task.car is not None:
            self.task_of[task.car] = None
        task.car = None
        self.board.move(task, TaskState.READY, now_s, reason)
        self._changed = True

    def _take_back(self, now_s: float) -> None:
        """Free cars of tasks that they have no way to go on with."""
        if not self._traffic.blocked.any():
            return
        tails = self._executor.tail_states()
        for car, phase in enumerate(self.phase):
            task = self.task_of[car]
            if task is None or phase not in (CarPhase.TO_PICK, CarPhase.TO_DROP, CarPhase.HELD):
                continue
            picks = task.state is not TaskState.CARRIED
            name = task.pick if picks else task.order.drop
            if self._traffic.reachable(int(tails[car]), self._by_name[name].dock_state):
                continue
            if picks:
                self._unassign(task, now_s, f"car_{car} has no way to {name}")
                self._release_car(car)
            elif self._traffic.blocked_for_good:
                self._fail(task, now_s, f"car_{car} has no way to {name}; its parcel stays in the tray")
                self._release_car(car, CarPhase.RETIRED)

    def _send_to(self, car: int, station: Station, tick: int) -> None:
        task = self.task_of[car]
        urgent = task is not None and task.order.priority is Priority.EMERGENCY
        loaded = self.phase[car] is CarPhase.TO_DROP
        self._traffic.rank[car] = LOADED_RANK_S * loaded + EMERGENCY_RANK_S * urgent
        self._traffic.send(car, station.dock_state, stay=True, tick=tick)

    def _park(self, tick: int) -> None:
        """Send every car that waits to the nearest parking place that no other such car has."""
        idle = [car for car, phase in enumerate(self.phase) if phase in _PARKED]
        taken = {int(self._traffic.goals[car]) for car in idle}
        tails = self._executor.tail_states()
        for car in idle:
            if int(self._traffic.goals[car]) in self._parking:
                continue
            free = [state for state in self._parking if state not in taken]
            if not free:
                continue
            goal = min(free, key=lambda state: (int(self._traffic.tables.to(state)[tails[car]]), state))
            taken.add(goal)
            self._traffic.rank[car] = 0.0
            self._traffic.send(car, goal, stay=False, tick=tick)

    def _start_services(self, tick: int, now_s: float) -> None:
        tails = self._executor.tail_states()
        for car, phase in enumerate(self.phase):
            if phase not in (CarPhase.TO_PICK, CarPhase.TO_DROP):
                continue
            task = self.task_of[car]
            if task is None:
                continue
            loading = phase is CarPhase.TO_PICK
            station = self._by_name[task.pick if loading else task.order.drop]
            if tails[car] != station.dock_state or not self._executor.idle(car):
                continue
            if not self._desk.is_ready(station.arm, task.parcel):
                continue
            if not loading and task.drop_slot is None:
                task.drop_slot = station.take_slot(task.index)
                if task.drop_slot is None:
                    continue
            self._enter(car, CarPhase.LOADING if loading else CarPhase.UNLOADING)
            state = TaskState.LOADING if loading else TaskState.UNLOADING
            self.board.move(task, state, now_s, f"car_{car} stands at {station.name}")
            self._traffic.set_fixed(car, True)
            self._executor.close(self._dock_cell(station))
            self._serving[station.arm] = car
            self.served[station.arm] = car
            self._world.set_serving(station.arm, car)
            self.service_times.begin(station.arm, Direction.TO_CAR if loading else Direction.FROM_CAR, now_s)
            self._request(station, task, car, tick)

    def _request(self, station: Station, task: Task, car: int, tick: int) -> None:
        loading = task.state is TaskState.LOADING
        slot = task.pick_slot if loading else task.drop_slot
        if slot is None:
            raise AssertionError("a task in service has a slot")
        self._attempts[task.index] = self._attempts.get(task.index, 0) + 1
        self._desk.submit(
            TransferRequest(
                arm=station.arm,
                parcel=task.parcel,
                size_m=task.order.size_m,
                pick_pose=self.stock.pose(task),
                pick_via=slot if loading else TRAY,
                place_via=TRAY if loading else slot,
                car_pose=self._executor.driver.estimate[car].copy(),
            ),
            tick,
        )

    def _end_services(self, tick: int, now_s: float) -> None:
        for arm, car in list(self._serving.items()):
            station = self.stations[arm]
            service = self._desk.services[arm]
            task = self.task_of[car]
            if task is not None and task.state is TaskState.FAILED and self._desk.is_idle(arm):
                self._give_up_service(station, task, car)
            if task is not None and service.dock_is_clear and task.state in (TaskState.LOADING, TaskState.UNLOADING):
                self._judge(station, task, car, service.state, tick, now_s)
            if self._desk.is_idle(arm) and self.phase[car] not in (CarPhase.LOADING, CarPhase.UNLOADING):
                del self._serving[arm]
                self.served[arm] = -1
                self._world.set_serving(arm, -1)
                self.service_times.end(arm, now_s)
                self._keep_clear(station)
                self._executor.open(self._dock_cell(station))

    def _give_up_service(self, station: Station, task: Task, car: int) -> None:
        """A task failed while an arm was at work on it, and the arm is clear now."""
        loading = station.direction is Direction.TO_CAR
        slot = task.pick_slot if loading else task.drop_slot
        if slot is not None and not self.stock.on_slot(task, slot, station):
            station.free_slot(slot)
        self._release_car(car, CarPhase.RETIRED if self.stock.in_tray(task, car) else CarPhase.IDLE)

    def _keep_clear(self, station: Station) -> None:
        """Lead those who only pass round the dock of an arm that has become slow; round others it is not worth it."""
        recent_s = self.service_times.of(station.arm, station.direction).recent_s
        if recent_s > SLOW_SERVICE_S:
            self._traffic.set_avoided(self._dock_cells[station.arm], True)
        elif recent_s < USUAL_SERVICE_S:
            self._traffic.set_avoided(self._dock_cells[station.arm], False)

    def _judge(self, station: Station, task: Task, car: int, state: ServiceState, tick: int, now_s: float) -> None:
        """Look where the parcel really is, now that the arm is clear of the car, and draw the consequence."""
        loading = task.state is TaskState.LOADING
        slot = task.pick_slot if loading else task.drop_slot
        on_slot, in_tray = self.stock.on_slot(task, slot, station), self.stock.in_tray(task, car)
        if state in (ServiceState.DONE, ServiceState.MOVING, ServiceState.IDLE) and (in_tray if loading else on_slot):
            self.service_times.complete(station.arm)
            if loading:
                self._loaded(station, task, car, tick, now_s)
            else:
                self._delivered(station, task, car, tick, now_s)
            return
        if not self._desk.is_idle(station.arm):
            return
        at_source = on_slot if loading else in_tray
        if at_source and self.phase[car] is CarPhase.RECOVERING:
            # The car was pushed from under the arm: it comes back to the dock, or another does.
            if loading:
                self._unassign(task, now_s, f"car_{car} left its lane")
            else:
                self.board.move(task, TaskState.CARRIED, now_s, f"car_{car} left its lane")
            return
        if at_source and self._attempts[task.index] < MAX_ATTEMPTS:
            self._log(
                "transfer_repeated",
                task=task.order.name,
                station=station.name,
                cause=self._desk.reason(station.arm),
            )
            self._request(station, task, car, tick)
            return
        x, y, z = (round(float(v), 3) for v in self.stock.pose(task)[:3])
        cause = self._desk.reason(station.arm) or "the parcel is not where it was set down"
        reason = f"{cause} at {station.name}; parcel lies at ({x}, {y}, {z})"
        self.board.move(task, TaskState.FAILED, now_s, reason)
        if slot is not None and not on_slot:
            station.free_slot(slot)
        self._release_car(car, CarPhase.RETIRED if in_tray else CarPhase.IDLE)

    def _loaded(self, station: Station, task: Task, car: int, tick: int, now_s: float) -> None:
        if task.pick_slot is not None:
            station.free_slot(task.pick_slot)
        self._attempts[task.index] = 0
        self.board.move(task, TaskState.CARRIED, now_s, f"measured in the tray of car_{car}")
        self._changed = True
        if self.phase[car] is CarPhase.DEAD:
            self._strand(task, car, now_s, f"car_{car} is dead")
        elif self.phase[car] is not CarPhase.RECOVERING:
            self._traffic.set_fixed(car, False)
            self._set_off(car, task, tick, now_s)

    def _delivered(self, station: Station, task: Task, car: int, tick: int, now_s: float) -> None:
        self.board.move(task, TaskState.DELIVERED, now_s, f"measured on slot {task.drop_slot} of {station.name}")
        if task.drop_slot is not None:
            station.collect_at(now_s + self._config.collect_after_s, task.drop_slot)
        self._release_car(car)

    def _release_car(self, car: int, phase: CarPhase = CarPhase.IDLE) -> None:
        self.task_of[car] = None
        self._traffic.rank[car] = 0.0
        self._changed = True
        if self.phase[car] not in (CarPhase.DEAD, CarPhase.RECOVERING):
            self._enter(car, phase)
            self._traffic.set_fixed(car, False)

    def _strand(self, task: Task, car: int, now_s: float, reason: str) -> None:
        """Give up a task whose parcel rides in a car that will not move again."""
        self._fail(task, now_s, f"parcel stranded: {reason}")
        self.task_of[car] = None
        self._traffic.rank[car] = 0.0

    def _fail(self, task: Task, now_s: float, reason: str) -> None:
        """Give up a task whose parcel is in a car, and the slot that waits for it."""
        self.board.move(task, TaskState.FAILED, now_s, reason)
        if task.drop_slot is not None:
            self._by_name[task.order.drop].free_slot(task.drop_slot)

    def _dock_cell(self, station: Station) -> int:
        return int(self._graph.state_cell[station.dock_state])


def _states_of(bays: tuple[int, ...], graph: LaneGraph) -> tuple[int, ...]:
    """The one state of each bay."""
    return tuple(int(graph.states_of_cell(cell)[0]) for cell in bays)
