"""ArmDrive: position, velocity and torque control of one arm in an engine, with its limits kept in all three."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.control import ControlError, JointLimits
from fleet.control.errors import checked
from fleet.world.bullet.bench.dynamics import BodyDynamics
from fleet.world.bullet.engine.client import Client

POSITION_GAIN = 0.3
"""Share of the position error that the motors take back in one physics step, as those of the shared world."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmState:
    """An arm between two physics steps."""

    q: FloatArray
    """Joint positions [rad], shape (n,)."""
    qd: FloatArray
    """Joint velocities [rad/s], shape (n,)."""
    mass: FloatArray
    """Joint-space inertia; the damping of the coming step counts to it, shape (n, n) [kg m^2]."""
    bias: FloatArray
    """Torque for zero acceleration: gravity, Coriolis and damping, without dry friction, shape (n,) [N m]."""


class ArmDrive:
    """The joints of one arm, commanded before each physics step.

    Viscous damping and dry friction of the joints belong to the drive: the engine's own damping is explicit and blows
    up on light joints (a last joint may have 0.001 kg m^2; with the file's 0.5 N m s/rad it is unstable at
    1/240 s). Here it is taken at the end of the step, as in stable PD control (J. Tan, K. Liu and G. Turk, Stable
    proportional-derivative controllers, IEEE Computer Graphics and Applications 31(4), 2011). Dry friction is a joint
    motor that tries to stop the joint with at most the friction's torque, so that it holds as well as it slows. Both
    act on what torque control does; position and velocity control overcome them.

    Args:
        client: Connection.
        body: The arm's body.
        joints: The engine's numbers of its joints, base to tip, shape (n,).
        limits: What it may do.
        dynamics: Its masses.
        step_s: Length of a physics step [s].
    """

    def __init__(
        self,
        client: Client,
        body: int,
        joints: Sequence[int],
        limits: JointLimits,
        dynamics: BodyDynamics,
        step_s: float,
    ) -> None:
        if len(joints) != limits.n:
            raise ControlError(f"limits of {limits.n} joints for an arm of {len(joints)}; valid: equal numbers")
        self._client, self._body, self._joints = client, body, list(joints)
        self.limits, self.dynamics, self.step_s = limits, dynamics, step_s
        self._damping = np.zeros(limits.n)
        self._friction = np.zeros(limits.n)
        self._forces = np.where(np.isfinite(limits.max_torque_nm), limits.max_torque_nm, 1e6).tolist()
        self._speeds = np.where(np.isfinite(limits.max_velocity_radps), limits.max_velocity_radps, 1e3).tolist()
        self._passive = False
        for link in range(-1, client.getNumJoints(body)):
            client.changeDynamics(body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.limits.n

    def set_friction(self, damping: npt.ArrayLike, friction: npt.ArrayLike) -> None:
        """Give the joints friction.

        Args:
            damping: Viscous damping [N m s/rad], shape (n,), >= 0.
            friction: Dry (Coulomb) friction [N m], shape (n,), >= 0.

        Raises:
            ControlError: Malformed or negative values.
        """
        for name, values, unit in (("damping", damping, "N m s/rad"), ("friction", friction, "N m")):
            if np.any(checked(name, values, self.n, unit) < 0):
                raise ControlError(f"{name}: {np.asarray(values)}; valid: values >= 0 [{unit}]")
        self._damping = np.array(damping, dtype=np.float64)
        self._friction = np.array(friction, dtype=np.float64)
        self._passive = False

    def place(self, q: npt.ArrayLike, qd: npt.ArrayLike | None = None) -> None:
        """Put the joints somewhere at once.

        Args:
            q: Positions [rad], shape (n,).
            qd: Velocities [rad/s], shape (n,); None for rest.

        Raises:
            ControlError: Malformed values.
        """
        where = checked("q", q, self.n, "rad")
        speed = np.zeros(self.n) if qd is None else checked("qd", qd, self.n, "rad/s")
        for joint, angle, rate in zip(self._joints, where.tolist(), speed.tolist(), strict=True):
            self._client.resetJointState(self._body, joint, angle, rate)

    def state(self) -> tuple[FloatArray, FloatArray]:
        """Positions [rad] and velocities [rad/s], each (n,)."""
        numbers = np.array([s[:2] for s in self._client.getJointStates(self._body, self._joints)])
        return numbers[:, 0], numbers[:, 1]

    def sense(self) -> ArmState:
        """Measure the joints, and what a law of torques needs to know about the arm there."""
        q, qd = self.state()
        damping = self._damping
        return ArmState(
            q=q,
            qd=qd,
            mass=self.dynamics.mass_matrix(q) + self.step_s * np.diag(damping),
            bias=self.dynamics.bias(q, qd) + damping * qd,
        )

    def position(self, q: npt.ArrayLike, qd: npt.ArrayLike | None = None) -> None:
        """Hold a position with the motors: target and speed are cut to the limits, torque is limited by the engine.

        Args:
            q: Where the joints should be when the next step begins [rad], shape (n,).
            qd: Velocity there [rad/s], shape (n,); None for rest, which follows a moving target with a lag.

        Raises:
            ControlError: Malformed values.
        """
        target = self.limits.position(q)
        rate = np.zeros(self.n) if qd is None else checked("qd", qd, self.n, "rad/s")
        rate = np.clip(rate, -self.limits.max_velocity_radps, self.limits.max_velocity_radps)
        client = self._client
        for i, joint in enumerate(self._joints):
            client.setJointMotorControl2(
                self._body,
                joint,
                client.POSITION_CONTROL,
                targetPosition=float(target[i]),
                targetVelocity=float(rate[i]),
                force=self._forces[i],
                positionGain=POSITION_GAIN,
                velocityGain=1.0,
                maxVelocity=self._speeds[i],
            )
        self._passive = False

    def velocity(self, qd: npt.ArrayLike) -> None:
        """Turn the joints at a velocity (n,) [rad/s]: cut to the limits, and slowed down before the end stops.

        Raises:
            ControlError: Malformed values.
        """
        allowed = self.limits.velocity(self.state()[0], qd, self.step_s)
        self._client.setJointMotorControlArray(
            self._body,
            self._joints,
            self._client.VELOCITY_CONTROL,
            targetVelocities=allowed.tolist(),
            forces=self._forces,
        )
        self._passive = False

    def torque(self, torque: npt.ArrayLike, now: ArmState | None = None) -> FloatArray:
        """Let the motors act with a torque for one physics step.

        Args:
            torque: Wanted torque [N m], shape (n,).
            now: What `sense` said since the last step; None asks again.

        Returns:
            The torque that the motors give, inside all limits; see `JointLimits.torque`.

        Raises:
            ControlError: Malformed values.
        """
        if not self._passive:
            self._client.setJointMotorControlArray(
                self._body,
                self._joints,
                self._client.VELOCITY_CONTROL,
                targetVelocities=[0.0] * self.n,
                forces=self._friction.tolist(),
            )
            self._passive = True
        now = now or self.sense()
        allowed = self.limits.torque(torque, now.mass, now.bias, now.q, now.qd, self.step_s)
        # What the engine is told is the motors' torque less that of the damping over the coming step.
        rate = now.qd + self.step_s * np.linalg.solve(now.mass, allowed - now.bias)
        self._client.setJointMotorControlArray(
            self._body,
            self._joints,
            self._client.TORQUE_CONTROL,
            forces=(allowed - self._damping * rate).tolist(),
        )
        return allowed
