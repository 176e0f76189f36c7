"""SkidSteered: robots on wheels that do not steer, driven by the speeds of their two sides."""

from __future__ import annotations

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.differential import SkidChassis
from fleet.world.bullet.engine import groups
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.vehicles.floor import load_on_floor, planar


class SkidSteered:
    """Skid-steered robots of one model in an engine.

    Args:
        client: Connection.
        chassis: What they are built of.
        start: Poses x, y, yaw, shape (n, 3).
    """

    def __init__(self, client: Client, chassis: SkidChassis, start: FloatArray) -> None:
        self._client, self._chassis = client, chassis
        self.bodies: list[int] = []
        self._sent = np.full((len(start), 2), np.nan)
        for pose in start:
            body = load_on_floor(client, chassis.description, pose)
            self.bodies.append(body)
            names = {client.getJointInfo(body, j)[1].decode(): j for j in range(client.getNumJoints(body))}
            self._rollers = [names[f"{roller}_spin"] for roller in chassis.rollers]
            self._com = np.array(client.getDynamicsInfo(body, -1)[3])
            links = {client.getJointInfo(body, j)[12].decode(): j for j in range(client.getNumJoints(body))}
            for link in (links[name] for name in (*chassis.rollers, *chassis.supports)):
                client.setCollisionFilterGroupMask(body, link, groups.MOVING, groups.WHEELS_MASK)

    def drive(self, commands: FloatArray) -> None:
        """Set the motors; a command equal to the last one costs nothing.

        Args:
            commands: Speeds [m/s] and yaw rates [rad/s], within the limits, shape (n, 2).
        """
        chassis, client = self._chassis, self._client
        spins = chassis.skid.contacts(chassis.skid.rims(commands)) / chassis.radius_m
        for k, body in enumerate(self.bodies):
            if (commands[k] == self._sent[k]).all():
                continue
            self._sent[k] = commands[k]
            client.setJointMotorControlArray(
                body,
                self._rollers,
                client.VELOCITY_CONTROL,
                targetVelocities=spins[k].tolist(),
                forces=[chassis.torque_nm] * len(self._rollers),
            )

    def before_step(self) -> None:
        """Nothing is due between commands."""

    def reading(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Poses x, y, yaw; speeds ahead, to the left and yaw rates; roll and pitch, a row per robot; see `planar`."""
        rows = [planar(self._client, body, self._com) for body in self.bodies]
        poses, motions, leans = (np.array(part) for part in zip(*rows, strict=True))
        return poses, motions, leans
