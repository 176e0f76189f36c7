"""SkidSteered: robots on wheels that do not steer, driven by the speeds of their two sides."""

from __future__ import annotations

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.twist.husky import ROLLERS, SKID, WHEEL_RADIUS_M, husky_urdf
from fleet.world.bullet.engine import groups
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.engine.frames import quaternion
from fleet.world.bullet.vehicles.floor import planar

_DRIVE_NM = 60.0
"""Torque of a side: 2.5 m/s^2 with a full load needs 15 N m."""


class SkidSteered:
    """Huskies in an engine.

    Args:
        client: Connection.
        start: Poses x, y, yaw, shape (n, 3).
    """

    def __init__(self, client: Client, start: FloatArray) -> None:
        self._client = client
        self.bodies: list[int] = []
        self._sent = np.full((len(start), 2), np.nan)
        for pose in start:
            x, y, yaw = (float(number) for number in pose)
            body = client.load_urdf(
                husky_urdf(),
                basePosition=(x, y, 0.0),
                baseOrientation=quaternion(yaw),
                flags=client.URDF_USE_INERTIA_FROM_FILE,
            )
            self.bodies.append(body)
            names = {client.getJointInfo(body, j)[1].decode(): j for j in range(client.getNumJoints(body))}
            self._rollers = [names[f"{roller}_spin"] for roller in ROLLERS]
            self._com = np.array(client.getDynamicsInfo(body, -1)[3])
            for link in (*self._rollers, names["supports_fixed"]):
                client.setCollisionFilterGroupMask(body, link, groups.MOVING, groups.WHEELS_MASK)

    def drive(self, commands: FloatArray) -> None:
        """Set the motors; a command equal to the last one costs nothing.

        Args:
            commands: Speeds [m/s] and yaw rates [rad/s], within the limits, shape (n, 2).
        """
        spins = SKID.contacts(SKID.rims(commands)) / WHEEL_RADIUS_M
        client = self._client
        for k, body in enumerate(self.bodies):
            if (commands[k] == self._sent[k]).all():
                continue
            self._sent[k] = commands[k]
            client.setJointMotorControlArray(
                body,
                self._rollers,
                client.VELOCITY_CONTROL,
                targetVelocities=spins[k].tolist(),
                forces=[_DRIVE_NM] * len(ROLLERS),
            )

    def before_step(self) -> None:
        """Nothing is due between commands."""

    def reading(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Poses x, y, yaw; speeds ahead, to the left and yaw rates; roll and pitch, a row per robot; see `planar`."""
        rows = [planar(self._client, body, self._com) for body in self.bodies]
        poses, motions, leans = (np.array(part) for part in zip(*rows, strict=True))
        return poses, motions, leans
