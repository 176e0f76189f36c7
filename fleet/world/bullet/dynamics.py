"""ArmDynamics: mass matrix and inverse dynamics of an arm read from a file, as the engine computes them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.world.bullet.arm_file import ArmFile, ArmFileError, load
from fleet.world.bullet.client import Client

FloatArray = npt.NDArray[np.float64]

GRAVITY_MPS2 = 9.81


class ArmDynamics:
    """An arm in an engine of its own; joints that are not in the chain are held where the file's reader put them.

    Args:
        arm: The arm.
        gravity_mps2: Pull along the base frame's -z.
    """

    def __init__(self, arm: ArmFile, gravity_mps2: float = GRAVITY_MPS2) -> None:
        self._client = client = Client()
        self._body = load(client, arm.path)[arm.body]
        client.setGravity(0.0, 0.0, -gravity_mps2)
        infos = [client.getJointInfo(self._body, i) for i in range(client.getNumJoints(self._body))]
        movable = [i for i, info in enumerate(infos) if info[2] in (0, 1)]
        self._rows = np.array([movable.index(i) for i in arm.joint_index])
        self._rest = np.array([arm.frozen.get(infos[i][1].decode(), 0.0) for i in movable])
        self._n = len(arm.joint_index)

    def mass_matrix(self, q: npt.ArrayLike) -> FloatArray:
        """Joint-space inertia for q (n,) [rad]; symmetric, positive definite, shape (n, n) [kg m^2].

        Raises:
            ArmFileError: Malformed q.
        """
        whole = self._client.calculateMassMatrix(self._body, self._filled(q, "q", self._rest))
        matrix: FloatArray = np.array(whole)[np.ix_(self._rows, self._rows)]
        return matrix

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
        still = np.zeros_like(self._rest)
        torque = self._client.calculateInverseDynamics(
            self._body, self._filled(q, "q", self._rest), self._filled(qd, "qd", still), self._filled(qdd, "qdd", still)
        )
        wanted: FloatArray = np.array(torque)[self._rows]
        return wanted

    def close(self) -> None:
        """End the connection; calling twice is harmless."""
        self._client.close()

    def _filled(self, values: npt.ArrayLike, name: str, rest: FloatArray) -> list[float]:
        numbers = np.asarray(values, dtype=np.float64)
        if numbers.shape != (self._n,) or not np.all(np.isfinite(numbers)):
            raise ArmFileError(f"{name}: {numbers} of shape {numbers.shape}; valid: {self._n} finite values")
        whole = rest.copy()
        whole[self._rows] = numbers
        return [float(x) for x in whole]
