"""Contacts: judges after every physics step what robots touch, and counts every touch once.

What counts as a robot contact: two cars; an arm (its tool and the parcel it holds included) and a car, unless the touch
lies inside the tray of the car it serves; two arms, parcels they hold included. What counts as a static contact: a car
against a wall, shelf, pedestal or obstacle; an arm against those or the floor; a held parcel against a wall, shelf or
obstacle; a car against a pod that it does not carry; a pod that is carried, for its car, against anything but the plate
it stands on.

What never counts: wheels on the floor; a parcel in a tray or on its slot, whoever put it there; a parcel that nobody
holds; an arm against itself, which planning keeps apart.

A touch is a contact point that lies inside both bodies (distance < 0) or carries force. It lasts until there was none
for a quarter of a second, so that a rattle is one touch.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fleet.arrays import IntArray
from fleet.robots.angle import rotation
from fleet.robots.cars.models import CarModels
from fleet.world.bullet.engine.client import Client
from fleet.world.protocol import Contacts

_PAUSE_S = 0.25
# Contact points lie up to the solver's slop beside the surface.
_SLOP_M = 0.002


class ContactMonitor:
    """The touches of one world.

    Cars ask the engine only about bodies that are near them: the caller names the pairs that can touch within the tick.
    An arm that rests with nothing near it is not asked about either, once it was found to touch nothing; another arm
    that comes near asks for both.

    Args:
        client: Connection.
        models: Models of the cars.
        cars: Bodies of the cars.
        arms: Bodies of the arms.
        substep_s: Length of a physics step [s].
    """

    def __init__(self, client: Client, models: CarModels, cars: list[int], arms: list[int], substep_s: float) -> None:
        self._client = client
        self._arms = {body: index for index, body in enumerate(arms)}
        self._pause = max(1, round(_PAUSE_S / substep_s))
        self._step = 0
        self._last: dict[tuple[int, int], int] = {}
        self.counts = Contacts()
        self.change_cars(cars, models)
        self.ghosts: dict[int, int] = {}
        """Number in the fleet of each car of another world, by its body."""
        self.numbers: list[int] = []
        """The same of this world's cars where there are ghosts; the world of the lower number counts a touch."""
        self.of_arms: IntArray = np.zeros(len(arms), dtype=np.int64)
        """Contacts of each arm so far, shape (n_arms,)."""
        self.fixed: set[int] = set()
        """Bodies of walls, shelves and obstacles."""
        self.pedestals: set[int] = set()
        self.floor = -1
        self.serving: IntArray = np.full(len(arms), -1, dtype=np.int64)
        """Car whose tray each arm may touch, -1 for none, shape (n_arms,)."""
        self._free = [False] * len(arms)
        self.touched: list[dict[int, set[int]]] = [{} for _ in arms]
        """Parcels that the links of each arm touch: ``touched[arm][link]``."""

    def change_cars(self, bodies: list[int], models: CarModels) -> None:
        """Count anew for other cars."""
        self._cars = {body: index for index, body in enumerate(bodies)}
        self._specs = {body: models[index] for index, body in enumerate(bodies)}
        self.of_cars: IntArray = np.zeros(len(bodies), dtype=np.int64)
        """Contacts of each car so far, shape (n_cars,)."""

    def observe(
        self,
        watched: list[bool],
        near: list[tuple[int, int]],
        held: list[tuple[int, int]],
        parcels: dict[int, int],
    ) -> None:
        """Take in the contacts of the physics step that was just made.

        Args:
            watched: Whether each arm moves, holds something or has a car near it.
            near: Pairs of bodies that could touch, a car first.
            held: Arm index and body of every held parcel.
            parcels: Parcel id of every parcel's body.
        """
        self._step += 1
        ask = self._client.getContactPoints
        for body, arm in self._arms.items():
            if self._free[arm] and not watched[arm]:
                continue
            links = self.touched[arm]
            if links:
                links.clear()
            points = ask(body)
            self._free[arm] = not points
            for point in points:
                if _touches(point):
                    self._arm(arm, body, point, parcels)
        for arm, body in held:
            for point in ask(body):
                if _touches(point):
                    self._load(arm, body, point)
        for car, other in near:
            if any(_touches(point) for point in ask(car, other)):
                self._touch(car, other, robot=other in self._cars or other in self.ghosts)

    def observe_pod(self, car: int, pod: int) -> None:
        """Take in what a car touches of a pod that stands near it; both are bodies."""
        if any(_touches(point) for point in self._client.getContactPoints(car, pod)):
            self._touch(car, pod, robot=False)

    def observe_load(self, car: int, pod: int, *, plate: int, lifted: bool) -> None:
        """Take in what the pod on a car's plate touches, which is a touch of the car.

        Args:
            car: Body of the car.
            pod: Body of the pod.
            plate: Link of the car on which it stands.
            lifted: Whether it must not touch the floor.
        """
        for point in self._client.getContactPoints(pod):
            other = point[2]
            own = other == car
            if not _touches(point) or (own and point[4] == plate) or (other == self.floor and not lifted):
                continue
            self._touch(car, pod if own else other, robot=other in self._cars or other in self._arms)

    def look_again(self) -> None:
        """Ask about every arm at the next step, since fixed things came or went."""
        self._free = [False] * len(self._free)

    def memory(self) -> Any:
        """State of the counting."""
        counts = self.counts.robot, self.counts.static, self.of_cars.copy(), self.of_arms.copy()
        return self._step, dict(self._last), counts, self.serving.copy()

    def recall(self, memory: Any) -> None:
        """Return to `memory`."""
        self._step, last, (robot, static, of_cars, of_arms), serving = memory
        self._last = dict(last)
        self.counts = Contacts(robot=robot, static=static)
        self.of_cars[:], self.of_arms[:] = of_cars, of_arms
        self.serving[:] = serving
        self.look_again()

    def _arm(self, arm: int, body: int, point: Any, parcels: dict[int, int]) -> None:
        other = point[2]
        if other in parcels:
            self.touched[arm].setdefault(point[3], set()).add(parcels[other])
        elif other in self._cars:
            if not self._in_tray(arm, other, point):
                self._touch(body, other, robot=True)
        elif other in self._arms:
            if other != body:
                self._touch(body, other, robot=True)
        elif other in self.fixed or other in self.pedestals or other == self.floor:
            self._touch(body, other, robot=False)

    def _load(self, arm: int, body: int, point: Any) -> None:
        """Judge a point of a held parcel, which is a part of the arm that holds it; its touches are its own."""
        other = point[2]
        if other in self._cars:
            if not self._in_tray(arm, other, point):
                self._touch(body, other, robot=True, holder=arm)
        elif other in self._arms:
            if self._arms[other] != arm:
                self._touch(body, other, robot=True, holder=arm)
        elif other in self.fixed:
            self._touch(body, other, robot=False, holder=arm)

    def _touch(self, body: int, other: int, *, robot: bool, holder: int = -1) -> None:
        """Count a touch of two bodies, if it is new; `holder` is the arm whose parcel `body` is."""
        key = (body, other) if body < other else (other, body)
        last = self._last.get(key)
        self._last[key] = self._step
        if last is not None and self._step - last <= self._pause:
            return
        for one in (body, other):
            if one in self._cars:
                self.of_cars[self._cars[one]] += 1
            elif one in self._arms:
                self.of_arms[self._arms[one]] += 1
        if holder >= 0:
            self.of_arms[holder] += 1
        if robot:
            self.counts.robot += other not in self.ghosts or self.numbers[self._cars[body]] < self.ghosts[other]
        else:
            self.counts.static += 1

    def _in_tray(self, arm: int, car: int, point: Any) -> bool:
        """Whether a point lies inside the tray of the served car: above its floor, up to half into a wall."""
        if self.serving[arm] != self._cars[car]:
            return False
        spec = self._specs[car]
        place, quat = self._client.getBasePositionAndOrientation(car)
        com = np.array(self._client.getDynamicsInfo(car, -1)[3])
        x, y, z = rotation(np.array(quat)).T @ (np.array(point[6]) - np.array(place)) + com
        length, width, _ = spec.tray_size_m
        wall = spec.tray_wall_m / 2 + _SLOP_M
        return bool(
            abs(x - spec.tray_x_m) <= length / 2 + wall
            and abs(y) <= width / 2 + wall
            and z >= spec.tray_floor_z_m - spec.tray_wall_m
        )


def _touches(point: Any) -> bool:
    return point[8] < 0.0 or point[9] > 0.0
