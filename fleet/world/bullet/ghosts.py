"""Ghosts: cars of other engines that come near, as bodies that nothing moves and that cars of this one run into."""

from __future__ import annotations

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.spec import CarSpec
from fleet.world.bullet.engine import groups
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.engine.frames import quaternion

_RIGID = 1
_GROUND_M = 0.02
"""Kept free under the body, for wheels."""
_AWAY_M = (-100.0, -100.0, -10.0)


class Ghosts:
    """Boxes in place of cars.

    Attributes:
        bodies: The engine's body of each car that is shown, by the car's number, in the order of `poses`.
        poses: Of their rear axles, x, y, yaw, shape (g, 3).

    Args:
        client: Connection.
        car: Their model; all are of one.
    """

    def __init__(self, client: Client, car: CarSpec) -> None:
        self._client = client
        self._middle_m = (car.front_m - car.rear_m) / 2
        self._half_m = ((car.front_m + car.rear_m) / 2, car.half_width_m, (car.height_m - _GROUND_M) / 2)
        self._unused: list[int] = []
        self.bodies: dict[int, int] = {}
        self.poses: FloatArray = np.zeros((0, 3))

    def show(self, numbers: list[int], poses: FloatArray) -> None:
        """Show some cars where they are, and no others.

        Args:
            numbers: Of the cars.
            poses: Of their rear axles, x, y, yaw, shape (g, 3).
        """
        client, shown = self._client, set(numbers)
        for number in [number for number in self.bodies if number not in shown]:
            body = self.bodies.pop(number)
            client.resetBasePositionAndOrientation(body, _AWAY_M, (0.0, 0.0, 0.0, 1.0))
            self._unused.append(body)
        bodies = {}
        for number, (x, y, yaw) in zip(numbers, poses.tolist(), strict=True):
            body = self.bodies.get(number, -1)
            if body < 0:
                body = self._unused.pop() if self._unused else self._make()
            place = x + self._middle_m * np.cos(yaw), y + self._middle_m * np.sin(yaw), _GROUND_M + self._half_m[2]
            client.resetBasePositionAndOrientation(body, place, quaternion(yaw))
            bodies[number] = body
        self.bodies, self.poses = bodies, poses

    @property
    def n_made(self) -> int:
        """Bodies there are, shown or not."""
        return len(self.bodies) + len(self._unused)

    def hide(self) -> None:
        """Show none, wherever the engine has put them."""
        self._unused += self.bodies.values()
        self.bodies, self.poses = {}, np.zeros((0, 3))
        for body in self._unused:
            self._client.resetBasePositionAndOrientation(body, _AWAY_M, (0.0, 0.0, 0.0, 1.0))

    def _make(self) -> int:
        client = self._client
        body = client.createMultiBody(
            baseCollisionShapeIndex=client.createCollisionShape(client.GEOM_BOX, halfExtents=self._half_m),
            basePosition=_AWAY_M,
            useMaximalCoordinates=_RIGID,
        )
        client.setCollisionFilterGroupMask(body, -1, groups.FIXED, groups.FIXED_MASK)
        return int(body)
