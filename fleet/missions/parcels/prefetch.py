"""Fetching: an arm takes its next parcel while cars change at the dock, or while its partner there has the tray."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter

import numpy as np

from fleet.arrays import IntArray
from fleet.missions.parcels.perception import PoseSource
from fleet.missions.phases import CarPhase
from fleet.missions.state import Missions
from fleet.missions.ways import Ways
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.stations.arms.arm_manager import ArmManager
from fleet.stations.arms.transfer import FetchRequest
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState

N_MOVES_AHEAD = 8
"""A parcel is fetched when its car has at most so many moves left to the dock: that is about twice the time it takes,
and late enough that the car seldom loses its task to another."""
LOOK_S = 0.25
"""Time between two looks at who comes [s]."""
MAX_FETCHES = 2
"""A parcel that was missed or lost so often is left to the transfer itself."""


class Prefetch:
    """Says which parcels are fetched ahead, and which of them are put back.

    A parcel in the grip still counts as that of its slot, which stays taken: its task may go to another car, be
    cancelled or fail as if the parcel lay there.

    Args:
        missions: Tells which cars come.
        ways: How far they are.
        arm_manager: Arm planning and playback.
        perception: Tells where parcels lie.
        tick_s: Length of a tick [s].
        log: Called as ``log(kind, **facts)`` when a parcel is fetched or put back.
        tray_of: Which kind of tray each car has, shape (n_cars,).
    """

    def __init__(
        self,
        missions: Missions,
        ways: Ways,
        arm_manager: ArmManager,
        perception: PoseSource,
        tick_s: float,
        log: Callable[..., None],
        tray_of: IntArray,
    ) -> None:
        self._tray_of = tray_of
        self._stations = [
            station for station in missions.stations.loading() if arm_manager.services[station.arm].fetches
        ]
        self._missions = missions
        self._ways = ways
        self._arm_manager = arm_manager
        self._perception = perception
        self._log = log
        self._period = max(1, round(LOOK_S / tick_s))
        self._task: dict[int, Task] = {}
        self._fetches: dict[int, int] = {}

    def tick(self, tick: int) -> None:
        """Begin what can be begun for the cars that are on their way to pick."""
        if not self._stations or tick % self._period:
            return
        near = self._near()
        for station in self._stations:
            arm, manager = station.arm, self._arm_manager
            holds = manager.services[arm].state is ArmPhase.HOLDING
            if self._missions.served[arm] >= 0 or not (holds or manager.is_idle(arm)):
                continue
            if holds:
                self._look_after(station, [task for left, _, task in near.get(arm, ()) if left == 0])
            elif arm in near:
                _, _, task = min(near[arm], key=itemgetter(0, 1))
                if self._fetches.get(task.index, 0) < MAX_FETCHES:
                    self._fetch(station, task, tick)

    def _near(self) -> dict[int, list[tuple[int, int, Task]]]:
        """By arm, the cars that are near and come to pick: moves that each has left, the car, its task."""
        missions, ways = self._missions, self._ways
        coming = np.array(missions.cars_in(CarPhase.TO_PICK), dtype=np.int64)
        arms = missions.pick_of[coming]
        coming, arms = coming[arms >= 0], arms[arms >= 0]
        moves = ways.moves_each(ways.tails[coming], missions.stations.dock_states[arms])
        near: dict[int, list[tuple[int, int, Task]]] = {}
        for k in (moves <= N_MOVES_AHEAD).nonzero()[0].tolist():
            car = int(coming[k])
            task = missions.task_of[car]
            if task is not None and task.state is TaskState.ASSIGNED:
                near.setdefault(int(arms[k]), []).append((int(moves[k]), car, task))
        return near

    def _fetch(self, station: Station, task: Task, tick: int) -> None:
        if task.pick_slot is None:
            return
        self._fetches[task.index] = self._fetches.get(task.index, 0) + 1
        sighting = self._perception.find(task, station)
        if sighting.reason:
            return
        self._task[station.arm] = task
        self._log("fetched_ahead", task=task.order.name, station=station.name, car=f"car_{task.car}")
        self._arm_manager.fetch(
            FetchRequest(
                arm=station.arm,
                parcel=task.parcel,
                size_m=sighting.size_m,
                pick_pose=sighting.pose,
                pick_via=task.pick_slot,
                tray=self._tray(task),
            ),
            tick,
        )

    def _look_after(self, station: Station, at_dock: Sequence[Task]) -> None:
        """Put a parcel back that is not wanted: its task has ended, another car of this arm is there first, or no car
        can come because this one's slot is kept."""
        task = self._task[station.arm]
        ended = task.state not in (TaskState.READY, TaskState.ASSIGNED, TaskState.LOADING)
        other_tray = self._tray(task) != self._arm_manager.fetched_for(station.arm)
        if ended or other_tray or (at_dock and task not in at_dock) or self._keeps_others_out(station, task):
            self._log("put_back", task=task.order.name, station=station.name)
            self._arm_manager.put_back(station.arm)

    def _tray(self, task: Task) -> int:
        """Which kind of tray the car of a task has; of none, the first kind."""
        return 0 if task.car is None else int(self._tray_of[task.car])

    def _keeps_others_out(self, station: Station, task: Task) -> bool:
        """Whether no car can come to a full rack, and none comes for the parcel in the grip."""
        missions = self._missions
        if station.n_free or missions.bookings.cars(station.arm):
            return False
        return task.state is TaskState.READY or missions.is_held_back(task)
