"""Interventions: tasks are taken back, cars leave service and come back, and what lasts too long is ended."""

from __future__ import annotations

from fleet.config import TimeoutConfig
from fleet.errors import FleetError
from fleet.missions.admission import Admission
from fleet.missions.docks import Docks
from fleet.missions.parcels.inventory import Inventory
from fleet.missions.phases import CarPhase
from fleet.missions.state import Missions
from fleet.missions.visits import Visits
from fleet.missions.ways import Ways
from fleet.tasks.board import CANCELLABLE, Task, TaskState

_UNDER_WAY = (CarPhase.TO_PICK, CarPhase.TO_PLACE, CarPhase.HELD, CarPhase.TO_DROP)
_CAN_CHANGE_HANDS = (TaskState.ASSIGNED, TaskState.VISITING)
"""States in which a task has a car that could as well be another."""


class CannotCancel(FleetError):
    """A task is asked back whose parcel the fleet already has, or that has ended."""


class CannotRequeue(FleetError):
    """A task is to be taken from a car that is not to pick it, and does not visit."""


class Interventions:
    """What happens to tasks and cars from outside of their usual course.

    Args:
        missions: What cars are about.
        ways: Tells whether they can go on.
        inventory: Takes parcels out.
        docks: Gives up tasks whose parcels are in cars.
        admission: Sends loaded cars on.
        visits: Tells whether visits can go on.
        limits: How long a task may stay in a state.
    """

    def __init__(
        self,
        missions: Missions,
        ways: Ways,
        inventory: Inventory,
        docks: Docks,
        admission: Admission,
        visits: Visits,
        limits: TimeoutConfig,
    ) -> None:
        self._missions = missions
        self._ways = ways
        self._inventory = inventory
        self._docks = docks
        self._admission = admission
        self._visits = visits
        self._limits = limits

    def change(self, limits: TimeoutConfig) -> None:
        """Go on with other limits."""
        self._limits = limits

    def cancel(self, task: Task, now_s: float, reason: str) -> None:
        """Take a task back whose parcel was not picked yet; its car is free, and its parcel leaves the warehouse.

        A visit can be taken back until its end.

        Raises:
            CannotCancel: It is too late.
        """
        if task.lifted and task.state in CANCELLABLE:
            raise CannotCancel(f"task {task.order.name}: car_{task.car} has lifted the pod; valid: before that")
        if task.state not in CANCELLABLE:
            own = CANCELLABLE if task.visit is not None else CANCELLABLE - {TaskState.VISITING}
            valid = ", ".join(state for state in TaskState if state in own)
            raise CannotCancel(f"task {task.order.name} is {task.state}; valid to cancel: {valid}")
        car = task.car if task.state in _CAN_CHANGE_HANDS else None
        self._inventory.withdraw(task, TaskState.CANCELLED, now_s, reason)
        if car is not None:
            self._missions.stand_down(car)

    def requeue(self, task: Task, now_s: float, reason: str) -> None:
        """Take a task away from the car that is to pick it, or that visits; another car gets it, if there is one.

        Raises:
            CannotRequeue: No car is under way to pick it, and none visits.
        """
        if task.state not in _CAN_CHANGE_HANDS or task.car is None:
            valid = TaskState.ASSIGNED if task.visit is None else ", ".join(_CAN_CHANGE_HANDS)
            raise CannotRequeue(f"task {task.order.name} is {task.state}; valid to requeue: {valid}")
        if task.lifted:
            raise CannotRequeue(f"task {task.order.name}: car_{task.car} has lifted the pod; valid: before that")
        car = task.car
        task.shunned.add(car)
        self._missions.unassign(task, now_s, reason)
        self._missions.stand_down(car)

    def retire(self, car: int, phase: CarPhase, now_s: float, reason: str) -> None:
        """Take a car out of service; a visit, or a task whose parcel it has not got yet, goes back to the pool.

        An arm that is at work on the car goes on: what becomes of the task is judged when it is clear.
        """
        missions = self._missions
        task = missions.task_of[car]
        missions.enter(car, phase)
        if task is None:
            return
        if task.lifted:
            if phase is CarPhase.DEAD:
                self._visits.give_up(car, task, now_s, reason)
        elif task.state in _CAN_CHANGE_HANDS:
            missions.unassign(task, now_s, reason)
        elif task.state is TaskState.CARRIED and phase is CarPhase.DEAD:
            self._docks.strand(task, car, now_s, reason)

    def resume(self, car: int, tick: int, now_s: float) -> None:
        """Bring a recovered car back into service with what it was doing."""
        missions = self._missions
        task = missions.task_of[car]
        if task is not None and task.state is TaskState.CARRIED:
            self._admission.set_off(car, task, tick, now_s)
        elif task is not None and task.lifted:
            self._visits.set_off_again(car, task, tick, now_s)
        else:
            stays = self._keeps_load(car) and not missions.aboard[car]
            missions.enter(car, CarPhase.RETIRED if stays else CarPhase.IDLE)
        missions.changed = True

    def take_out(self, car: int, now_s: float, *, for_good: bool) -> None:
        """Let a car leave service as planned: what it has not picked goes back, what it carries is delivered first."""
        missions = self._missions
        missions.leaving[car] = for_good
        task = missions.task_of[car]
        if missions.phase[car] is CarPhase.IDLE:
            missions.enter(car, CarPhase.RETIRED)
        elif task is not None and task.state in _CAN_CHANGE_HANDS and not task.lifted:
            self.requeue(task, now_s, f"car_{car} leaves service")

    def bring_back(self, car: int) -> None:
        """Let a car that has left service as planned come back."""
        missions = self._missions
        missions.leaving.pop(car, None)
        if missions.phase[car] is CarPhase.RETIRED and not self._keeps_load(car):
            missions.enter(car, CarPhase.IDLE)
            missions.changed = True

    def _keeps_load(self, car: int) -> bool:
        """Whether a car has a parcel in its tray or a pod on its plate."""
        return self._inventory.tray_is_loaded(car) or self._visits.keeps_pod(car)

    def close_station(self, arm: int, now_s: float, why: str, *, for_good: bool) -> None:
        """Let no more cars come to a station; those that are to pick there give their tasks back.

        Args:
            arm: Of the station.
            now_s: Simulated time [s].
            why: What is said of the station, such as "is closed"; until `open_station` with the same words.
            for_good: Whether nothing is known of an end.
        """
        missions = self._missions
        station = missions.stations[arm]
        missions.stations.close(arm, why, for_good=for_good)
        missions.bookings.closed[arm] = True
        missions.changed = True
        for car in missions.cars_in(CarPhase.TO_PICK, CarPhase.HELD):
            task = missions.task_of[car]
            if task is not None and task.state is TaskState.ASSIGNED and missions.pick_of[car] == arm:
                missions.unassign(task, now_s, f"{station.name} {why}")
                missions.stand_down(car)

    def open_station(self, arm: int, why: str) -> None:
        """Let a reason to be closed go; cars may come to the station again if it was the last one."""
        missions = self._missions
        missions.stations.open(arm, why)
        missions.bookings.closed[arm] = not missions.stations.is_open(missions.stations[arm].name)
        missions.changed = True

    def end_overdue(self, now_s: float) -> None:
        """End what has lasted too long."""
        missions, limits, board = self._missions, self._limits, self._missions.board
        for task in board.longer_than(limits.waiting_s, now_s, TaskState.BACKLOG, since=TaskState.BACKLOG):
            self.cancel(task, now_s, f"no car had it {limits.waiting_s:g} s after its release")
        for task in board.longer_than(limits.waiting_s, now_s, TaskState.READY, since=TaskState.BACKLOG):
            self.cancel(task, now_s, f"no car had it {limits.waiting_s:g} s after its release")
        for task in board.longer_than(limits.assigned_s, now_s, TaskState.ASSIGNED):
            self.requeue(task, now_s, f"car_{task.car} was not at {task.next_words} after {limits.assigned_s:g} s")
        for state in (TaskState.LOADING, TaskState.UNLOADING):
            for task in board.longer_than(limits.service_s, now_s, state):
                board.move(task, TaskState.FAILED, now_s, f"was {task.state} for {limits.service_s:g} s")
        for task in board.longer_than(limits.visiting_s, now_s, TaskState.VISITING):
            if task.car is not None:
                self._visits.give_up(task.car, task, now_s, f"had not ended after {limits.visiting_s:g} s")
        for task in board.longer_than(limits.carried_s, now_s, TaskState.CARRIED):
            if task.car is not None and missions.task_of[task.car] is task:
                reason = f"car_{task.car} was not at {task.delivery.drop} after {limits.carried_s:g} s"
                self._give_up(task.car, task, now_s, reason)

    def _give_up_lost(self, now_s: float) -> None:
        """Give up what leads to stations that are closed for good; cars keep the parcels that they carry."""
        missions = self._missions
        for car in missions.cars_in(CarPhase.TO_PICK, CarPhase.TO_DROP, CarPhase.HELD):
            task = missions.task_of[car]
            if task is None or task.visit is not None:
                continue
            carried = task.state is TaskState.CARRIED
            names = (task.delivery.drop,) if carried else (task.pick, task.delivery.drop)
            lost = [name for name in names if missions.stations.is_lost(missions.stations.named(name))]
            if lost and carried:
                self._give_up(car, task, now_s, f"{lost[0]} is closed for good; its parcel stays in the tray")
            elif lost:
                missions.unassign(task, now_s, f"{lost[0]} is closed for good")
                missions.release(car)

    def _give_up(self, car: int, task: Task, now_s: float, reason: str) -> None:
        """Give up a task whose parcel stays in its car, which takes no other."""
        self._docks.give_up(task, now_s, reason)
        self._missions.release(car, CarPhase.RETIRED)

    def take_back(self, now_s: float) -> None:
        """Free cars of tasks that they have no way to go on with."""
        missions = self._missions
        if missions.stations.any_lost:
            self._give_up_lost(now_s)
        if not self._ways.blocked.any():
            return
        for car in missions.cars_in(*_UNDER_WAY):
            task = missions.task_of[car]
            if task is None:
                continue
            if task.visit is not None:
                if not task.lifted and not self._visits.has_way(car, task):
                    missions.unassign(task, now_s, f"car_{car} has no way to {task.place}")
                    missions.release(car)
                continue
            picks = task.state is not TaskState.CARRIED
            name = task.pick if picks else task.delivery.drop
            if self._ways.reaches(car, missions.stations.named(name).dock_state):
                continue
            if picks:
                missions.unassign(task, now_s, f"car_{car} has no way to {name}")
                missions.release(car)
            elif self._ways.cut_off(car, missions.stations.named(name).dock_state):
                self._give_up(car, task, now_s, f"car_{car} has no way to {name}; its parcel stays in the tray")
