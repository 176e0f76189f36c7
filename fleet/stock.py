"""Stock: parcels enter and leave at rack slots, and what the books say is compared with the world."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fleet.robots.spec import CarSpec
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.world.protocol import FloatArray, ParcelBody, World

ON_SLOT_M = 0.05
"""A parcel on a slot lies within this of the slot's centre [m]."""
ON_SLOT_LIFT_M = 0.015
"""And its lower side this close to the slot's surface [m]."""
DROP_M = 0.001
"""A new parcel appears this far above its slot [m]."""

Log = Callable[..., None]


class Stock:
    """All parcels of a run.

    Args:
        board: The tasks; a task's index is its parcel's identity.
        stations: In the order of the arms.
        car: The car model, for its tray.
        world: Where parcels lie.
        log: Called as ``log(kind, **facts)`` when a parcel enters or leaves.
    """

    def __init__(self, board: TaskBoard, stations: list[Station], car: CarSpec, world: World, log: Log) -> None:
        self.entered_n = 0
        self.left_n = 0
        self._board = board
        self._stations = stations
        self._by_name = {station.name: station for station in stations}
        self._left_waiting = (0, 0)
        self._car = car
        self._world = world
        self._log = log

    def tick(self, now_s: float) -> bool:
        """Take out what is to be collected, and put the parcels of released orders on free pick slots.

        Returns:
            True when a task has become ready.
        """
        for station in self._stations:
            for slot in station.collect_due(now_s):
                self._collect(station, slot, now_s)
        if not self._board.count(TaskState.BACKLOG) or self._waiting() == self._left_waiting:
            return False
        filled = self._fill(now_s)
        self._left_waiting = self._waiting()
        return filled

    def balance(self) -> int:
        """Parcels that entered, less those that left, less those found in the world."""
        return self.entered_n - self.left_n - len(self._world.parcel_ids())

    def pose(self, task: Task) -> FloatArray:
        """Where a task's parcel is, shape (7,); it must be in the world."""
        return self._world.parcel_poses()[int(np.searchsorted(self._world.parcel_ids(), task.parcel))]

    def on_slot(self, task: Task, slot: int | None, station: Station) -> bool:
        """Whether a task's parcel stands on a slot."""
        if slot is None:
            return False
        x, y, z = station.place.slots[slot]
        pose = self.pose(task)
        lift_m = pose[2] - z - _half_height(pose, task.order.size_m)
        return bool(np.hypot(pose[0] - x, pose[1] - y) <= ON_SLOT_M and abs(lift_m) <= ON_SLOT_LIFT_M)

    def in_tray(self, task: Task, car: int) -> bool:
        """Whether a task's parcel lies in a car's tray."""
        return self._holds(car, self.pose(task))

    def tray_is_loaded(self, car: int) -> bool:
        """Whether any parcel lies in a car's tray."""
        return any(self._holds(car, pose) for pose in self._world.parcel_poses())

    def misplaced(self) -> list[str]:
        """One line for each parcel that is not where the books say."""
        there = set(self._world.parcel_ids().tolist())
        wrong = []
        for task in self._board.tasks:
            if task.state is TaskState.FAILED:
                continue  # it may lie anywhere, and the task's reason says where
            booked = task.state not in (TaskState.ORDERED, TaskState.BACKLOG, TaskState.COLLECTED)
            if booked != (task.parcel in there):
                wrong.append(f"{task.order.name}: booked as {task.state}, {'not ' if booked else ''}in the world")
            elif booked and not self._is_where_booked(task):
                x, y, z = self.pose(task)[:3]
                wrong.append(f"{task.order.name}: booked as {task.state}, lies at ({x:.2f}, {y:.2f}, {z:.2f})")
        return wrong

    def _waiting(self) -> tuple[int, int]:
        """Parcels that wait for a slot, and free pick slots: while these stay the same, there is nothing to fill."""
        free = sum(station.free_n for station in self._stations if station.place.kind == "pick")
        return self._board.count(TaskState.BACKLOG), free

    def _fill(self, now_s: float) -> bool:
        full: set[str] = set()
        filled = False
        for task in self._board.in_state(TaskState.BACKLOG):
            station = self._by_name[task.order.pick]
            slot = None if station.name in full else station.take_slot(task.index)
            if slot is None:
                full.add(station.name)
                continue
            task.pick_slot = slot
            x, y, z = station.place.slots[slot]
            size = task.order.size_m
            pose = np.array([x, y, z + size[2] / 2 + DROP_M, 0.0, 0.0, 0.0, 1.0])
            self._world.add_parcel(ParcelBody(parcel=task.parcel, size_m=size, mass_kg=task.order.mass_kg, pose=pose))
            self.entered_n += 1
            self._log("parcel_entered", task=task.order.name, station=station.name, slot=slot)
            self._board.move(task, TaskState.READY, now_s, f"slot {slot} of {station.name} was free")
            filled = True
        return filled

    def _collect(self, station: Station, slot: int, now_s: float) -> None:
        content = station.contents[slot]
        task = self._board.tasks[content] if content is not None else None
        if task is None or task.state is not TaskState.DELIVERED:
            return
        self._world.remove_parcel(task.parcel)
        self.left_n += 1
        station.free_slot(slot)
        self._log("parcel_left", task=task.order.name, station=station.name, slot=slot)
        self._board.move(task, TaskState.COLLECTED, now_s, "collected from its slot")

    def _is_where_booked(self, task: Task) -> bool:
        if task.state in (TaskState.READY, TaskState.ASSIGNED):
            return self.on_slot(task, task.pick_slot, self._by_name[task.order.pick])
        if task.state is TaskState.DELIVERED:
            return self.on_slot(task, task.drop_slot, self._by_name[task.order.drop])
        if task.state is TaskState.CARRIED:
            return task.car is not None and self.in_tray(task, task.car)
        return True  # an arm is at work on it

    def _holds(self, car: int, pose: FloatArray) -> bool:
        x, y, yaw = self._world.car_poses()[car]
        dx, dy = pose[0] - x, pose[1] - y
        ahead = np.cos(yaw) * dx + np.sin(yaw) * dy - self._car.tray_x_m
        left = -np.sin(yaw) * dx + np.cos(yaw) * dy
        length, width, _ = self._car.tray_size_m
        inside = abs(ahead) <= length / 2 and abs(left) <= width / 2
        return bool(inside and pose[2] > self._car.tray_floor_z_m - 0.02)


def _half_height(pose: FloatArray, size_m: tuple[float, float, float]) -> float:
    """Half the vertical extent of a box in any orientation [m]."""
    x, y, z, w = pose[3:]
    up = np.abs([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    return float(up @ np.asarray(size_m)) / 2
