"""Dispatcher: connects tasks, cars and stations: who does what next, and when a station may begin."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from fleet.allotment import Allotment
from fleet.config import RunConfig
from fleet.errors import FleetError
from fleet.executor import Executor
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
    """Loaded; its drop station is full, so it waits where it is in nobody's way until it is called."""
    TO_DROP = "to_drop"
    UNLOADING = "unloading"
    RECOVERING = "recovering"
    RETIRED = "retired"
    """Drives, but takes no task: a parcel that could not be unloaded lies in its tray."""
    DEAD = "dead"


PHASES = tuple(CarPhase)
_BOOKED = frozenset({CarPhase.TO_PICK, CarPhase.LOADING, CarPhase.TO_DROP, CarPhase.UNLOADING})
"""Phases of a car that has a booking."""
_LOADED = frozenset({CarPhase.HELD, CarPhase.TO_DROP, CarPhase.UNLOADING})
_PARKED = frozenset({CarPhase.IDLE, CarPhase.RETIRED, CarPhase.HELD})
"""Phases of a car that waits in a parking place."""


_STANDING = {phase: PairReason.CAR_BUSY for phase in CarPhase} | {
    phase: PairReason.CAR_OUT for phase in (CarPhase.RECOVERING, CarPhase.RETIRED, CarPhase.DEAD)
}
"""Why a car in a phase cannot take a task."""


class CannotCancel(FleetError):
    """A task is asked back whose parcel the fleet already has, or that has ended."""


