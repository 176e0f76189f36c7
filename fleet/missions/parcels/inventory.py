"""Stock: parcels enter and leave at rack slots, and what the books say is compared with the world."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.cars.models import CarModels
from fleet.stations.station import Station
from fleet.stations.stations import Stations
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.tasks.order import MAX_EDGE_M
from fleet.world.protocol import ParcelBody, World

ON_SLOT_M = 0.05
"""A parcel on a slot lies within this of the slot's centre [m]."""
ON_SLOT_LIFT_M = 0.015
"""And its lower side this close to the slot's surface [m]."""
DROP_M = 0.001
"""A new parcel appears this far above its slot [m]."""
ASKEW_M = 0.015
"""Parcels that are put down anyhow lie within this of the middle of their slot, along x and along y [m]."""

Log = Callable[..., None]
_MAY_COME = (TaskState.READY, TaskState.ASSIGNED)
_NOT_IN_WORLD = (TaskState.ORDERED, TaskState.BACKLOG, TaskState.COLLECTED, TaskState.CANCELLED)


class Inventory:
    """All parcels of a run.

    Args:
        board: The tasks; a task's index is its parcel's identity.
        stations: The stations.
        models: Models of the cars, for their trays.
        world: Where parcels lie.
        log: Called as ``log(kind, **facts)`` when a parcel enters or leaves.
        collect_after_s: Time a delivered parcel stays on its slot [s].
        askew: Draws how parcels are put on their slots; None = exactly in the middle and straight.
    """

    def __init__(
        self,
        board: TaskBoard,
        stations: Stations,
        models: CarModels,
        world: World,
        log: Log,
        collect_after_s: float,
        askew: np.random.Generator | None,
    ) -> None:
        self.n_entered = 0
        self.n_left = 0
        self._board = board
        self._stations = stations
        self._models = models
        self._world = world
        self._log = log
        self._collect_after_s = collect_after_s
        self._askew = askew
        self._next_collect_s = np.inf

    def collect_later(self, station: Station, slot: int, now_s: float) -> None:
        """Note that the parcel on a slot has been delivered, and leaves after a while."""
        leaves_s = now_s + self._collect_after_s
        station.collect_at(leaves_s, slot)
        self._next_collect_s = min(self._next_collect_s, leaves_s)

    def collect(self, now_s: float) -> None:
        """Take out what is to be collected."""
        if now_s < self._next_collect_s:
            return
        for station in self._stations:
            for slot in station.collect_due(now_s):
                self._collect(station, slot, now_s)
        due_s = (station.next_collect_s for station in self._stations)
        self._next_collect_s = min((time_s for time_s in due_s if time_s is not None), default=np.inf)

    def enter(self, task: Task, now_s: float) -> None:
        """Put the parcel of a task on the slot that it has."""
        station, slot = self._stations.named(task.pick), task.pick_slot
        if slot is None:
            raise AssertionError("a task that enters has a slot")
        x, y, z = station.place.slots[slot]
        size = task.delivery.size_m
        dx, dy, half_yaw = self._placing()
        pose = np.array([x + dx, y + dy, z + size[2] / 2 + DROP_M, 0.0, 0.0, np.sin(half_yaw), np.cos(half_yaw)])
        self._world.add_parcel(ParcelBody(parcel=task.parcel, size_m=size, mass_kg=task.delivery.mass_kg, pose=pose))
        self.n_entered += 1
        self._log("parcel_entered", task=task.order.name, station=station.name, slot=slot)

    def enter_tray(self, task: Task, car: int, lying: FloatArray) -> None:
        """Put the parcel of a task into a car's tray: the run begins with it there.

        Args:
            task: Whose parcel it is.
            car: Whose tray it is.
            lying: Ahead of the tray's middle, to the left of it [m] and turned from straight ahead [rad].
        """
        x, y, yaw = self._world.car_poses()[car].tolist()
        model, size = self._models[car], task.delivery.size_m
        ahead_m, z = model.tray_x_m + lying[0], model.tray_floor_z_m + size[2] / 2 + DROP_M
        cos, sin, half_yaw = np.cos(yaw), np.sin(yaw), (yaw + lying[2]) / 2
        place = x + ahead_m * cos - lying[1] * sin, y + ahead_m * sin + lying[1] * cos, z
        pose = np.array([*place, 0.0, 0.0, np.sin(half_yaw), np.cos(half_yaw)])
        self._world.add_parcel(ParcelBody(parcel=task.parcel, size_m=size, mass_kg=task.delivery.mass_kg, pose=pose))
        self.n_entered += 1
        self._log("parcel_entered", task=task.order.name, car=f"car_{car}")

    def withdraw(self, task: Task, state: TaskState, now_s: float, reason: str) -> None:
        """End a task that has no parcel in a car, as cancelled or failed; a parcel on its slot leaves the warehouse."""
        if task.pick_slot is not None:
            self._take_out(task, self._stations.named(task.pick), task.pick_slot)
        self._board.move(task, state, now_s, reason)

    def take_back(self, task: Task) -> None:
        """Take a parcel that no car comes for from its slot; it enters anew when one does."""
        if task.pick_slot is None:
            raise AssertionError("a parcel that is taken back has a slot")
        self._take_out(task, self._stations.named(task.pick), task.pick_slot)
        task.pick_slot = None

    def empty_tray(self, car: int) -> None:
        """Take what lies in a car's tray out of the warehouse; whose tasks it was has failed."""
        for parcel in self._world.parcel_ids().tolist():
            task = self._board.tasks[parcel]
            if task.state is TaskState.FAILED and self.in_tray(task, car):
                self._world.remove_parcel(task.parcel)
                self.n_left += 1
                self._log("parcel_left", task=task.order.name, car=f"car_{car}")

    def vacate(self, task: Task) -> None:
        """Give back the slot that a task's parcel has left."""
        if task.pick_slot is not None:
            self._stations.named(task.pick).free_slot(task.pick_slot)

    def in_a_grip(self, task: Task) -> bool:
        """Whether an arm holds a task's parcel."""
        return bool(np.any(self._world.held() == task.parcel))

    def balance(self) -> int:
        """Parcels that entered, less those that left, less those found in the world."""
        return self.n_entered - self.n_left - len(self._world.parcel_ids())

    def in_world(self, task: Task) -> bool:
        """Whether a task's parcel is in the world; one in the tray of a car that was towed has left it."""
        return bool((self._world.parcel_ids() == task.parcel).any())

    def pose(self, task: Task) -> FloatArray:
        """Where a task's parcel is, shape (7,); it must be in the world."""
        return self._world.parcel_poses()[int(np.searchsorted(self._world.parcel_ids(), task.parcel))]

    def on_slot(self, task: Task, slot: int | None, station: Station) -> bool:
        """Whether a task's parcel stands on a slot."""
        if slot is None or not self.in_world(task):
            return False
        x, y, z = station.place.slots[slot]
        pose = self.pose(task)
        lift_m = pose[2] - z - _half_height(pose, task.delivery.size_m)
        return bool(np.hypot(pose[0] - x, pose[1] - y) <= ON_SLOT_M and abs(lift_m) <= ON_SLOT_LIFT_M)

    def obstructs(self, task: Task, slot: int, station: Station) -> bool:
        """Whether a task's parcel lies on or over a slot, or so near that another one could not stand there."""
        x, y, z = station.place.slots[slot]
        pose = self.pose(task)
        near_m = (MAX_EDGE_M + float(np.linalg.norm(task.delivery.size_m))) / 2
        return bool(np.hypot(pose[0] - x, pose[1] - y) <= near_m and pose[2] > z)

    def in_tray(self, task: Task, car: int) -> bool:
        """Whether a task's parcel lies in a car's tray."""
        return self.in_world(task) and self._holds(car, self.pose(task))

    def free_place(self, car: int) -> tuple[float, float]:
        """The place in a car's tray that is farthest from what lies there; of equals the first.

        Returns:
            Ahead of the tray's centre and to the left of it [m].
        """
        places = self._models[car].tray_places
        if len(places) == 1:
            return places[0]
        lying = [self._in_tray_at(car, pose)[:2] for pose in self._world.parcel_poses() if self._holds(car, pose)]
        away = [min((float(np.hypot(ahead - x, left - y)) for x, y in lying), default=np.inf) for ahead, left in places]
        return places[int(np.argmax(away))]

    def tray_is_loaded(self, car: int) -> bool:
        """Whether any parcel lies in a car's tray."""
        return any(self._holds(car, pose) for pose in self._world.parcel_poses())

    def misplaced(self) -> list[str]:
        """One line for each parcel that is not where the books say."""
        there = set(self._world.parcel_ids().tolist())
        wrong = []
        for task in self._board.tasks:
            if task.state is TaskState.FAILED or task.visit is not None:
                continue  # the parcel may lie anywhere, and the task's reason says where
            booked = task.state not in _NOT_IN_WORLD and (task.state not in _MAY_COME or task.pick_slot is not None)
            if booked != (task.parcel in there):
                wrong.append(f"{task.order.name}: booked as {task.state}, {'not ' if booked else ''}in the world")
            elif booked and not self._is_where_booked(task):
                x, y, z = self.pose(task)[:3]
                wrong.append(f"{task.order.name}: booked as {task.state}, lies at ({x:.2f}, {y:.2f}, {z:.2f})")
        return wrong

    def _placing(self) -> tuple[float, float, float]:
        """How a parcel is put on its slot: beside the middle along x and y [m], and half its turn [rad]."""
        if self._askew is None:
            return 0.0, 0.0, 0.0
        dx, dy = self._askew.uniform(-ASKEW_M, ASKEW_M, 2).tolist()
        return dx, dy, float(self._askew.uniform(-np.pi / 2, np.pi / 2))

    def _take_out(self, task: Task, station: Station, slot: int) -> None:
        self._world.remove_parcel(task.parcel)
        self.n_left += 1
        station.free_slot(slot)
        self._log("parcel_left", task=task.order.name, station=station.name, slot=slot)

    def _collect(self, station: Station, slot: int, now_s: float) -> None:
        content = station.contents[slot]
        task = self._board.tasks[content] if content is not None else None
        if task is None or task.state is not TaskState.DELIVERED:
            return
        self._take_out(task, station, slot)
        self._board.move(task, TaskState.COLLECTED, now_s, "collected from its slot")

    def _is_where_booked(self, task: Task) -> bool:
        if task.state in (TaskState.READY, TaskState.ASSIGNED):
            return self.in_a_grip(task) or self.on_slot(task, task.pick_slot, self._stations.named(task.pick))
        if task.state is TaskState.DELIVERED:
            return self.on_slot(task, task.drop_slot, self._stations.named(task.delivery.drop))
        if task.state is TaskState.CARRIED:
            return task.car is not None and self.in_tray(task, task.car)
        return True  # an arm is at work on it

    def _holds(self, car: int, pose: FloatArray) -> bool:
        ahead, left = self._in_tray_at(car, pose)
        model = self._models[car]
        length, width, height = model.tray_size_m
        inside = abs(ahead) <= length / 2 and abs(left) <= width / 2
        # A parcel may rest on others' edges or on the rim, but one that is still in the air over the tray is not in it.
        up = pose[2] - model.tray_floor_z_m
        return bool(inside and -0.02 < up < height + MAX_EDGE_M)

    def _in_tray_at(self, car: int, pose: FloatArray) -> tuple[float, float]:
        """Where something is, ahead of the centre of a car's tray and to the left of it [m]."""
        x, y, yaw = self._world.car_poses()[car]
        dx, dy = pose[0] - x, pose[1] - y
        ahead = np.cos(yaw) * dx + np.sin(yaw) * dy - self._models[car].tray_x_m
        return float(ahead), float(-np.sin(yaw) * dx + np.cos(yaw) * dy)


def _half_height(pose: FloatArray, size_m: tuple[float, float, float]) -> float:
    """Half the vertical extent of a box in any orientation [m]."""
    x, y, z, w = pose[3:]
    up = np.abs([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    return float(up @ np.asarray(size_m)) / 2
