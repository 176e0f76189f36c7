"""ParcelsCheck: each is in the world once, in one place, and that is where it is booked."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.run.events import Event
from fleet.run.view import RunView
from fleet.safety.breach import Breach, Invariant
from fleet.safety.faults import CarFaults
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState

UNSETTLED_S = 0.5
"""A parcel may be on its way between two places so long: let go of, it falls, and that it fell is noticed after [s]."""
SLOT_M, SLOT_LIFT_M = 0.05, 0.015
"""On a slot a parcel lies this close to the slot's middle, its lower side this close to the slot's surface [m]."""
TRAY_LOW_M, TRAY_HIGH_M = 0.02, 0.15
"""In a tray the middle of a parcel is this little below the floor, and this little above the walls [m]."""
_ANYWHERE, _SLOT, _SLOT_OR_GRIP, _TRAY = 0, 1, 2, 3
_BOOKED = {TaskState.READY: _SLOT_OR_GRIP, TaskState.ASSIGNED: _SLOT_OR_GRIP, TaskState.DELIVERED: _SLOT}
_ON_SLOT = (TaskState.READY, TaskState.ASSIGNED)
_FROM_SLOT = (*_ON_SLOT, TaskState.LOADING)
_MEASURED = (TaskState.CARRIED, TaskState.DELIVERED)
_IN_WORLD = (*_ON_SLOT, TaskState.LOADING, TaskState.CARRIED, TaskState.UNLOADING, TaskState.DELIVERED)


class ParcelsCheck:
    """Where parcels are, and where they are booked.

    A parcel that was dropped, lies in a car under a fault, or belongs to a task that has failed may lie anywhere; it is
    in the world once all the same.

    Args:
        run: The run; its events tell of dropped parcels.
        faults: Cars that may lose what they carry.
    """

    def __init__(self, run: RunView, faults: CarFaults) -> None:
        self._run = run
        self._faults = faults
        models = run.scene.cars
        trays = [(kind.tray_x_m, *kind.tray_size_m, kind.tray_floor_z_m) for kind in models.kinds]
        self._trays = np.array(trays)[models.kind_of]
        self._patience = round(UNSETTLED_S / run.tick_s)
        self._dropped: set[int] = set()
        self._ids = np.empty(0, dtype=np.int64)
        self._n_moves = -1
        self._kind = np.empty(0, dtype=np.int64)
        self._car = np.empty(0, dtype=np.int64)
        self._slot = np.empty((0, 3))
        self._size = np.empty((0, 3))
        self._astray = np.zeros(len(run.board.tasks), dtype=np.int64)
        run.events.subscribe(self._note)

    def look(self, poses: FloatArray, held: IntArray, ids: IntArray, parcels: FloatArray) -> Breach | None:
        """Find a parcel that is lost, or elsewhere, or in two places.

        Args:
            poses: True rear-axle poses x, y, yaw, shape (n_cars, 3).
            held: Parcel in each arm's grip, -1 for none, shape (n_arms,).
            ids: Ids of the parcels in the world, ascending, shape (p,).
            parcels: Their poses, shape (p, 7).
        """
        run = self._run
        if balance := run.inventory.balance():
            return self._breach(f"parcels {'lost' if balance > 0 else 'too many'}: {abs(balance)}", balance=balance)
        # New parcels come with a new array; what becomes of them is a move of their task.
        if ids is not self._ids or run.board.n_moves != self._n_moves:
            self._ids, self._n_moves = ids, run.board.n_moves
            self._read_books()
        row = _astray(
            poses,
            held,
            ids,
            parcels,
            (self._kind, self._car, self._slot, self._size),
            self._trays,
            self._faults.cars,
            self._astray,
            self._patience,
        )
        return None if row < 0 else self._misplaced(int(ids[row]), parcels[row], held)

    def audit(self) -> Breach | None:
        """Whether books and world have the same parcels, each once; goes through slots and open tasks."""
        run = self._run
        board, there = run.board, run.world.parcel_ids().tolist()
        if len(set(there)) != len(there):
            return self._breach(f"a parcel is in the world twice: {there}", ids=there)
        booked = [task for task in board.in_state(*_IN_WORLD) if self._is_in_world(task)]
        failed = {task.index for task in board.in_state(TaskState.FAILED)}
        missing = [task.order.name for task in booked if task.parcel not in there]
        if missing:
            return self._breach(f"booked, not in the world: {', '.join(missing)}", tasks=missing)
        known = failed | {task.parcel for task in booked}
        stray = [parcel for parcel in there if parcel not in known]
        if stray:
            return self._breach(f"in the world, not booked: parcels {stray}", parcels=stray)
        for task in booked:
            station, own = self._slot_by_books(task)
            content = None if own is None else station.contents[own]
            if own is not None and content != task.index:
                whose = "free" if content is None else f"that of {board.name_of(content)}"
                return self._breach(
                    f"{task.order.name} has slot {own} of {station.name}, which is {whose} by the station's books",
                    place=station.name,
                    task=task.order.name,
                )
        on_slots: Counter[int] = Counter()
        for station in run.stations:
            for slot, content in enumerate(station.contents):
                if content is None:
                    continue
                on_slots[content] += 1
                if on_slots[content] > 1:
                    name = board.name_of(content)
                    return self._breach(
                        f"{name} has two slots, one of them slot {slot} of {station.name}",
                        place=station.name,
                        task=name,
                    )
        return None

    def _read_books(self) -> None:
        """Note where each parcel in the world is booked."""
        more = len(self._run.board.tasks) - len(self._astray)
        if more:  # ordered while the run goes on
            self._astray = np.append(self._astray, np.zeros(more, dtype=np.int64))
        tasks = [self._run.board.tasks[parcel] for parcel in self._ids.tolist()]
        # What was dropped counts again when it was found where it is to be.
        self._dropped &= {task.index for task in tasks if task.state not in _MEASURED}
        self._kind = np.array([self._kind_of(task) for task in tasks], dtype=np.int64)
        self._car = np.array([-1 if task.car is None else task.car for task in tasks], dtype=np.int64)
        self._slot = np.array([self._slot_of(task) for task in tasks]).reshape(-1, 3)
        self._size = np.array([task.delivery.size_m for task in tasks]).reshape(-1, 3)

    def _kind_of(self, task: Task) -> int:
        if task.parcel in self._dropped:
            return _ANYWHERE
        if task.state is TaskState.CARRIED:
            return _TRAY if task.car is not None else _ANYWHERE
        return _BOOKED.get(task.state, _ANYWHERE)

    def _slot_of(self, task: Task) -> tuple[float, float, float]:
        stations = self._run.stations
        if task.state in _ON_SLOT and task.pick_slot is not None:
            x, y, z = stations.named(task.pick).place.slots[task.pick_slot]
        elif task.state is TaskState.DELIVERED and task.drop_slot is not None:
            x, y, z = stations.named(task.delivery.drop).place.slots[task.drop_slot]
        else:
            x = y = z = math.inf
        return float(x), float(y), float(z)

    def _slot_by_books(self, task: Task) -> tuple[Station, int | None]:
        """The slot that a task has by its own books, None for none, and its station."""
        stations = self._run.stations
        if task.state in _FROM_SLOT:
            return stations.named(task.pick), task.pick_slot
        return stations.named(task.delivery.drop), task.drop_slot

    @staticmethod
    def _is_in_world(task: Task) -> bool:
        return task.visit is None and (task.state not in _ON_SLOT or task.pick_slot is not None)

    def _misplaced(self, parcel: int, pose: FloatArray, held: IntArray) -> Breach:
        task = self._run.board.tasks[parcel]
        arms = [f"arm_{arm}" for arm in np.flatnonzero(held == parcel).tolist()]
        x, y, z = (round(float(value), 3) for value in pose[:3])
        by = f", held by {' and '.join(arms)}" if arms else ""
        cars = [f"car_{task.car}"] if task.car is not None else []
        return self._breach(
            f"{task.order.name} is booked as {task.state} and lies at ({x}, {y}, {z}) m{by}",
            robots=(*cars, *arms),
            place=task.delivery.drop if task.state is TaskState.DELIVERED else task.pick,
            task=task.order.name,
            pose=pose,
        )

    def _breach(self, words: str, *, robots: tuple[str, ...] = (), place: str = "", **values: object) -> Breach:
        return Breach(
            invariant=Invariant.PARCELS,
            words=words,
            valid="every parcel once, where it is booked",
            robots=robots,
            place=place,
            values=values,
        )

    def _note(self, event: Event) -> None:
        if event.kind == "parcel_dropped":
            self._dropped.add(self._run.board.named(str(event.facts["task"])).parcel)
        elif event.kind == "disturbance" and event.facts["disturbance"] == "grip_lost":
            arm = int(str(event.facts["target"]).removeprefix("arm_"))
            self._dropped.add(int(self._run.world.held()[arm]))
        else:
            return
        self._n_moves = -1


@njit(cache=True)
def _astray(
    cars: FloatArray,
    held: IntArray,
    ids: IntArray,
    poses: FloatArray,
    books: tuple[IntArray, IntArray, FloatArray, FloatArray],
    trays: FloatArray,
    excused: BoolArray,
    since: IntArray,
    patience: int,
) -> int:  # pragma: no cover - compiled
    """Row of the first parcel in two grips, or elsewhere for longer than `patience` ticks; -1 if there is none."""
    kind, carrier, slot, size = books
    for row in range(len(ids)):
        n_grips = 0
        for arm in range(len(held)):
            n_grips += held[arm] == ids[row]
        right = kind[row] == _ANYWHERE or (carrier[row] >= 0 and excused[carrier[row]])
        if not right and kind[row] == _TRAY:
            right = n_grips == 0 and _in_tray(poses[row], cars[carrier[row]], trays[carrier[row]])
        elif not right:
            right = (
                n_grips == 1 if n_grips and kind[row] == _SLOT_OR_GRIP else _on_slot(poses[row], slot[row], size[row])
            )
        since[ids[row]] = 0 if right else since[ids[row]] + 1
        if n_grips > 1 or since[ids[row]] > patience:
            return row
    return -1


@njit(cache=True)
def _in_tray(parcel: FloatArray, car: FloatArray, tray: FloatArray) -> bool:  # pragma: no cover - compiled
    ahead_m, length, width, wall, floor = tray[0], tray[1], tray[2], tray[3], tray[4]
    dx, dy = parcel[0] - car[0], parcel[1] - car[1]
    cos, sin = math.cos(car[2]), math.sin(car[2])
    along, across, up = cos * dx + sin * dy - ahead_m, cos * dy - sin * dx, parcel[2] - floor
    inside = abs(along) <= length / 2.0 and abs(across) <= width / 2.0
    return inside and -TRAY_LOW_M < up < wall + TRAY_HIGH_M


@njit(cache=True)
def _on_slot(parcel: FloatArray, slot: FloatArray, size: FloatArray) -> bool:  # pragma: no cover - compiled
    """Whether a box stands on a slot, however it is turned."""
    if math.hypot(parcel[0] - slot[0], parcel[1] - slot[1]) > SLOT_M:
        return False
    x, y, z, w = parcel[3], parcel[4], parcel[5], parcel[6]
    # The world's vertical in the frame of the box.
    up_x, up_y, up_z = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    half = (abs(up_x) * size[0] + abs(up_y) * size[1] + abs(up_z) * size[2]) / 2.0
    return abs(parcel[2] - half - slot[2]) <= SLOT_LIFT_M
