"""Dispatcher: what happens in which order at each tick, from the release of a task to the end of its service."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fleet.config import Perception as PerceptionKind
from fleet.config import RunConfig
from fleet.dispatch.allocation import Situation, TaskAllocation
from fleet.dispatch.availability import Availabilities, Availability
from fleet.dispatch.costs import CostModel
from fleet.dispatch.horizon import RollingHorizon
from fleet.errors import FleetError
from fleet.missions.admission import Admission
from fleet.missions.charging import Charging
from fleet.missions.docks import Docks
from fleet.missions.inventory import Inventory, Log
from fleet.missions.parking import Parking
from fleet.missions.perception import Perception, SeenPoses, TruePoses
from fleet.missions.places import Places
from fleet.missions.prefetch import Prefetch
from fleet.missions.roster import AT_CHARGER, CarPhase, Roster
from fleet.missions.visit_routes import VisitRoutes
from fleet.missions.visits import Visits
from fleet.robots.battery import Batteries
from fleet.stations.arms.arm_manager import ArmManager
from fleet.stations.booking import Bookings
from fleet.stations.service_time import ServiceTimes
from fleet.stations.station import Station
from fleet.tasks.backlog import Backlog
from fleet.tasks.board import CANCELLABLE, Task, TaskBoard, TaskState
from fleet.tasks.order import Ability
from fleet.tasks.reasons import PairReason, ReasonBook, TaskReason
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic
from fleet.world.protocol import World
from maps.lane_graph import LaneGraph
from maps.site import Site

REVIEW_S = 0.5
"""Time between two looks at what cannot go on, and two allocations if tasks or cars have changed [s]."""
PRICE_S = 5.0
"""Longest time between two allocations: costs change while cars drive [s]."""
CALL_S = 0.25
"""Time between two looks at the cars that are held back [s]."""

_STANDING = (
    dict.fromkeys(CarPhase, PairReason.CAR_BUSY)
    | dict.fromkeys((CarPhase.IDLE, *AT_CHARGER), PairReason.CAR_CHARGES)
    | dict.fromkeys((CarPhase.RECOVERING, CarPhase.RETIRED, CarPhase.DEAD), PairReason.CAR_OUT)
)
"""Why a car in a phase cannot take a task; one that is idle and cannot is about to charge."""


_UNDER_WAY = (CarPhase.TO_PICK, CarPhase.TO_PLACE, CarPhase.HELD)
_CAN_CHANGE_HANDS = (TaskState.ASSIGNED, TaskState.VISITING)
"""States in which a task has a car that could as well be another."""


class CannotCancel(FleetError):
    """A task is asked back whose parcel the fleet already has, or that has ended."""


class CannotRequeue(FleetError):
    """A task is to be taken from a car that is not to pick it, and does not visit."""


class Dispatcher:
    """Missions of all cars.

    Args:
        site: Floor, stations, parking.
        graph: Its lane graph.
        config: Allocation, collection time.
        board: The tasks.
        stations: In the order of the arms.
        arm_manager: Arm planning and playback.
        traffic: Takes goals.
        executor: Tells where cars are.
        world: Where parcels appear and vanish.
        abilities: What each car can carry.
        batteries: State of charge of the cars; None for cars that never need to charge.
        askew: Draws how parcels are put on their slots; None = exactly.
        log: Called as ``log(kind, **facts)`` for every event.
        allocation: Says who gets which task.
    """

    def __init__(
        self,
        *,
        site: Site,
        graph: LaneGraph,
        config: RunConfig,
        board: TaskBoard,
        stations: list[Station],
        arm_manager: ArmManager,
        traffic: Traffic,
        executor: Executor,
        world: World,
        abilities: Sequence[Ability],
        batteries: Batteries | None,
        askew: np.random.Generator | None,
        log: Log,
        allocation: type[TaskAllocation] = TaskAllocation,
    ) -> None:
        self.board = board
        self.allocations_n = 0
        """How often tasks were given out."""
        self._config = config
        self._traffic = traffic
        self._executor = executor
        self._stations = {station.name: station for station in stations}
        self.places = places = Places(site, graph, stations, traffic)
        caps = [config.allocation.station_cap_n] * len(stations)
        caps += [1] * (len(places.cells) - len(stations))
        self.bookings = Bookings(caps, world.n_cars)
        self.service_times = ServiceTimes(len(stations))
        self.reasons = ReasonBook(log)
        backlog = Backlog(board, self.reasons)
        place_cells = places.cells[: len(stations) + len(places.chargers)]
        self.roster = Roster(board, self.bookings, place_cells, len(stations), executor, traffic)
        self._admission = Admission(
            self._stations, self.roster, self.bookings, self.service_times, traffic, executor, log
        )
        self.charging: Charging | None = None
        if batteries is not None:
            self.charging = Charging(
                batteries=batteries,
                states=places.chargers[: config.battery.chargers_n],
                first_place=len(stations),
                roster=self.roster,
                admission=self._admission,
                bookings=self.bookings,
                traffic=traffic,
                executor=executor,
                service_times=self.service_times,
                log=log,
            )
        ways = VisitRoutes(places, self.bookings)
        self._cost_model = CostModel(
            config=config.allocation,
            stations=self._stations,
            service_times=self.service_times,
            abilities=abilities,
            charging=self.charging,
            ways=ways,
            traffic=traffic,
            executor=executor,
        )
        horizon, filling = (
            RollingHorizon(
                config=config.allocation,
                stations=stations,
                bookings=self.bookings,
                service_times=self.service_times,
                ways=ways,
                traffic=traffic,
            )
            for _ in range(2)
        )
        self.allocation = allocation(
            config=config.allocation,
            board=board,
            stations=self._stations,
            bookings=self.bookings,
            service_times=self.service_times,
            cost_model=self._cost_model,
            horizon=horizon,
            filling=filling,
            ways=ways,
            reason_book=self.reasons,
            log=log,
        )
        self.inventory = Inventory(
            board,
            stations,
            arm_manager.car,
            world,
            log,
            backlog,
            self.reasons,
            self._cost_model.source_cost,
            filling.turn_s,
            askew,
        )
        self.perception: Perception = TruePoses(self.inventory)
        if config.perception is PerceptionKind.CAMERA:
            self.perception = SeenPoses(stations, arm_manager.car, world, self.inventory, log)
        self._prefetch = Prefetch(stations, arm_manager, self.perception, traffic, executor, world.tick_s, log)
        self._availabilities = Availabilities(self._stations, self.roster, self.service_times, traffic, executor)
        self._docks = Docks(
            graph=graph,
            stations=self._stations,
            board=board,
            roster=self.roster,
            admission=self._admission,
            inventory=self.inventory,
            perception=self.perception,
            arm_manager=arm_manager,
            service_times=self.service_times,
            traffic=traffic,
            executor=executor,
            world=world,
            collect_after_s=config.collect_after_s,
            log=log,
        )
        self.visits = Visits(
            places=places,
            ways=ways,
            board=board,
            backlog=backlog,
            reasons=self.reasons,
            roster=self.roster,
            bookings=self.bookings,
            charging=self.charging,
            traffic=traffic,
            executor=executor,
            world=world,
            log=log,
        )
        self._parking = Parking(places.parking, self.roster, traffic, executor)
        self._call_period = max(1, round(CALL_S / world.tick_s))
        self._period = max(1, round(REVIEW_S / world.tick_s))
        self._price_period = self._period * round(PRICE_S / REVIEW_S)
        self._fastest_move_s = site.grid.cell_m / arm_manager.car.max_speed_mps

    def tick(self, tick: int, now_s: float) -> None:
        """Release, collect, allocate, and start or end services."""
        for task in self.board.release_due(now_s):
            self._warn_of_due(task)
        self.roster.changed |= self.inventory.tick(now_s)
        self.visits.release(now_s)
        self.roster.clear_left()
        if tick % self._call_period == 0:
            if self.charging is not None:
                self.charging.plug_in()
            self._admission.call(tick, now_s)
            self.visits.call(tick)
            if self.roster.changed:
                # Who has been served makes room before there is a task for it.
                self._parking.send(tick)
        if tick % self._period == 0:
            self._review(tick, now_s)
        self._docks.tick(tick, now_s)
        self._prefetch.tick(tick, self.roster)
        self.visits.tick(tick, now_s)

    def _review(self, tick: int, now_s: float) -> None:
        """End what cannot go on, and give out tasks."""
        self._take_back(now_s)
        self._time_out(now_s)
        wanted = self.visits.chargers_wanted()
        if self.charging is not None:
            self.charging.send_low(tick, now_s, wanted)
        if self.roster.changed or tick % self._price_period == 0:
            self.roster.changed = False
            self._allocate(tick, now_s)
            wanted = self.visits.chargers_wanted()
        if self.charging is not None:
            self.charging.send_idle(tick, wanted)
        self._parking.send(tick)

    def cancel(self, task: Task, now_s: float, reason: str) -> None:
        """Take a task back whose parcel was not picked yet; its car is free, and its parcel leaves the warehouse.

        A visit can be taken back until its end.

        Raises:
            CannotCancel: It is too late.
        """
        if task.state not in CANCELLABLE:
            own = CANCELLABLE if task.visit is not None else CANCELLABLE - {TaskState.VISITING}
            valid = ", ".join(state for state in TaskState if state in own)
            raise CannotCancel(f"task {task.order.name} is {task.state}; valid to cancel: {valid}")
        car = task.car if task.state in _CAN_CHANGE_HANDS else None
        self.inventory.withdraw(task, now_s, reason)
        if car is not None:
            self.roster.stand_down(car)

    def requeue(self, task: Task, now_s: float, reason: str) -> None:
        """Take a task away from the car that is to pick it, or that visits; another car gets it, if there is one.

        Raises:
            CannotRequeue: No car is under way to pick it, and none visits.
        """
        if task.state not in _CAN_CHANGE_HANDS or task.car is None:
            valid = TaskState.ASSIGNED if task.visit is None else ", ".join(_CAN_CHANGE_HANDS)
            raise CannotRequeue(f"task {task.order.name} is {task.state}; valid to requeue: {valid}")
        car = task.car
        task.shunned.add(car)
        self.roster.unassign(task, now_s, reason)
        self.roster.stand_down(car)

    def retire(self, car: int, phase: CarPhase, now_s: float, reason: str) -> None:
        """Take a car out of service; a visit, or a task whose parcel it has not got yet, goes back to the pool.

        An arm that is at work on the car goes on: what becomes of the task is judged when it is clear.
        """
        task = self.roster.task_of[car]
        self.roster.enter(car, phase)
        if task is None:
            return
        if task.state in _CAN_CHANGE_HANDS:
            self.roster.unassign(task, now_s, reason)
        elif task.state is TaskState.CARRIED and phase is CarPhase.DEAD:
            self._docks.strand(task, car, now_s, reason)

    def is_served(self, car: int) -> bool:
        """True while an arm is at work on a car, or still on its way home from it."""
        return self._docks.is_served(car)

    def resume(self, car: int, tick: int, now_s: float) -> None:
        """Bring a recovered car back into service with what it was doing."""
        task = self.roster.task_of[car]
        if task is not None and task.state is TaskState.CARRIED:
            self._admission.set_off(car, task, tick, now_s)
        else:
            self.roster.enter(car, CarPhase.RETIRED if self.inventory.tray_is_loaded(car) else CarPhase.IDLE)
        self.roster.changed = True

    def _warn_of_due(self, task: Task) -> None:
        """Say at once when not even a car that stands at the pick dock could bring a task in time."""
        least_s = self._cost_model.least_s(task, self._fastest_move_s)
        if task.order.release_s + least_s > task.order.due_s:
            left_s = task.order.due_s - task.order.release_s
            takes = f"takes {least_s:.1f} s from" if math.isfinite(least_s) else "there is no way on from"
            text = f"it is due {left_s:.1f} s after its release, and {takes} {task.next_words}"
            self.reasons.warn(task, text)

    def _allocate(self, tick: int, now_s: float) -> None:
        """Give tasks to cars that are free, and exchange those that are not picked yet where much is gained."""
        self.allocations_n += 1
        tails = self._executor.tail_states()
        held: dict[int, Task] = {}
        busy: dict[int, Availability] = {}
        standing: list[PairReason | None] = []
        for car, phase in enumerate(self.roster.phase):
            task = self.roster.task_of[car]
            if task is not None and task.state is TaskState.ASSIGNED and phase in _UNDER_WAY:
                # A car whose way ends in the dock is about to be served.
                goal = self._traffic.goals[car] if task.visit else self._stations[task.pick].dock_state
                if tails[car] != goal:
                    held[car] = task
            standing.append(None if car in held or self._is_free(car) else _STANDING[phase])
            availability = self._availabilities.of(car, now_s) if standing[car] is not None else None
            if availability is not None:
                busy[car] = availability
        situation = Situation(standing=standing, held=held, kept=self.roster.kept(), busy=busy)
        if tick % self._price_period == 0:
            self.allocation.plan_filling(situation, now_s)
        choice = self.allocation.choose(situation, now_s)
        for car, reason in choice.taken:
            self.roster.unassign(held[car], now_s, reason)
            self.roster.stand_down(car)
        for car, task in choice.given:
            self._assign(car, task, tick, now_s)

    def _is_free(self, car: int) -> bool:
        """Whether a car may be given a task."""
        phase = self.roster.phase[car]
        waits = phase is CarPhase.IDLE or (phase in AT_CHARGER and self.roster.task_of[car] is None)
        return waits and (self.charging is None or self.charging.spares(car))

    def _time_out(self, now_s: float) -> None:
        """End what has lasted too long."""
        limits = self._config.timeouts
        for task in self.board.in_state(TaskState.BACKLOG, TaskState.READY):
            if now_s - task.since_s[TaskState.BACKLOG] > limits.waiting_s:
                self.cancel(task, now_s, f"no car had it {limits.waiting_s:g} s after its release")
        for task in self.board.in_state(TaskState.ASSIGNED):
            if now_s - task.since_s[TaskState.ASSIGNED] > limits.assigned_s:
                self.requeue(task, now_s, f"car_{task.car} was not at {task.next_words} after {limits.assigned_s:g} s")
        for task in self.board.in_state(TaskState.LOADING, TaskState.UNLOADING):
            if now_s - task.since_s[task.state] > limits.service_s:
                self.board.move(task, TaskState.FAILED, now_s, f"was {task.state} for {limits.service_s:g} s")
        for task in self.board.in_state(TaskState.VISITING):
            if now_s - task.since_s[TaskState.VISITING] > limits.visiting_s and task.car is not None:
                self.board.move(task, TaskState.FAILED, now_s, f"had not ended after {limits.visiting_s:g} s")
                self.roster.release(task.car)
        for task in self.board.in_state(TaskState.CARRIED):
            if now_s - task.since_s[TaskState.CARRIED] > limits.carried_s and task.car is not None:
                reason = f"car_{task.car} was not at {task.delivery.drop} after {limits.carried_s:g} s"
                self._docks.give_up(task, now_s, reason)
                self.roster.release(task.car, CarPhase.RETIRED)

    def _assign(self, car: int, task: Task, tick: int, now_s: float) -> None:
        # A visit has to find room where it goes first; a delivery waits its turn.
        if task.visit is not None and not self.visits.book(car, task):
            # Another visit that was given out with it took the only place.
            text = f"{task.next_words} has no room for one more car"
            self.reasons.note(task, TaskReason.STATION_FULL, text, now_s)
            self.roster.changed = True
            return
        task.car = car
        self.roster.task_of[car] = task
        self.board.move(task, TaskState.ASSIGNED, now_s, f"car_{car} was the allocator's choice")
        self.reasons.assigned(task)
        if task.visit is not None:
            self.visits.send(car, task, tick)
        else:
            self._admission.set_off(car, task, tick, now_s)

    def _take_back(self, now_s: float) -> None:
        """Free cars of tasks that they have no way to go on with."""
        if not self._traffic.blocked.any():
            return
        tails = self._executor.tail_states()
        for car, phase in enumerate(self.roster.phase):
            task = self.roster.task_of[car]
            if task is None or phase not in (*_UNDER_WAY, CarPhase.TO_DROP):
                continue
            if task.visit is not None:
                if not self.visits.has_way(car, task):
                    self.roster.unassign(task, now_s, f"car_{car} has no way to {task.place}")
                    self.roster.release(car)
                continue
            picks = task.state is not TaskState.CARRIED
            name = task.pick if picks else task.delivery.drop
            if self._traffic.reachable(int(tails[car]), self._stations[name].dock_state):
                continue
            if picks:
                self.roster.unassign(task, now_s, f"car_{car} has no way to {name}")
                self.roster.release(car)
            elif self._traffic.blocked_for_good:
                self._docks.give_up(task, now_s, f"car_{car} has no way to {name}; its parcel stays in the tray")
                self.roster.release(car, CarPhase.RETIRED)
