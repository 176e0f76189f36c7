"""Legged: robots that trot by the position motors of their legs."""

from __future__ import annotations

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.twist.inertial import InertialConfig, InertialEstimator
from fleet.robots.twist.spec import LeggedChassis
from fleet.robots.twist.trot import Trot, standing_angles
from fleet.world.bullet.engine import groups
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.engine.frames import quaternion
from fleet.world.bullet.vehicles.floor import planar

_TRIM_PER_S = 0.3
"""How fast steps grow where the robot is slower than told [1/s]."""
_MOST_TRIM = np.array([0.15, 0.15, 0.3])
"""By how much at most: ahead and to the left [m/s], yaw rate [rad/s]."""


class Legged:
    """Four-legged robots of one model in an engine.

    What steps bring depends on the load and on how feet meet the floor. So each robot compares what it is told with
    what its own inertial unit and legs tell it, and steps more or less; sideways it is always told to stay.

    Args:
        client: Connection.
        chassis: What they are built of, and how they walk.
        start: Poses x, y, yaw, shape (n, 3); they stand there.
        step_s: Length of a physics step [s].
        tick_s: Time between two commands [s].
        rng: Source of the sensors' errors.
    """

    def __init__(
        self,
        client: Client,
        chassis: LeggedChassis,
        start: FloatArray,
        step_s: float,
        tick_s: float,
        rng: np.random.Generator,
    ) -> None:
        self._client, self._chassis, trot = client, chassis, chassis.trot
        self._tick_s = tick_s
        self._trot = Trot(trot, len(start), step_s)
        self._wanted = np.zeros((len(start), 3))
        self._told = np.zeros((len(start), 3))
        self._trim = np.zeros((len(start), 3))
        # Bodies sway as their legs step: only what a whole cycle brings is compared with what was told.
        self._recent = np.zeros((round(1.0 / (trot.frequency_hz * tick_s)), len(start), 3))
        self._tick = 0
        self._felt = InertialEstimator(start, tick_s, rng=rng, config=InertialConfig(fix_every_ticks=0))
        self.bodies: list[int] = []
        angles = standing_angles(trot)
        for pose in start:
            x, y, yaw = (float(number) for number in pose)
            body = client.load_urdf(
                chassis.description,
                basePosition=(x, y, trot.height_m + chassis.toe_m),
                baseOrientation=quaternion(yaw),
                flags=client.URDF_USE_INERTIA_FROM_FILE,
            )
            self.bodies.append(body)
            names = {client.getJointInfo(body, j)[1].decode(): j for j in range(client.getNumJoints(body))}
            self._joints = [names[name] for name in chassis.joints]
            self._com = np.array(client.getDynamicsInfo(body, -1)[3])
            for joint, angle in zip(self._joints, angles.tolist(), strict=True):
                client.resetJointState(body, joint, angle)
            for link in range(-1, client.getNumJoints(body)):
                client.setCollisionFilterGroupMask(body, link, groups.MOVING, groups.ALL)

    def drive(self, commands: FloatArray) -> None:
        """Say how to move from now on; call it in every tick. A robot that feels that it has fallen stands still.

        Args:
            commands: Speeds [m/s] and yaw rates [rad/s], within the limits, shape (n, 2).
        """
        self._felt.update(*self.reading())
        # What was felt now comes of what was told before.
        self._recent[self._tick % len(self._recent)] = self._felt.motions - self._wanted
        self._tick += 1
        surplus = self._recent.mean(axis=0)
        stepping = (np.abs(commands).max(axis=1) > 0.0) & ~self._felt.fallen
        wanted = self._wanted = np.column_stack((commands[:, 0], np.zeros(len(commands)), commands[:, 1]))
        self._trim[stepping] -= _TRIM_PER_S * self._tick_s * surplus[stepping]
        np.clip(self._trim, -_MOST_TRIM, _MOST_TRIM, out=self._trim)
        self._told = np.where(stepping[:, None], wanted + self._trim, 0.0)

    def before_step(self) -> None:
        """Move the legs on; call it before every physics step."""
        targets = self._trot.joint_targets(self._told)
        client, chassis, n = self._client, self._chassis, len(self._joints)
        position, velocity = chassis.gains
        for body, row in zip(self.bodies, targets.tolist(), strict=True):
            client.setJointMotorControlArray(
                body,
                self._joints,
                client.POSITION_CONTROL,
                targetPositions=row,
                positionGains=[position] * n,
                velocityGains=[velocity] * n,
                forces=[chassis.torque_nm] * n,
            )

    def reading(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Poses x, y, yaw; speeds ahead, to the left and yaw rates; roll and pitch, a row per robot; see `planar`."""
        rows = [planar(self._client, body, self._com) for body in self.bodies]
        poses, motions, leans = (np.array(part) for part in zip(*rows, strict=True))
        return poses, motions, leans
