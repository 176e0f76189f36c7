"""Transfers: an arm is asked to move a task's parcel between a rack and a car, and where it lies is looked up first."""

from __future__ import annotations

from fleet.arrays import IntArray
from fleet.missions.parcels.inventory import Inventory
from fleet.missions.parcels.perception import PoseSource
from fleet.stations.arms.arm_manager import ArmManager
from fleet.stations.arms.transfer import LOOSE, TRAY, TransferRequest
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.traffic.drivers import Driver
from fleet.world.protocol import World

MAX_ATTEMPTS = 3
"""Transfers tried for one errand before its task fails."""


class Transfers:
    """Requests for transfers.

    Args:
        inventory: Tells where parcels really are.
        perception: Tells the arms where parcels lie.
        arm_manager: Arm planning and playback.
        driver: Tells where cars are believed to stand.
        world: Tells what arms hold.
        tray_of: Which kind of tray each car has, shape (n_cars,).
    """

    def __init__(
        self,
        inventory: Inventory,
        perception: PoseSource,
        arm_manager: ArmManager,
        driver: Driver,
        world: World,
        tray_of: IntArray,
    ) -> None:
        self.arm_manager = arm_manager
        self.inventory = inventory
        self._perception = perception
        self._driver = driver
        self._world = world
        self._tray_of = tray_of
        self._attempts: dict[int, int] = {}

    def tray_of(self, car: int) -> int:
        """Which kind of tray a car has."""
        return int(self._tray_of[car])

    def may_repeat(self, task: Task) -> bool:
        """Whether another transfer may be tried for the present errand of a task."""
        return self._attempts[task.index] < MAX_ATTEMPTS

    def succeed(self, task: Task) -> None:
        """The present errand of a task is done; the next one may be tried as often."""
        self._attempts[task.index] = 0

    def request(self, station: Station, task: Task, car: int, tick: int) -> None:
        """Ask the arm of a station to load or unload a car that stands at its dock."""
        loading = task.state is TaskState.LOADING
        slot = task.pick_slot if loading else task.drop_slot
        if slot is None:
            raise AssertionError("a task in service has a slot")
        attempt = self._attempts[task.index] = self._attempts.get(task.index, 0) + 1
        pick_via = slot if loading else TRAY
        at_source = self.inventory.on_slot(task, slot, station) if loading else self.inventory.in_tray(task, car)
        fetched = bool(self._world.held()[station.arm] == task.parcel)
        # What the usual way did not get twice is gripped as it lies, on whatever face.
        if not fetched and (not at_source or attempt == MAX_ATTEMPTS):
            pick_via = LOOSE
        sighting = self._perception.find(task, station)
        if sighting.reason:
            self.arm_manager.refuse(station.arm, task.parcel, sighting.reason, tick)
            return
        self.arm_manager.submit(
            TransferRequest(
                arm=station.arm,
                parcel=task.parcel,
                size_m=sighting.size_m,
                pick_pose=sighting.pose,
                pick_via=pick_via,
                place_via=TRAY if loading else slot,
                car_pose=self._driver.estimate[car].copy(),
                tray=self.tray_of(car),
                tray_at_m=self.inventory.free_place(car) if loading else (0.0, 0.0),
            ),
            tick,
        )
