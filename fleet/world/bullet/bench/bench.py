"""ArmBench: one arm alone in an engine, to be driven, touched and measured."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fleet.control import ControlError, JointLimits
from fleet.control.errors import checked
from fleet.world.bullet.bench.arm_file import ArmFile, load
from fleet.world.bullet.bench.drive import ArmDrive
from fleet.world.bullet.bench.dynamics import GRAVITY_MPS2, BodyDynamics
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.engine.frames import quaternion
from fleet.world.bullet.engine.touch import TouchPoints, contacts, nearest

SUBSTEP_S = 1.0 / 240.0
_FINGER_FORCE_N = 100.0
_CONTACT_BREAKING_M = 0.02
"""The engine's own."""


class ArmBench:
    """An arm in an engine of its own, its base at the origin.

    Args:
        arm: The arm.
        limits: What it may do.
        step_s: Length of a physics step [s].
        gravity_mps2: Pull along -z.

    Raises:
        ControlError: The limits are another arm's, or the step is no time.
        ArmFileError: The file is not there any more.
    """

    def __init__(
        self, arm: ArmFile, limits: JointLimits, *, step_s: float = SUBSTEP_S, gravity_mps2: float = GRAVITY_MPS2
    ) -> None:
        if not isinstance(step_s, int | float) or not 0 < step_s <= 0.1:
            raise ControlError(f"step_s is {step_s!r}; valid: a number > 0 and at most 0.1")
        if not isinstance(gravity_mps2, int | float) or not math.isfinite(gravity_mps2):
            raise ControlError(f"gravity_mps2 is {gravity_mps2!r}; valid: a finite number")
        self.client = client = Client()
        self.step_s = step_s
        try:
            self.body = load(client, arm.path)[arm.body]
            client.setGravity(0.0, 0.0, -gravity_mps2)
            client.setTimeStep(step_s)
            names = {client.getJointInfo(self.body, i)[1].decode(): i for i in range(client.getNumJoints(self.body))}
            rest = {names[name]: value for name, value in arm.frozen.items()}
            for joint, value in rest.items():
                client.resetJointState(self.body, joint, value)
                client.setJointMotorControl2(
                    self.body, joint, client.POSITION_CONTROL, targetPosition=value, force=_FINGER_FORCE_N
                )
            dynamics = BodyDynamics(client, self.body, arm.joint_index, rest)
            self.drive = ArmDrive(client, self.body, arm.joint_index, limits, dynamics, step_s)
        except BaseException:
            client.close()
            raise

    @property
    def dynamics(self) -> BodyDynamics:
        """Mass matrix and inverse dynamics."""
        return self.drive.dynamics

    def step(self) -> None:
        """Advance one physics step; torque commands end with it, the others go on."""
        self.client.keep_contacts(_CONTACT_BREAKING_M)
        self.client.stepSimulation()

    def add_box(self, centre_m: npt.ArrayLike, half_m: npt.ArrayLike, yaw_rad: float = 0.0) -> int:
        """Put a fixed box into the engine: centre (3,), half edges (3,) [m]; gives its body.

        Raises:
            ControlError: Not three finite numbers, a half edge that is not > 0, or a yaw that is not finite.
        """
        client = self.client
        half, centre = checked("half_m", half_m, 3, "m"), checked("centre_m", centre_m, 3, "m")
        if not np.all(half > 0):
            raise ControlError(f"half_m: {half}; valid: three numbers > 0 [m]")
        checked("yaw_rad", [yaw_rad], 1, "rad")
        return int(
            client.createMultiBody(
                baseCollisionShapeIndex=client.createCollisionShape(client.GEOM_BOX, halfExtents=half.tolist()),
                basePosition=centre.tolist(),
                baseOrientation=quaternion(yaw_rad),
            )
        )

    def contacts(self, other: int | None = None) -> TouchPoints:
        """What the arm touched in the last physics step, and with what force; see `contacts`."""
        return contacts(self.client, self.body, other)

    def nearest(self, other: int, within_m: float = 0.1) -> TouchPoints:
        """Nearest points of the arm's links to a body; see `nearest`."""
        return nearest(self.client, self.body, other, within_m)

    def close(self) -> None:
        """End the connection; calling twice is harmless."""
        self.client.close()
