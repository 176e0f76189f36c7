"""Lift: a plate on a vehicle that is raised under a load, holds it by a constraint, and sets it down again."""

from __future__ import annotations

from fleet.robots.twist.lifter import LIFT, LIFT_FORCE_N, LIFT_M, LIFT_MPS
from fleet.world.bullet.engine.client import Client

_HOLD_FORCE_N = 6000.0
"""Force with which a load is held on the plate: more than its weight and its inertia."""


class Lift:
    """The lift of one vehicle, and the load that it may hold.

    Args:
        client: Connection.
        body: The vehicle.
        load: The only body that it ever lifts.
    """

    def __init__(self, client: Client, body: int, load: int) -> None:
        self._client, self._body, self._load = client, body, load
        joints = {client.getJointInfo(body, j)[1].decode(): j for j in range(client.getNumJoints(body))}
        self.plate = joints[LIFT]
        """Link and joint of the plate."""
        # Made once and switched by its force: constraints that come and go would make snapshots inexact.
        self._hold = client.createConstraint(
            body, self.plate, load, -1, client.JOINT_FIXED, (0, 0, 0), (0, 0, 0), (0, 0, 0)
        )
        client.changeConstraint(self._hold, maxForce=0.0)
        self.lower()

    @property
    def height_m(self) -> float:
        """How far the plate is raised."""
        return float(self._client.getJointState(self._body, self.plate)[0])

    def raise_(self) -> None:
        """Raise the plate from now on."""
        self._drive(LIFT_M)

    def lower(self) -> None:
        """Lower the plate from now on."""
        self._drive(0.0)

    def hold(self) -> None:
        """Hold the load where it is on the plate."""
        client = self._client
        plate, turn = client.getLinkState(self._body, self.plate, computeForwardKinematics=1)[:2]
        load, load_turn = client.getBasePositionAndOrientation(self._load)
        place, quat = client.multiplyTransforms(*client.invertTransform(load, load_turn), plate, turn)
        client.changeConstraint(
            self._hold, jointChildPivot=place, jointChildFrameOrientation=quat, maxForce=_HOLD_FORCE_N
        )

    def let_go(self) -> None:
        """Hold the load no longer."""
        self._client.changeConstraint(self._hold, maxForce=0.0)

    def touches(self) -> bool:
        """Whether the load touches anything of the vehicle but its plate."""
        points = self._client.getContactPoints(self._body, self._load)
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
