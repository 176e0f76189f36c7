"""Dynamics: mass matrix and inverse dynamics of an arm, as the engine computes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fleet.arrays import FloatArray
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
