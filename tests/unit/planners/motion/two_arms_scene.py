"""Two iiwa that face each other over one tray, and a referee that shares no code with the planners."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import numpy.typing as npt
import pybullet
import pybullet_data

FloatArray = npt.NDArray[np.float64]

APART_M = 1.2
MAX_VELOCITY = np.radians((85, 85, 100, 75, 130, 135, 135))
MAX_ACCELERATION = np.array((5.0, 5.0, 6.0, 6.0, 8.0, 8.0, 8.0))


def bases() -> tuple[FloatArray, FloatArray]:
    """Poses of both bases: the second stands on the first one's +x and looks back."""
    second = np.diag((-1.0, -1.0, 1.0, 1.0))
    second[0, 3] = APART_M
    return np.eye(4), second


class Referee:
    """Asks PyBullet how far two arms are apart, with the engine's own description of the arm."""

    def __init__(self) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        path = pybullet_data.getDataPath() + "/kuka_iiwa/model.urdf"
        self._arms = [
            pybullet.loadURDF(path, position, turn, useFixedBase=True, physicsClientId=self._client)
            for position, turn in (((0, 0, 0), (0, 0, 0, 1)), ((APART_M, 0, 0), (0, 0, 1, 0)))
        ]

    def distance_m(self, qa: FloatArray, qb: FloatArray, cutoff_m: float = 0.05) -> float:
        """Distance of the arms, at most `cutoff_m`; negative when they overlap."""
        for arm, q in zip(self._arms, (qa, qb), strict=True):
            for joint, angle in enumerate(q):
                pybullet.resetJointState(arm, joint, angle, physicsClientId=self._client)
        points = pybullet.getClosestPoints(*self._arms, distance=cutoff_m, physicsClientId=self._client)
        return min((point[8] for point in points), default=cutoff_m)

    def least_m(self, motion: Callable[[float], tuple[FloatArray, FloatArray]], times: Iterable[float]) -> float:
        """Smallest distance over times."""
        return min(self.distance_m(*motion(t)) for t in times)

    def close(self) -> None:
        """End the connection."""
        pybullet.disconnect(self._client)
