"""ParcelBook: which parcels there are, where each of them lies, and what has become of them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray, IntArray
from fleet.robots.spec import CarSpec
from fleet.tasks.order import Delivery
from fleet.world.protocol import ParcelBody, World
from maps.stations import StationPlace

REST_S = 0.5
"""A parcel that was let go belongs to where it lies when it has lain there for so long [s]."""
ROOM_M = 0.15
"""A parcel comes to a slot when no other parcel, and no tool, is nearer to it than this [m]."""
NOWHERE = -1
"""Place of a parcel that lies where it does not belong."""
_SLOT_M = 0.08
"""Half an edge of a slot [m]."""
_LOW_M, _HIGH_M = 0.03, 0.15
"""A parcel's bottom may be so far below or above the floor of a tray; half of the first for slots [m]."""

Int64Array = npt.NDArray[np.int64]


class Happened(Enum):
    """What can become of a parcel."""

    GRIPPED = auto()
    """An arm has it in its grip that never had it before."""
    LOADED = auto()
    """It has come into a tray, for the first time."""
    DELIVERED = auto()
    """It lies on a slot of a drop arm; it is taken away at once."""
    LOST = auto()
    """It lies where it does not belong; it is taken away at once."""


class ParcelEvent(NamedTuple):
    """Something that has happened to a parcel; -1 = no such robot had to do with it."""

    kind: Happened
    parcel: int
    arm: int
    """The arm that has it, or had it last."""
    car: int
    """The car that carries it, or carried it last."""


class ParcelPlaces(NamedTuple):
    """Where parcels may lie. Places are counted through: slots, then trays, then grips."""

    slots: FloatArray
    """Middles of the tops of slots, shape (n_slots, 3)."""
    arm_of: Int64Array
    """Arm of each slot, shape (n_slots,)."""
    is_drop: npt.NDArray[np.bool_]
    """Whether an arm sets parcels down on its slots, shape (n_arms,)."""
    n_cars: int
    tray: FloatArray
    """How far ahead of the rear axle the middle of a tray is, half its length and half its width, height of its
    floor [m], shape (4,)."""


def places_of(stations: Sequence[StationPlace], car: CarSpec, n_cars: int) -> ParcelPlaces:
    """The places of a site, and of so many cars."""
    length_m, width_m, _ = car.tray_size_m
    return ParcelPlaces(
        slots=np.concatenate([station.slots for station in stations]).reshape(-1, 3),
        arm_of=np.repeat(np.arange(len(stations)), [len(station.slots) for station in stations]),
        is_drop=np.array([station.kind == "drop" for station in stations]),
        n_cars=n_cars,
        tray=np.array([car.tray_x_m, length_m / 2, width_m / 2, car.tray_floor_z_m]),
    )


@dataclass(kw_only=True)
class _Known:
    """What is known of a parcel in the world."""

    order: Delivery
    place: int
    """Where it belongs now."""
    seen: int
    """Where it was seen last."""
    since_s: float = 0.0
    """How long it has been there [s]."""
    arms: tuple[int, ...] = ()
    """Arms that had it, the last one last."""
    car: int = -1
    """Car that carried it last."""


