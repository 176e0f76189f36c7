"""FixedBodies: the floor, walls, shelves, pedestals and obstacles of one world."""

from __future__ import annotations

import numpy as np

from fleet.arrays import FloatArray
from fleet.world.bullet.engine import groups
from fleet.world.bullet.engine.client import Client, PhysicsError
from fleet.world.scene import Scene

FLOOR_FRICTION = 1.0
"""Lateral friction of the floor."""
# What never moves is a rigid body to the engine, not a robot without joints: that saves a tenth of a step.
_RIGID = 1
_COLOURS = {
    "wall": (0.22, 0.24, 0.27, 1.0),
    "shelf": (0.32, 0.25, 0.18, 1.0),
    "pedestal": (0.28, 0.30, 0.32, 1.0),
    "stand": (0.28, 0.30, 0.32, 1.0),
    "obstacle": (0.55, 0.20, 0.15, 1.0),
    "floor": (0.45, 0.46, 0.48, 1.0),
}


class FixedBodies:
    """What stands still; the constructor lays the floor, `stand` puts the scene's boxes on it.

    Attributes:
        floor: The floor's body.
        corners: Lowest and highest corners of all boxes [m], shape (k, 2, 3).
        plans: Ground plans of the boxes that a car can touch: x, y, yaw, half length, half width, shape (b, 5).
        plan_bodies: The bodies of those.

    Args:
        client: Connection.
        scene: The boxes, and how high a car is.
    """

    def __init__(self, client: Client, scene: Scene) -> None:
        self._client, self._scene = client, scene
        self._boxes: list[int] = []
        self._obstacles: dict[int, tuple[int, FloatArray, FloatArray]] = {}
        self.floor = self._lay_floor()
        self.corners: FloatArray = np.empty((0, 2, 3))
        self.plans: FloatArray = np.empty((0, 5))
        self.plan_bodies: list[int] = []

    def stand(self) -> tuple[set[int], set[int]]:
        """Put up the scene's boxes; returns the bodies of pedestals, and those of all others."""
        pedestals: set[int] = set()
        others: set[int] = set()
        for box in self._scene.boxes:
            body = self._add_box(box.kind, np.array(box.centre_m), np.array(box.half_m))
            self._boxes.append(body)
            (pedestals if box.kind == "pedestal" else others).add(body)
        self._list()
        return pedestals, others

    def add(self, obstacle: int, centre_m: FloatArray, half_m: FloatArray) -> int:
        """Put up an obstacle; returns its body.

        Raises:
            PhysicsError: Its id is taken.
        """
        if obstacle in self._obstacles:
            raise PhysicsError(f"obstacle {obstacle} is in the world already")
        centre, half = np.array(centre_m, dtype=np.float64), np.array(half_m, dtype=np.float64)
        body = self._add_box("obstacle", centre, half)
        self._obstacles[obstacle] = (body, centre, half)
        self._list()
        return body

    def remove(self, obstacle: int) -> int:
        """Take an obstacle away; returns the body that it was.

        Raises:
            PhysicsError: It is not there.
        """
        if obstacle not in self._obstacles:
            raise PhysicsError(f"obstacle {obstacle} is not in the world; valid: {sorted(self._obstacles)}")
        body, _, _ = self._obstacles.pop(obstacle)
        self._client.removeBody(body)
        self._list()
        return body

    def obstacles(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Centre and half size of every obstacle [m], in the order in which they came."""
        return {key: (centre, half) for key, (_, centre, half) in self._obstacles.items()}

    def obstacle_bodies(self) -> tuple[int, ...]:
        """Their bodies, in the same order."""
        return tuple(body for body, _, _ in self._obstacles.values())

    def _lay_floor(self) -> int:
        client = self._client
        x, y = (size / 2 for size in self._scene.size_m)
        body = client.createMultiBody(
            baseCollisionShapeIndex=client.createCollisionShape(client.GEOM_PLANE),
            baseVisualShapeIndex=client.createVisualShape(
                client.GEOM_BOX,
                halfExtents=(x, y, 0.005),
                rgbaColor=_COLOURS["floor"],
                visualFramePosition=(x, y, -0.005),
            ),
        )
        client.changeDynamics(body, -1, lateralFriction=FLOOR_FRICTION)
        client.setCollisionFilterGroupMask(body, -1, groups.FIXED | groups.FLOOR, groups.ALL)
        return int(body)

    def _add_box(self, kind: str, centre: FloatArray, half: FloatArray) -> int:
        client = self._client
        body = client.createMultiBody(
            baseCollisionShapeIndex=client.createCollisionShape(client.GEOM_BOX, halfExtents=half.tolist()),
            baseVisualShapeIndex=client.createVisualShape(
                client.GEOM_BOX, halfExtents=half.tolist(), rgbaColor=_COLOURS[kind]
            ),
            basePosition=centre.tolist(),
            useMaximalCoordinates=_RIGID,
        )
        client.setCollisionFilterGroupMask(body, -1, groups.FIXED, groups.FIXED_MASK)
        return int(body)

    def _list(self) -> None:
        """Gather corners and ground plans."""
        rows = [(*box.centre_m, *box.half_m) for box in self._scene.boxes]
        rows += [(*centre, *half) for _, centre, half in self._obstacles.values()]
        solid = np.array(rows, dtype=np.float64).reshape(-1, 6)
        self.corners = np.stack((solid[:, :3] - solid[:, 3:], solid[:, :3] + solid[:, 3:]), axis=1)
        bodies = np.array([*self._boxes, *self.obstacle_bodies()], dtype=np.int64)
        low = solid[:, 2] - solid[:, 5] < self._scene.cars.most("height_m")
        flat = np.zeros((len(solid), 5))
        flat[:, :2], flat[:, 3:] = solid[:, :2], solid[:, 3:5]
        self.plans, self.plan_bodies = flat[low], bodies[low].tolist()
