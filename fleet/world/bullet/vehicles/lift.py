"""Lift: a plate on a vehicle that is raised under a load, holds it by a constraint, and sets it down again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fleet.robots.twist.pod import LIFT, LIFT_FORCE_N, LIFT_M, LIFT_MPS
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.engine.frames import quaternion
from fleet.world.pods import centred

CENTRE_S = 1.0
"""Time in which a load that is up is drawn to the middle of the plate."""
_HOLD_FORCE_N = 6000.0
"""Force with which a load is held on the plate: more than its weight and its inertia."""


@dataclass(frozen=True, kw_only=True)
class Hold:
    """A load that is held where it is on a plate."""

    load: int
    """Its body."""
    place: tuple[float, ...]
    quat: tuple[float, ...]
    """Pose of the plate in the load's frame."""
    constraint: int
    """The engine's id."""

    def end(self, client: Client) -> None:
        """Hold it no longer."""
        client.removeConstraint(self.constraint)


class Lift:
    """The lift of one vehicle.

    Args:
        client: Connection.
        body: The vehicle.
    """

    def __init__(self, client: Client, body: int) -> None:
        self._client, self._body = client, body
        joints = {client.getJointInfo(body, j)[1].decode(): j for j in range(client.getNumJoints(body))}
        self.plate = joints[LIFT]
        """Link and joint of the plate."""
        self.lower()

    @property
    def height_m(self) -> float:
        """How far the plate is raised."""
        return self.motion()[0]

    def motion(self) -> tuple[float, float]:
        """How far the plate is raised [m], and its speed upwards [m/s]."""
        height_m, speed_mps, *_ = self._client.getJointState(self._body, self.plate)
        return float(height_m), float(speed_mps)

    def raise_(self) -> None:
        """Raise the plate from now on."""
        self._drive(LIFT_M)

    def lower(self) -> None:
        """Lower the plate from now on."""
        self._drive(0.0)

    def reset(self) -> None:
        """Put the plate down at once."""
        self._client.resetJointState(self._body, self.plate, 0.0)
        self.lower()

    def place(self, height_m: float, speed_mps: float) -> None:
        """Put the plate at a height, in motion."""
        self._client.resetJointState(self._body, self.plate, height_m, speed_mps)

    def hold(self, load: int) -> Hold:
        """Hold a load where it is on the plate."""
        client = self._client
        plate, turn = client.getLinkState(self._body, self.plate, computeForwardKinematics=1)[:2]
        pose = client.getBasePositionAndOrientation(load)
        place, quat = client.multiplyTransforms(*client.invertTransform(*pose), plate, turn)
        return self.hold_again(Hold(load=load, place=place, quat=quat, constraint=-1))

    def centre(self, hold: Hold, left: float) -> Hold:
        """Draw a load that is held towards the middle of the plate, square to it, as its cones and the plate's pins do.

        Args:
            hold: How it is held.
            left: The share of its distance from there that is left.
        """
        client, plate_z = self._client, hold.place[2]
        yaw = client.getEulerFromQuaternion(hold.quat)[2]
        x, y, turned = centred(np.array([*hold.place[:2], yaw]), left).tolist()
        nearer = replace(hold, place=(x, y, plate_z), quat=quaternion(turned))
        client.changeConstraint(
            hold.constraint,
            jointChildPivot=nearer.place,
            jointChildFrameOrientation=nearer.quat,
            maxForce=_HOLD_FORCE_N,
        )
        return nearer

    def hold_again(self, before: Hold) -> Hold:
        """Hold a load as it was held before."""
        client = self._client
        constraint = client.createConstraint(
            self._body,
            self.plate,
            before.load,
            -1,
            client.JOINT_FIXED,
            (0, 0, 0),
            (0, 0, 0),
            before.place,
            (0, 0, 0, 1),
            before.quat,
        )
        client.changeConstraint(constraint, maxForce=_HOLD_FORCE_N)
        return replace(before, constraint=constraint)

    def touches(self, load: int) -> bool:
        """Whether a load touches anything of the vehicle but its plate."""
        points = self._client.getContactPoints(self._body, load)
        return any(point[3] != self.plate and point[8] < 0.0 for point in points)

    def _drive(self, height_m: float) -> None:
        self._client.setJointMotorControl2(
            self._body,
            self.plate,
            self._client.POSITION_CONTROL,
            targetPosition=height_m,
            force=LIFT_FORCE_N,
            maxVelocity=LIFT_MPS,
        )