class CannotRequeue(FleetError):
    """A task is to be taken from a car that is not under way to pick it."""


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
        log: Log,
    ) -> None:
        self.board = board
        self.stations = stations
        self.phase = [CarPhase.IDLE] * world.n_cars
        self.phase_index = np.zeros(world.n_cars, dtype=np.int64)
        """The same as an index into `PHASES`, shape (n_cars,)."""
        self.served = np.full(len(stations), -1, dtype=np.int64)
        """The car each arm is at work on, or on its way home from, -1 for none, shape (n_stations,)."""
        self.bookings = Bookings([config.allocation.station_cap_n] * len(stations), world.n_cars)
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
        self._allotment = Allotment(
            config=config.allocation,
            board=board,
            stations=stations,
            bookings=self.bookings,
            service_times=self.service_times,
            abilities=abilities,
            traffic=traffic,
            executor=executor,
            reasons=self.reasons,
        )
        self.stock = Stock(board, stations, desk.car, world, log, self.reasons, self._allotment.source_cost)
        self._attempts: dict[int, int] = {}
        self._serving: dict[int, int] = {}
        self._dock_cells = [self._dock_cell(station) for station in stations]
        self._parking = _parking_states(site, graph)
        self._changed = True
        self._period = max(1, round(ALLOCATE_S / world.tick_s))
        self._fastest_move_s = site.grid.cell_m / desk.car.max_speed_mps

    def tick(self, tick: int, now_s: float) -> None:
        """Release, collect, allocate, and start or end services."""
        for task in self.board.release_due(now_s):
            self._warn_of_due(task)
        self._changed |= self.stock.tick(now_s)
        self._changed |= self.bookings.clear(self._stands_at)
        self._call(tick)
        if self._changed or tick % self._period == 0:
            self._changed = False
            self._take_back(now_s)
            self._time_out(now_s)
            self._allocate(tick, now_s)
            self._park(tick)
        self._start_services(tick, now_s)
        self._end_services(tick, now_s)

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
        """Take a task away from the car that is under way to pick it; another car gets it, if there is one.

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

    def resume(self, car: int, tick: int) -> None:
        """Bring a recovered car back into service with what it was doing."""
        task = self.task_of[car]
        if task is not None and task.state is TaskState.CARRIED:
            self._set_off(car, task, tick)
        else:
            self._enter(car, CarPhase.RETIRED if self.stock.tray_is_loaded(car) else CarPhase.IDLE)
        self._changed = True

    def _enter(self, car: int, phase: CarPhase) -> None:
        self.phase[car] = phase
        self.phase_index[car] = PHASES.index(phase)
        self.loaded[car] = phase in _LOADED
        self.bound[car] = phase in (CarPhase.TO_PICK, CarPhase.TO_DROP)
        if phase not in _BOOKED:
            self._leave(car)

    def _stands_at(self, car: int, place: int) -> bool:
        """Whether a car still holds the dock of a station."""
        return self._dock_cells[place] in self._executor.dependencies.held_cells(car)

    def _leave(self, car: int) -> None:
        place = int(self.bookings.place_of[car])
        self.bookings.leave(car, stands_there=place >= 0 and self._stands_at(car, place))

    def _set_off(self, car: int, task: Task, tick: int) -> None:
        """Send a loaded car to its drop station, or hold it back while that is full."""
        station = self._by_name[task.order.drop]
        self._leave(car)
        if not self.bookings.waiting(station.arm) and self.bookings.book(car, station.arm):
            self._enter(car, CarPhase.TO_DROP)
            self._send_to(car, station, tick)
            return
        self._enter(car, CarPhase.HELD)
        self.bookings.wait(car, station.arm)
        there = ", ".join(f"car_{other}" for other in self.bookings.cars(station.arm))
        task.reason = f"car_{car} is held: {station.name} is full ({there})"
        self._log("held", car=f"car_{car}", task=task.order.name, station=station.name, cause=task.reason)

    def _call(self, tick: int) -> None:
        """Let cars that were held back go on when their station has room."""
        for car, place in self.bookings.callable_cars():
            if self.phase[car] is CarPhase.HELD and self.bookings.book(car, place):
                self._enter(car, CarPhase.TO_DROP)
                self._send_to(car, self.stations[place], tick)
                self._log("called", car=f"car_{car}", station=self.stations[place].name)

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
            if phase is CarPhase.TO_PICK and task is not None and tails[car] != self._by_name[task.pick].dock_state:
                held[car] = task
            standing.append(None if phase is CarPhase.IDLE or car in held else _STANDING[phase])
        choice = self._allotment.choose(standing, held, now_s)
        for car, reason in choice.taken:
            self._unassign(held[car], now_s, reason)
            self._stand_down(car)
        for car, task in choice.given:
            self._assign(car, task, tick, now_s)

    def _stand_down(self, car: int) -> None:
        """Free a car that was under way to a pick station."""
        self.task_of[car] = None
        self._traffic.rank[car] = 0.0
        self._changed = True
        if self.phase[car] is CarPhase.TO_PICK:
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
        self._enter(car, CarPhase.TO_PICK)
        self.board.move(task, TaskState.ASSIGNED, now_s, f"car_{car} was the allocator's choice")
        self.reasons.assigned(task)
        self._send_to(car, self._by_name[task.pick], tick)

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
            name = task.pick if phase is CarPhase.TO_PICK else task.order.drop
            if self._traffic.reachable(int(tails[car]), self._by_name[name].dock_state):
                continue
            if phase is CarPhase.TO_PICK:
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
            if not self._desk.is_idle(station.arm):
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
                self._executor.open(self._dock_cell(station))

    def _give_up_service(self, station: Station, task: Task, car: int) -> None:
        """A task failed while an arm was at work on it, and the arm is clear now."""
        loading = station.place.kind == "pick"
        slot = task.pick_slot if loading else task.drop_slot
        if slot is not None and not self.stock.on_slot(task, slot, station):
            station.free_slot(slot)
        self._release_car(car, CarPhase.RETIRED if self.stock.in_tray(task, car) else CarPhase.IDLE)

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
            self._set_off(car, task, tick)

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


def _parking_states(site: Site, graph: LaneGraph) -> tuple[int, ...]:
    """One state for each parking cell."""
    return tuple(int(graph.states_of_cell(cell)[0]) for cell in site.parking)
