"""Engine: the same workcell in PyBullet, as the referee of collision checks and as the usual way to make them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from benchmarks.arms import workcell
from fleet.robots import ARMS
from fleet.world.bullet.engine.client import Client

FloatArray = npt.NDArray[np.float64]

_FREE_DISTANCE_M = 0.0


class Engine:
    """Bodies of the workcell and the arm with open fingers.

    The usual way sets seven joints one by one, has the engine find all contacts and reads them; every box is a body.
    """

    def __init__(self) -> None:
        self._client = client = Client()
        spec, tool = workcell.spec(), workcell.TOOL
        self._arm = client.load_urdf(ARMS["iiwa"].text(tool), useFixedBase=True, flags=client.URDF_USE_SELF_COLLISION)
        self._joints = range(spec.n_joints)
        last = spec.n_joints - 1
        links = range(-1, client.getNumJoints(self._arm))
        for link in links:
            if client.getJointInfo(self._arm, link)[1].decode() in tool.finger_joints if link >= 0 else False:
                client.resetJointState(self._arm, link, tool.finger_travel_m)
        # Touches by construction: the tool is one rigid part with the last link, and the hull of the hollow forearm
        # holds part of the flange, which the joint's limits keep off the forearm itself.
        for a in links:
            for b in links:
                if last <= a < b or (a, b) == (last - 2, last):
                    client.setCollisionFilterPair(self._arm, self._arm, a, b, 0)
        boxes = workcell.boxes()
        for centre, half, frame in zip(boxes.centre, boxes.half, boxes.min_frame, strict=True):
            shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=half.tolist())
            body = client.createMultiBody(baseCollisionShapeIndex=shape, basePosition=centre.tolist())
            for link in range(-1, int(frame) - 1):
                client.setCollisionFilterPair(self._arm, body, link, -1, 0)

    def free(self, q: FloatArray) -> bool:
        """Whether the engine finds no penetration at a configuration (n,) [rad]."""
        client = self._client
        for joint in self._joints:
            client.resetJointState(self._arm, joint, q[joint])
        client.performCollisionDetection()
        return all(point[8] >= _FREE_DISTANCE_M for point in client.getContactPoints(self._arm))

    def touching(self, q: FloatArray) -> set[tuple[int, int, int]]:
        """What penetrates at a configuration: own link, other body, other link."""
        self.free(q)
        points = self._client.getContactPoints(self._arm)
        return {(p[3], p[2], p[4]) for p in points if p[8] < _FREE_DISTANCE_M}

    def close(self) -> None:
        """End the connection."""
        self._client.close()
