"""StationWork: picks and drops of one car by the arms of stations, as deliveries that begin when the master says so."""

from __future__ import annotations

from dataclasses import dataclass, replace

from fleet.missions.phases import CarPhase
from fleet.run.view import RunView
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Delivery
from fleet.vda5050.order import Action
from fleet.vda5050.sight import CarriedLoad
from fleet.vda5050.vehicle import ActionStatus

MASS_KG, EDGE_M = 0.3, 0.06
"""A parcel of which the master says nothing [kg, m]."""
_CARRIED = (TaskState.CARRIED, TaskState.UNLOADING)


@dataclass
class _Job:
    """A pick or drop that has not ended."""

    action: Action
    station: Station
    task: Task
    loading: bool
    booked: bool = False


class StationWork:
    """What one car has done at stations.

    A pick makes a delivery of which nobody knows yet where it ends; the drop says so.

    Args:
        run: The run.
        car: The car.
    """

    def __init__(self, run: RunView, car: int) -> None:
        self._run = run
        self._car = car
        self._job: _Job | None = None
        self._loads: dict[int, CarriedLoad] = {}

    @property
    def loads(self) -> tuple[CarriedLoad, ...]:
        """What lies in the tray."""
        task = self._run.missions.task_of[self._car]
        if task is None or task.state not in _CARRIED:
            return ()
        return (self._loads[task.index],)

    @property
    def action_id(self) -> str:
        """The action that is under way; empty = none."""
        return "" if self._job is None else self._job.action.id

    def begin(self, action: Action, station: Station) -> str:
        """Begin a pick or drop; the car stands at the dock.

        Returns:
            Why it cannot be done; empty if it is under way.
        """
        missions, phase = self._run.missions, self._run.missions.phase[self._car]
        task = missions.task_of[self._car]
        if self._job is not None:
            return f"action {self._job.action.id} is under way"
        if action.type == "pick":
            if task is not None or phase is not CarPhase.IDLE or self._run.inventory.tray_is_loaded(self._car):
                return "the tray is not empty"
            self._job = _Job(action, station, self._new_task(action, station), loading=True)
            return ""
        if task is None or task.state is not TaskState.CARRIED:
            return "the tray is empty"
        load = self._loads[task.index]
        if action.parameters.get("loadId", load.id) != load.id:
            return f"loadId is {action.parameters['loadId']!r}; valid: {load.id!r}, which lies in the tray"
        task.order = replace(task.delivery, drop=station.name)
        missions.drop_of[self._car] = station.arm
        self._job = _Job(action, station, task, loading=False)
        return ""

    def tick(self, now_s: float) -> tuple[ActionStatus, str] | None:
        """Go on with what is under way.

        Returns:
            How far it is, and the result in words; None = nothing is under way.
        """
        job = self._job
        if job is None:
            return None
        state = job.task.state
        if state is TaskState.FAILED:
            return self._end(ActionStatus.FAILED, job.task.reason)
        if job.loading and state is TaskState.CARRIED:
            return self._end(ActionStatus.FINISHED, f"{self._loads[job.task.index].id} lies in the tray")
        if not job.loading and state in (TaskState.DELIVERED, TaskState.COLLECTED):
            return self._end(ActionStatus.FINISHED, f"{self._loads[job.task.index].id} lies at {job.station.name}")
        if state is TaskState.READY:
            reason = job.task.reason
            self._run.inventory.withdraw(job.task, TaskState.CANCELLED, now_s, reason)
            return self._end(ActionStatus.FAILED, reason)
        if not job.booked:
            job.booked = self._book(job, now_s)
        return (ActionStatus.RUNNING if job.booked else ActionStatus.INITIALIZING), ""

    def give_up(self, now_s: float) -> bool:
        """Give up a pick that no arm has begun; False if an arm is at work, or nothing is under way."""
        job = self._job
        if job is None or job.task.state is not TaskState.ASSIGNED:
            return False
        self._run.dispatcher.rules.interventions.cancel(job.task, now_s, "the order was cancelled")
        self._job = None
        return True

    def _book(self, job: _Job, now_s: float) -> bool:
        """Have the station for the car, and a slot for its parcel."""
        missions, arm = self._run.missions, job.station.arm
        if missions.bookings.room(arm) <= 0 and not missions.bookings.has(self._car):
            return False
        if job.loading and not self._run.dispatcher.rules.slots.take(job.task, now_s):
            return False
        if int(missions.bookings.place_of[self._car]) != arm:
            missions.bind(self._car, arm)
        return missions.bookings.book(self._car)

    def _new_task(self, action: Action, station: Station) -> Task:
        run, now_s = self._run, self._run.sim_s
        number = len(run.board.tasks) + 1
        order = Delivery(
            name=f"load_{number}",
            release_s=now_s,
            pick=station.name,
            drop=run.site.station_names("drop")[0],
            mass_kg=float(action.parameters.get("weight", MASS_KG)),
            size_m=(EDGE_M, EDGE_M, EDGE_M),
        )
        task = run.board.add(order)
        run.board.release_due(now_s)
        self._loads[task.index] = CarriedLoad(
            id=str(action.parameters.get("loadId", order.name)),
            type=str(action.parameters.get("loadType", "parcel")),
            weight_kg=order.mass_kg,
        )
        run.board.move(task, TaskState.READY, now_s, "the master asked for it")
        run.missions.assign(self._car, task, now_s, "the master asked for it")
        run.missions.enter(self._car, CarPhase.TO_PICK)
        return task

    def _end(self, status: ActionStatus, result: str) -> tuple[ActionStatus, str]:
        self._job = None
        return status, result
