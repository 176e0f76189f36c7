"""Docks: a car that has come to its station is served, and what became of its parcel is judged."""

from __future__ import annotations

from collections.abc import Callable

from fleet.missions.admission import Admission
from fleet.missions.parcels.aboard import Aboard
from fleet.missions.parcels.transfer_requests import Transfers
from fleet.missions.phases import AT_DOCK, GONE, CarPhase
from fleet.missions.services import Services
from fleet.missions.state import NOBODY, Missions
from fleet.missions.ways import Ways
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.stations.service_time import Direction
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState

_STATE_AT = {Direction.TO_CAR: TaskState.LOADING, Direction.FROM_CAR: TaskState.UNLOADING}
_ARM_IS_DONE = (ArmPhase.DONE, ArmPhase.MOVING, ArmPhase.IDLE)


class Docks:
    """What happens to cars at docks.

    Args:
        missions: What cars and stations are about.
        ways: Tells which cars have come.
        services: Begins and ends services.
        transfers: Asks arms, and tells where parcels really are.
        admission: Sends loaded cars on.
        aboard: What cars take beside what they came for.
        log: Called as ``log(kind, **facts)`` when a transfer is repeated.
    """

    def __init__(
        self,
        missions: Missions,
        ways: Ways,
        services: Services,
        transfers: Transfers,
        admission: Admission,
        aboard: Aboard,
        log: Callable[..., None],
    ) -> None:
        self._missions = missions
        self._ways = ways
        self._services = services
        self._transfers = transfers
        self._arms = transfers.arm_manager
        self._admission = admission
        self._inventory = transfers.inventory
        self._aboard = aboard
        self._log = log

    def tick(self, tick: int, now_s: float) -> None:
        """Start the services that can begin, and end those that are over."""
        self._start(tick, now_s)
        self._end(tick, now_s)
        if self._aboard.any:
            self._go_on(tick, now_s)

    def give_up(self, task: Task, now_s: float, reason: str) -> None:
        """Give up a task whose parcel is in a car, and the slot that waits for it."""
        self._missions.board.move(task, TaskState.FAILED, now_s, reason)
        if task.drop_slot is not None:
            self._missions.stations.named(task.delivery.drop).free_slot(task.drop_slot)

    def strand(self, task: Task, car: int, now_s: float, reason: str) -> None:
        """Give up a task whose parcel rides in a car that will not move again."""
        self.give_up(task, now_s, f"parcel stranded: {reason}")
        self._missions.forget(car)

    def _start(self, tick: int, now_s: float) -> None:
        missions = self._missions
        there = missions.bound & self._ways.at_goals()
        for car in there.nonzero()[0].tolist():
            task, loading = missions.task_of[car], missions.phase[car] is CarPhase.TO_PICK
            if task is None or not (loading or missions.phase[car] is CarPhase.TO_DROP):
                continue
            station = missions.stations.named(task.pick if loading else task.delivery.drop)
            if not self._ways.stands_at(car, station.dock_state):
                continue
            if missions.served[station.arm] != NOBODY or not missions.bookings.has(car):
                continue
            if not self._arms.is_ready(station.arm, task.parcel, self._transfers.tray_of(car)):
                continue
            if not loading and task.drop_slot is None:
                task.drop_slot = station.take_slot(task.index)
                if task.drop_slot is None:
                    continue
            self._services.begin(station, car, task, now_s)
            self._transfers.request(station, task, car, tick)

    def _end(self, tick: int, now_s: float) -> None:
        missions = self._missions
        under_way = self._services.under_way
        # An arm may be on its way home for so long that its car is served elsewhere meanwhile: the last one counts.
        latest = {car: arm for arm, car in under_way}
        for arm, car in under_way:
            if not self._arms.services[arm].dock_is_clear:
                continue
            station = missions.stations[arm]
            if latest[car] == arm:
                self._look(station, car, tick, now_s)
                if missions.phase[car] in AT_DOCK:
                    continue
            if self._arms.is_idle(arm):
                self._services.end(station, now_s)

    def _look(self, station: Station, car: int, tick: int, now_s: float) -> None:
        """See what an arm has done that is clear of a car."""
        task = self._missions.task_of[car]
        if task is None:
            return
        if task.state is TaskState.FAILED and self._arms.is_idle(station.arm):
            self._break_off(station, task, car)
        if task.state is _STATE_AT[station.direction]:
            self._judge(station, task, car, tick, now_s)

    def _break_off(self, station: Station, task: Task, car: int) -> None:
        """A task failed while an arm was at work on it, and the arm is clear now."""
        loading = station.direction is Direction.TO_CAR
        slot = task.pick_slot if loading else task.drop_slot
        if slot is not None and not self._inventory.on_slot(task, slot, station):
            station.free_slot(slot)
        self._missions.release(car, CarPhase.RETIRED if self._inventory.in_tray(task, car) else CarPhase.IDLE)

    def _judge(self, station: Station, task: Task, car: int, tick: int, now_s: float) -> None:
        """Look where the parcel really is, now that the arm is clear of the car, and draw the consequence."""
        loading = task.state is TaskState.LOADING
        slot = task.pick_slot if loading else task.drop_slot
        on_slot, in_tray = self._inventory.on_slot(task, slot, station), self._inventory.in_tray(task, car)
        if self._arms.services[station.arm].state in _ARM_IS_DONE and (in_tray if loading else on_slot):
            self._missions.stations.times.complete(station.arm)
            if loading:
                self._loaded(station, task, car, tick, now_s)
            else:
                self._delivered(station, task, car, now_s)
            return
        if not self._arms.is_idle(station.arm):
            return
        at_source = on_slot if loading else in_tray
        pushed = self._missions.phase[car] is CarPhase.RECOVERING
        if at_source and pushed:
            # The car was pushed from under the arm: it comes back to the dock, or another does.
            if loading:
                self._missions.unassign(task, now_s, f"car_{car} left its lane")
            else:
                self._missions.board.move(task, TaskState.CARRIED, now_s, f"car_{car} left its lane")
            return
        cause = self._arms.reason(station.arm) or "the parcel is not where it was set down"
        x, y, z = (round(float(v), 3) for v in self._inventory.pose(task)[:3])
        if not pushed and self._transfers.may_repeat(task):
            where = {} if at_source else {"x_m": x, "y_m": y, "z_m": z}
            self._log("transfer_repeated", task=task.order.name, station=station.name, cause=cause, **where)
            self._transfers.request(station, task, car, tick)
            return
        reason = f"{cause} at {station.name}; parcel lies at ({x}, {y}, {z})"
        self._missions.board.move(task, TaskState.FAILED, now_s, reason)
        if slot is not None and not self._inventory.obstructs(task, slot, station):
            station.free_slot(slot)
        self._missions.release(car, CarPhase.RETIRED if in_tray else CarPhase.IDLE)

    def _loaded(self, station: Station, task: Task, car: int, tick: int, now_s: float) -> None:
        self._inventory.vacate(task)
        self._transfers.succeed(task)
        self._missions.board.move(task, TaskState.CARRIED, now_s, f"measured in the tray of car_{car}")
        self._missions.changed = True
        phase = self._missions.phase[car]
        if phase is CarPhase.DEAD:
            self.strand(task, car, now_s, f"car_{car} is dead")
        elif phase is not CarPhase.RECOVERING and self._aboard.take_more(station, car, now_s) is None:
            self._services.let_go(car)
            self._admission.set_off(car, self._nearest(car, task), tick, now_s)

    def _nearest(self, car: int, task: Task) -> Task:
        """Let a car be about that of its deliveries whose drop station is nearest."""
        nearest = self._aboard.nearest(car)
        if nearest is None or nearest is task:
            return task
        self._missions.stow(car)
        self._missions.take_up(car, nearest)
        return nearest

    def _go_on(self, tick: int, now_s: float) -> None:
        """Let cars that have ended one delivery bring away the next that they carry, or give up what they cannot."""
        missions = self._missions
        for car, carried in enumerate(missions.aboard):
            if not carried or missions.task_of[car] is not None:
                continue
            phase = missions.phase[car]
            if phase is CarPhase.IDLE or (phase is CarPhase.RETIRED and car in missions.leaving):
                task = self._aboard.nearest(car)
                if task is not None:
                    missions.take_up(car, task)
                    self._admission.set_off(car, task, tick, now_s)
            elif phase in GONE:
                for task in list(carried):
                    carried.remove(task)
                    self.give_up(task, now_s, f"parcel stranded: car_{car} is {phase}")

    def _delivered(self, station: Station, task: Task, car: int, now_s: float) -> None:
        self._missions.board.move(
            task, TaskState.DELIVERED, now_s, f"measured on slot {task.drop_slot} of {station.name}"
        )
        if task.drop_slot is not None:
            self._inventory.collect_later(station, task.drop_slot, now_s)
        missions = self._missions
        here = next((other for other in missions.aboard[car] if other.delivery.drop == station.name), None)
        if here is None or missions.phase[car] is not CarPhase.UNLOADING:
            missions.release(car)
            return
        missions.forget(car)
        missions.take_up(car, here)
        missions.enter(car, CarPhase.TO_DROP)