class ParcelBook:
    """The parcels of an episode.

    Parcels arrive in the order of a stream; one whose arm has no free slot waits until it has.

    Args:
        world: Where they are.
        places: Where they may lie.
        orders: All that arrive in the episode, ascending in release; an order's number is its parcel's.
        names: Names of the stations, by arm.
    """

    def __init__(self, world: World, places: ParcelPlaces, orders: Iterable[Delivery], names: Sequence[str]) -> None:
        self._world = world
        self._places = places
        self._due: list[deque[tuple[int, Delivery]]] = [deque() for _ in names]
        for number, order in enumerate(orders):
            self._due[names.index(order.pick)].append((number, order))
        self._known: dict[int, _Known] = {}

    def lie(self) -> tuple[IntArray, FloatArray, FloatArray, Int64Array]:
        """Of all parcels in the world: numbers (p,), poses (p, 7), edges [m] (p, 3), and where they belong (p,)."""
        ids = self._world.parcel_ids()
        known = [self._known[number] for number in ids.tolist()]
        sizes = np.array([one.order.size_m for one in known]).reshape(-1, 3)
        return ids, self._world.parcel_poses(), sizes, np.array([one.place for one in known], dtype=np.int64)

    def arrive(self, now_s: float, tips: FloatArray) -> None:
        """Put parcels that are due on free slots of their arms.

        Args:
            now_s: Time of the episode [s].
            tips: Where the arms' tools are, shape (n_arms, 3).
        """
        for arm, due in enumerate(self._due):
            for slot in np.flatnonzero(self._places.arm_of == arm).tolist():
                if not due or due[0][1].release_s > now_s:
                    break
                top = self._places.slots[slot]
                in_way = np.concatenate((self._world.parcel_poses()[:, :3], tips))
                if (np.linalg.norm(in_way - top, axis=1) < ROOM_M).any():
                    continue
                number, order = due.popleft()
                pose = np.array([*top, 0.0, 0.0, 0.0, 1.0])
                pose[2] += order.size_m[2] / 2
                self._world.add_parcel(ParcelBody(parcel=number, size_m=order.size_m, mass_kg=order.mass_kg, pose=pose))
                self._known[number] = _Known(order=order, place=slot, seen=slot)

    def look(self, step_s: float) -> list[ParcelEvent]:
        """Find out what has happened in a step of this length [s]; what is delivered or lost is taken away."""
        ids, poses, sizes, _ = self.lie()
        seen = np.empty(len(ids), dtype=np.int64)
        _locate(self._places, self._world.car_poses(), self._world.held(), ids, poses, sizes, seen)
        happened = []
        for number, at in zip(ids.tolist(), seen.tolist(), strict=True):
            known = self._known[number]
            known.since_s = known.since_s + step_s if at == known.seen else 0.0
            known.seen = at
            event = self._moved(number, known)
            if event is None:
                continue
            happened.append(event)
            if event.kind in (Happened.DELIVERED, Happened.LOST):
                self._world.remove_parcel(number)
                del self._known[number]
        return happened

    def _moved(self, number: int, known: _Known) -> ParcelEvent | None:
        """Take note of where a parcel is; what that is, if it is something new."""
        places, at = self._places, known.seen
        first_tray = len(places.slots)
        first_grip = first_tray + places.n_cars
        is_held = at >= first_grip
        if at == known.place or not (is_held or known.since_s > REST_S - 1e-9):
            return None
        before, known.place = known.place, at
        if is_held:
            arm = at - first_grip
            is_new = arm not in known.arms
            known.arms = (*(one for one in known.arms if one != arm), arm)
            return ParcelEvent(Happened.GRIPPED, number, arm, known.car) if is_new else None
        arm = known.arms[-1] if known.arms else -1
        if at >= first_tray:
            is_new, known.car = known.car < 0, at - first_tray
            return ParcelEvent(Happened.LOADED, number, arm, known.car) if is_new else None
        if at >= 0:
            is_drop = bool(places.is_drop[places.arm_of[at]])
            return ParcelEvent(Happened.DELIVERED, number, arm, known.car) if is_drop else None
        fell_off_car = first_tray <= before < first_grip
        return ParcelEvent(Happened.LOST, number, -1 if fell_off_car else arm, known.car if fell_off_car else -1)


@njit(cache=True)
def _locate(
    places: ParcelPlaces,
    cars: FloatArray,
    held: IntArray,
    ids: IntArray,
    poses: FloatArray,
    sizes: FloatArray,
    seen: Int64Array,
) -> None:  # pragma: no cover - compiled
    """Fill in the place of each parcel."""
    first_tray = len(places.slots)
    ahead_m, half_length, half_width, floor = places.tray
    for k in range(len(ids)):
        seen[k] = NOWHERE
        x, y, bottom = poses[k, 0], poses[k, 1], poses[k, 2] - sizes[k, 2] / 2.0
        for slot in range(len(places.slots)):
            sx, sy, top = places.slots[slot]
            if max(abs(x - sx), abs(y - sy)) <= _SLOT_M and abs(bottom - top) < _LOW_M:
                seen[k] = slot
        for car in range(len(cars)):
            dx, dy = x - cars[car, 0], y - cars[car, 1]
            cos, sin = math.cos(cars[car, 2]), math.sin(cars[car, 2])
            ahead, left = cos * dx + sin * dy - ahead_m, cos * dy - sin * dx
            if abs(ahead) <= half_length and abs(left) <= half_width and -_LOW_M < bottom - floor < _HIGH_M:
                seen[k] = first_tray + car
        for arm in range(len(held)):
            if held[arm] == ids[k]:
                seen[k] = first_tray + len(cars) + arm
