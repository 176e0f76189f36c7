"""Legged: robots that trot by the position motors of their legs."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.angle import rotation
from fleet.robots.differential import LeggedChassis
from fleet.robots.twist.inertial import InertialConfig, InertialEstimator
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
        bodies: Bodies of the robots, whose description was loaded with the base frame on the floor; they are made to
            stand up.
        step_s: Length of a physics step [s].
        tick_s: Time between two commands [s].
        rng: Source of the sensors' errors.
    """

    def __init__(
        self,
        client: Client,
        chassis: LeggedChassis,
        bodies: list[int],
        step_s: float,
        tick_s: float,
        rng: np.random.Generator,
    ) -> None:
        self._client, self._chassis, trot = client, chassis, chassis.trot
        self._tick_s = tick_s
        self._trot = Trot(trot, len(bodies), step_s)
        self._wanted = np.zeros((len(bodies), 3))
        self._told = np.zeros((len(bodies), 3))
        self._trim = np.zeros((len(bodies), 3))
        # Bodies sway as their legs step: only what a whole cycle brings is compared with what was told.
        self._recent = np.zeros((round(1.0 / (trot.frequency_hz * tick_s)), len(bodies), 3))
        self._tick = 0
        self.bodies = bodies
        names = {client.getJointInfo(bodies[0], j)[1].decode(): j for j in range(client.getNumJoints(bodies[0]))}
        self.joints = [names[name] for name in chassis.joints]
        """Joints of the legs, in the order of `LeggedChassis.joints`."""
        # Robots are told by their hips, which sway less than the floor point that leans with them.
        self._hips = np.array(client.getDynamicsInfo(bodies[0], -1)[3]) - (0.0, 0.0, chassis.hip_z_m)
        self.links = range(client.getNumJoints(bodies[0]))
        """Links beside the base."""
        for body in bodies:
            self._stand_up(body)
            for link in (-1, *self.links):
                client.setCollisionFilterGroupMask(body, link, groups.MOVING, groups.ALL)
        start = self.reading()[0]
        self._felt = InertialEstimator(start, tick_s, rng=rng, config=InertialConfig(fix_every_ticks=0))

    def put(self, robot: int, pose: FloatArray) -> None:
        """Let a robot stand upright on four feet, at rest, at a pose x, y, yaw, shape (3,)."""
        client, body = self._client, self.bodies[robot]
        quat = quaternion(float(pose[2]))
        hip = np.array([pose[0], pose[1], self._chassis.hip_z_m])
        client.resetBasePositionAndOrientation(body, (hip + rotation(np.array(quat)) @ self._hips).tolist(), quat)
        client.resetBaseVelocity(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self._stand_up(body)
        self._trot.stand(robot)
        self._told[robot] = self._wanted[robot] = 0.0

    def _stand_up(self, body: int) -> None:
        """Put the legs of a robot as they are when it stands."""
        angles = standing_angles(self._chassis.trot).tolist()
        for joint, angle in zip(self.joints, angles, strict=True):
            self._client.resetJointState(body, joint, angle, 0.0)

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

    def memory(self) -> Any:
        """Gait, senses and what was told: all but where bodies and joints are."""
        state = (self._trot, self._wanted, self._told, self._trim, self._recent, self._tick, self._felt)
        return copy.deepcopy(state)

    def recall(self, memory: Any) -> None:
        """Return to `memory`."""
        state = copy.deepcopy(memory)
        self._trot, self._wanted, self._told, self._trim, self._recent, self._tick, self._felt = state

    def before_step(self) -> None:
        """Move the legs on; call it before every physics step."""
        targets = self._trot.joint_targets(self._told)
        client, chassis, n = self._client, self._chassis, len(self.joints)
        position, velocity = chassis.gains
        for body, row in zip(self.bodies, targets.tolist(), strict=True):
            client.setJointMotorControlArray(
                body,
                self.joints,
                client.POSITION_CONTROL,
                targetPositions=row,
                positionGains=[position] * n,
                velocityGains=[velocity] * n,
                forces=[chassis.torque_nm] * n,
            )

    def reading(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Poses x, y, yaw; speeds ahead, to the left and yaw rates; roll and pitch, a row per robot; see `planar`."""
        rows = [planar(self._client, body, self._hips) for body in self.bodies]
        poses, motions, leans = (np.array(part) for part in zip(*rows, strict=True))
        return poses, motions, leans
