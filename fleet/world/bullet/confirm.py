"""Confirm: PyBullet's own meshes have the last word on a planned arm path, in a client apart from the moving world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.robots.iiwa import iiwa_urdf
from fleet.robots.spec import ArmSpec
from fleet.robots.tools import Tool
from fleet.world.bullet.client import Client
from fleet.world.bullet.frames import quaternion

FloatArray = npt.NDArray[np.float64]

# The engine takes at most this many shapes in one body.
_SHAPES_PER_BODY = 16


@dataclass(frozen=True, kw_only=True)
class HeldBox:
    """A box that moves with the arm's last link."""

    size_m: tuple[float, float, float]
    link_from_box: FloatArray
    """Pose of the box centre in the last link's frame, 4x4 matrix."""


@dataclass(frozen=True, kw_only=True)
class Confirmation:
    """Verdict on a path."""

    free: bool
    first_index: int
    """First state of the path that touches something, -1 for none."""
    what: str
    """What touches what there, empty if free."""


class PathConfirmer:
    """Checks joint paths of one arm against boxes, against the arm itself and with a held box.

    Everything is in the arm's base frame. Fingers stand open. A held box may touch the tool and the last link.

    Args:
        spec: Arm model.
        tool: What the arm holds.
    """

    def __init__(self, spec: ArmSpec, tool: Tool) -> None:
        self._client = client = Client()
        client.setPhysicsEngineParameter(contactBreakingThreshold=0.001)
        self._joints = list(range(spec.n_joints))
        self._last = spec.n_joints - 1
        self._arm = client.load_urdf(iiwa_urdf(tool), useFixedBase=True, flags=client.URDF_USE_SELF_COLLISION)
        self._links = {-1: "link_0"}
        for link in range(client.getNumJoints(self._arm)):
            info = client.getJointInfo(self._arm, link)
            self._links[link] = info[12].decode().removeprefix("lbr_iiwa_")
            if info[1].decode() in tool.finger_joints:
                client.resetJointState(self._arm, link, tool.finger_travel_m)
        # The tool is rigid in the last link, fingers slide along the palm: those touches are how it is built.
        rigid = [link for link in self._links if link >= self._last]
        for a in rigid:
            for b in rigid:
                if a < b:
                    client.setCollisionFilterPair(self._arm, self._arm, a, b, 0)
        self._rigid = rigid
        # Joint 6's limits keep the forearm off the flange; only the convex hull of the hollow forearm says otherwise.
        client.setCollisionFilterPair(self._arm, self._arm, self._last - 2, self._last, 0)
        self._boxes: list[int] = []
        self._held: int | None = None
        self._held_size: tuple[float, float, float] | None = None

    def set_boxes(self, centre_m: FloatArray, half_m: FloatArray, yaw_rad: FloatArray | None = None) -> None:
        """Replace the obstacles.

        Args:
            centre_m: Centres, shape (n, 3).
            half_m: Half sizes, shape (n, 3).
            yaw_rad: Turns about z, shape (n,); all zero when None.
        """
        client = self._client
        for body in self._boxes:
            client.removeBody(body)
        self._boxes = []
        turns = np.zeros(len(centre_m)) if yaw_rad is None else np.asarray(yaw_rad)
        for first in range(0, len(centre_m), _SHAPES_PER_BODY):
            part = slice(first, first + _SHAPES_PER_BODY)
            shape = client.createCollisionShapeArray(
                shapeTypes=[client.GEOM_BOX] * len(centre_m[part]),
                halfExtents=np.asarray(half_m[part]).tolist(),
                collisionFramePositions=np.asarray(centre_m[part]).tolist(),
                collisionFrameOrientations=[quaternion(float(yaw)) for yaw in turns[part]],
            )
            self._boxes.append(client.createMultiBody(baseCollisionShapeIndex=shape))

    def confirm(self, path: FloatArray, held: HeldBox | None = None, *, allowance_m: float = 0.0) -> Confirmation:
        """Check every state of a path.

        The states are checked as they are; nothing is looked at between them.

        Args:
            path: Joint positions [rad], shape (k, n_joints).
            held: Box in the tool, None for none.
            allowance_m: Depth of a touch that is let pass, >= 0 [m].

        Returns:
            The verdict with the first state that touches something.
        """
        client = self._client
        self._take(held)
        back = held.link_from_box if held is not None else np.eye(4)
        offset, turn = back[:3, 3].tolist(), _quaternion_of(back[:3, :3])
        zeros = [[0.0]] * len(self._joints)
        for index, q in enumerate(np.asarray(path, dtype=np.float64)):
            client.resetJointStatesMultiDof(self._arm, self._joints, [[angle] for angle in q.tolist()], zeros)
            if self._held is not None:
                link = client.getLinkState(self._arm, self._last, computeForwardKinematics=1)
                place, quat = client.multiplyTransforms(link[4], link[5], offset, turn)
                client.resetBasePositionAndOrientation(self._held, place, quat)
            client.performCollisionDetection()
            points = list(client.getContactPoints(self._arm))
            if self._held is not None:
                points += client.getContactPoints(self._held)
            for point in points:
                if point[8] < -allowance_m:
                    what = f"{self._name(point, 0)} - {self._name(point, 1)}"
                    return Confirmation(free=False, first_index=index, what=what)
        return Confirmation(free=True, first_index=-1, what="")

    def close(self) -> None:
        """End the connection; calling twice is harmless."""
        self._client.close()

    def _take(self, held: HeldBox | None) -> None:
        client = self._client
        size = held.size_m if held is not None else None
        if size == self._held_size:
            return
        if self._held is not None:
            client.removeBody(self._held)
            self._held = None
        self._held_size = size
        if size is not None:
            shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=[x / 2 for x in size])
            # Boxes without mass do not collide with boxes without mass.
            self._held = client.createMultiBody(baseMass=1.0, baseCollisionShapeIndex=shape)
            for link in self._rigid:
                client.setCollisionFilterPair(self._arm, self._held, link, -1, 0)

    def _name(self, point: tuple[int, ...], side: int) -> str:
        body, link = point[1 + side], point[3 + side]
        if body == self._arm:
            return self._links[link]
        return "held box" if body == self._held else "box"


def _quaternion_of(turn: FloatArray) -> list[float]:
    """Rotation matrix as x, y, z, w: the eigenvector of the largest eigenvalue (Bar-Itzhack, J. Guidance 2000)."""
    k = np.zeros((4, 4))
    k[:3, :3] = turn + turn.T - np.eye(3) * np.trace(turn)
    k[:3, 3] = k[3, :3] = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    k[3, 3] = np.trace(turn)
    return np.linalg.eigh(k)[1][:, -1].tolist()
