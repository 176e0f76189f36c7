"""Stock: parcels enter and leave at rack slots, and what the books say is compared with the world."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from fleet.robots.spec import CarSpec
from fleet.stations.station import Station
from fleet.tasks.backlog import Backlog
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.tasks.order import MAX_EDGE_M
from fleet.tasks.reasons import ReasonBook, TaskReason
from fleet.world.protocol import FloatArray, ParcelBody, World

ON_SLOT_M = 0.05
"""A parcel on a slot lies within this of the slot's centre [m]."""
ON_SLOT_LIFT_M = 0.015
"""And its lower side this close to the slot's surface [m]."""
DROP_M = 0.001
"""A new parcel appears this far above its slot [m]."""
ASKEW_M = 0.015
"""Parcels that are put down anyhow lie within this of the middle of their slot, along x and along y [m]."""

Log = Callable[..., None]
_NOT_IN_WORLD = (TaskState.ORDERED, TaskState.BACKLOG, TaskState.COLLECTED, TaskState.CANCELLED)


class Inventory:
    """All parcels of a run.

    Args:
        board: The tasks; a task's index is its parcel's identity.
        stations: In the order of the arms.
        car: The car model, for its tray.
        world: Where parcels lie.
        log: Called as ``log(kind, **facts)`` when a parcel enters or leaves.
        backlog: Tells which tasks wait for others.
        reasons: Told why a task waits.
        source_cost: Called as ``source_cost(pick, task)``: what it costs to bring a task's parcel from a pick station.
        turn_s: Called as ``turn_s(task)``: when a task is planned to be picked [s], inf = that is not planned.
        askew: Draws how parcels are put on their slots; None = exactly in the middle and straight.
    """

    def __init__(
        self,
        board: TaskBoard,
        stations: list[Station],
        car: CarSpec,
        world: World,
        log: Log,
        backlog: Backlog,
        reasons: ReasonBook,
        source_cost: Callable[[str, Task], float],
        turn_s: Callable[[Task], float],
        askew: np.random.Generator | None,
    ) -> None:
        self.entered_n = 0
        self.left_n = 0
        self._board = board
        self._stations = stations
        self._by_name = {station.name: station for station in stations}
        self._left_waiting = (0, 0, 0)
        self._car = car
        self._world = world
        self._log = log
        self._backlog = backlog
        self._reasons = reasons
        self._source_cost = source_cost
        self._turn_s = turn_s
        self._askew = askew

    def tick(self, now_s: float) -> bool:
        """Take out what is to be collected, and put the parcels of released orders on free pick slots.

        Returns:
            True when a task has become ready.
        """
        for station in self._stations:
            for slot in station.collect_due(now_s):
                self._collect(station, slot, now_s)
        if not self._board.count(TaskState.BACKLOG):
            return False
        waiting = self._waiting()
        if waiting == self._left_waiting:
            return False
        # As it was before: what fails now may let others fail in the next round.
        self._left_waiting = waiting
        return self._fill(now_s)

    def withdraw(self, task: Task, now_s: float, reason: str) -> None:
        """Cancel a task that has no parcel in a car; a parcel on its slot leaves the warehouse."""
        if task.pick_slot is not None:
            if task.state is not TaskState.BACKLOG:
                self._world.remove_parcel(task.parcel)
                self.left_n += 1
                self._log("parcel_left", task=task.order.name, station=task.pick, slot=task.pick_slot)
            self._by_name[task.pick].free_slot(task.pick_slot)
        self._board.move(task, TaskState.CANCELLED, now_s, reason)

    def vacate(self, task: Task) -> None:
        """Give back the slot that a task's parcel has left, to the next leg of its order that begins there, if any."""
        if task.pick_slot is None:
            return
        station = self._by_name[task.pick]
        station.free_slot(task.pick_slot)
        for leg in self._board.legs_after(task):
            if leg.pick == task.pick and leg.pick_slot is None and leg.state is TaskState.BACKLOG:
                leg.pick_slot = station.take_slot(leg.index)
                return

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
        return self._holds(car, self.pose(task))

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
            booked = task.state not in _NOT_IN_WORLD
            if booked != (task.parcel in there):
                wrong.append(f"{task.order.name}: booked as {task.state}, {'not ' if booked else ''}in the world")
            elif booked and not self._is_where_booked(task):
                x, y, z = self.pose(task)[:3]
                wrong.append(f"{task.order.name}: booked as {task.state}, lies at ({x:.2f}, {y:.2f}, {z:.2f})")
        return wrong

    def _waiting(self) -> tuple[int, int, int]:
        """Released tasks, free pick slots, and tasks that nobody has to wait for any more: while these stay the same,
        there is nothing to fill."""
        free = sum(station.free_n for station in self._stations if station.place.kind == "pick")
        return self._board.released_n, free, self._board.closed_n

    def _fill(self, now_s: float) -> bool:
        """Put parcels on free pick slots: the most urgent class first, then as planned, then first come first.

        An order of several legs begins when it can have a slot of each of its stations at once, and the slots that are
        free are kept for it until then: if its car had to wait for a slot between two legs, it might wait for parcels
        that wait for this very car.
        """
        filled = False
        kept: Counter[str] = Counter()
        backlog = self._board.in_state(TaskState.BACKLOG)
        for task in sorted(backlog, key=lambda task: (task.order.priority.rank, self._turn_s(task))):
            if task.visit is not None:
                continue
            if not self._backlog.may_begin(task, now_s):
                if task.state is TaskState.FAILED and task.pick_slot is not None:
                    self._by_name[task.pick].free_slot(task.pick_slot)
            elif task.pick_slot is not None or self._take_slots(task, kept, now_s):
                self._enter(task, now_s)
                filled = True
        return filled

    def _take_slots(self, task: Task, kept: Counter[str], now_s: float) -> bool:
        """Take a slot for a task, and one of each other station that its order needs; False if they are not free."""
        legs = self._board.legs_after(task)
        free = [name for name in task.delivery.picks if self._by_name[name].free_n > kept[name]]
        others = {leg.pick: leg for leg in reversed(legs) if leg.pick != task.pick}
        if not free or any(self._by_name[name].free_n <= kept[name] for name in others):
            if legs:
                kept.update((task.pick, *others))
                cause = f"not every one of {', '.join((task.pick, *sorted(others)))} has a free slot for its order"
            else:
                cause = f"no slot of {' and '.join(task.delivery.picks)} is free"
            self._reasons.note(task, TaskReason.WAITS_FOR_SLOT, cause, now_s)
            return False
        # The cheapest source; of equal ones, the first that was named.
        task.pick = free[0] if len(free) == 1 else min(free, key=lambda name: self._source_cost(name, task))
        for leg in (task, *others.values()):
            leg.pick_slot = self._by_name[leg.pick].take_slot(leg.index)
        return True

    def _enter(self, task: Task, now_s: float) -> None:
        station, slot = self._by_name[task.pick], task.pick_slot
        if slot is None:
            raise AssertionError("a task that enters has a slot")
        x, y, z = station.place.slots[slot]
        size = task.delivery.size_m
        dx, dy, half_yaw = self._placing()
        pose = np.array([x + dx, y + dy, z + size[2] / 2 + DROP_M, 0.0, 0.0, np.sin(half_yaw), np.cos(half_yaw)])
        self._world.add_parcel(ParcelBody(parcel=task.parcel, size_m=size, mass_kg=task.delivery.mass_kg, pose=pose))
        self.entered_n += 1
        self._log("parcel_entered", task=task.order.name, station=station.name, slot=slot)
        self._board.move(task, TaskState.READY, now_s, f"slot {slot} of {station.name} was free")

    def _placing(self) -> tuple[float, float, float]:
        """How a parcel is put on its slot: beside the middle along x and y [m], and half its turn [rad]."""
        if self._askew is None:
            return 0.0, 0.0, 0.0
        dx, dy = self._askew.uniform(-ASKEW_M, ASKEW_M, 2).tolist()
        return dx, dy, float(self._askew.uniform(-np.pi / 2, np.pi / 2))

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
            fetched = bool(np.any(self._world.held() == task.parcel))
            return fetched or self.on_slot(task, task.pick_slot, self._by_name[task.pick])
        if task.state is TaskState.DELIVERED:
            return self.on_slot(task, task.drop_slot, self._by_name[task.delivery.drop])
        if task.state is TaskState.CARRIED:
            return task.car is not None and self.in_tray(task, task.car)
        return True  # an arm is at work on it

    def _holds(self, car: int, pose: FloatArray) -> bool:
        x, y, yaw = self._world.car_poses()[car]
        dx, dy = pose[0] - x, pose[1] - y
        ahead = np.cos(yaw) * dx + np.sin(yaw) * dy - self._car.tray_x_m
        left = -np.sin(yaw) * dx + np.cos(yaw) * dy
        length, width, height = self._car.tray_size_m
        inside = abs(ahead) <= length / 2 and abs(left) <= width / 2
        # A parcel may rest on others' edges or on the rim, but one that is still in the air over the tray is not in it.
        up = pose[2] - self._car.tray_floor_z_m
        return bool(inside and -0.02 < up < height + MAX_EDGE_M)


def _half_height(pose: FloatArray, size_m: tuple[float, float, float]) -> float:
    """Half the vertical extent of a box in any orientation [m]."""
    x, y, z, w = pose[3:]
    up = np.abs([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    return float(up @ np.asarray(size_m)) / 2
