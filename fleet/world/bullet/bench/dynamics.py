"""Dynamics: mass matrix and inverse dynamics of an arm, as the engine computes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.world.bullet.bench.arm_file import ArmFile, ArmFileError, load
from fleet.world.bullet.engine.client import Client

GRAVITY_MPS2 = 9.81


class BodyDynamics:
    """The dynamics of some joints of a body whose base is fixed; its other joints are held.

    Asking does not disturb the body.

    Args:
        client: Connection; its gravity counts.
        body: The body.
        joints: The engine's numbers of the joints asked about, shape (n,).
        rest: Where the other joints are taken to be, by the engine's number; zero unless given [rad or m].
    """

    def __init__(self, client: Client, body: int, joints: Sequence[int], rest: dict[int, float] | None = None) -> None:
        self._client, self._body = client, body
        movable = [i for i in range(client.getNumJoints(body)) if client.getJointInfo(body, i)[2] in (0, 1)]
        self._rows = np.array([movable.index(joint) for joint in joints])
        self._block = np.ix_(self._rows, self._rows)
        self._rest = np.array([(rest or {}).get(i, 0.0) for i in movable])
        self._still = np.zeros(len(movable))

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Joint-space inertia for q (n,) [rad]; symmetric, positive definite, shape (n, n) [kg m^2]."""
        matrix: FloatArray = np.array(self._client.calculateMassMatrix(self._body, self._filled(q, self._rest)))
        return matrix[self._block]

    def torque(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        """Torques that make the joints move so, gravity included, shape (n,) [N m]; each argument has shape (n,)."""
        still = self._still
        torque = self._client.calculateInverseDynamics(
            self._body, self._filled(q, self._rest), self._filled(qd, still), self._filled(qdd, still)
        )
        wanted: FloatArray = np.array(torque)[self._rows]
        return wanted

    def bias(self, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Torques that keep the velocity as it is: gravity and Coriolis, shape (n,) [N m]."""
        return self.torque(q, qd, np.zeros(len(self._rows)))

    def _filled(self, values: FloatArray, rest: FloatArray) -> list[float]:
        whole = rest.copy()
        whole[self._rows] = values
        numbers: list[float] = whole.tolist()
        return numbers


class ArmDynamics:
    """An arm in an engine of its own; joints that are not in the chain are held where the file's reader put them.

    Args:
        arm: The arm.
        gravity_mps2: Pull along the base frame's -z.
    """

    def __init__(self, arm: ArmFile, gravity_mps2: float = GRAVITY_MPS2) -> None:
        self._client = client = Client()
        body = load(client, arm.path)[arm.body]
        client.setGravity(0.0, 0.0, -gravity_mps2)
        names = {client.getJointInfo(body, i)[1].decode(): i for i in range(client.getNumJoints(body))}
        rest = {names[name]: value for name, value in arm.frozen.items()}
        self._dynamics = BodyDynamics(client, body, arm.joint_index, rest)
        self._n = len(arm.joint_index)

    def mass_matrix(self, q: npt.ArrayLike) -> FloatArray:
        """Joint-space inertia for q (n,) [rad]; symmetric, positive definite, shape (n, n) [kg m^2].

        Raises:
            ArmFileError: Malformed q.
        """
        return self._dynamics.mass_matrix(self._checked(q, "q"))

    def inverse_dynamics(self, q: npt.ArrayLike, qd: npt.ArrayLike, qdd: npt.ArrayLike) -> FloatArray:
        """Torques that make the arm move so, gravity included.

        Args:
            q: Joint angles [rad], shape (n,).
            qd: Velocities [rad/s], shape (n,).
            qdd: Accelerations [rad/s^2], shape (n,).

        Returns:
            Torques [N m], shape (n,).

        Raises:
            ArmFileError: Malformed input.
        """
        return self._dynamics.torque(self._checked(q, "q"), self._checked(qd, "qd"), self._checked(qdd, "qdd"))

    def close(self) -> None:
        """End the connection; calling twice is harmless."""
        self._client.close()

    def _checked(self, values: npt.ArrayLike, name: str) -> FloatArray:
        numbers = np.asarray(values, dtype=np.float64)
        if numbers.shape != (self._n,) or not np.all(np.isfinite(numbers)):
            raise ArmFileError(f"{name}: {numbers} of shape {numbers.shape}; valid: {self._n} finite values")
        return numbers
