"""Inverse kinematics by the best means an arm allows: a closed form where there is one, else descent."""

from __future__ import annotations

from typing import Protocol

import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion.arm.ik import SrsGeometry
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.arm.ik_offset import OffsetGeometry
from planners.motion.arrays import FloatArray

N_DESCENTS = 24
"""Solutions asked of the solver that has no closed form."""


class InverseKinematics(Protocol):
    """What every solver offers."""

    def flange(self, q: npt.ArrayLike) -> FloatArray:
        """Pose of the last link in the base frame for one configuration (n,), shape (4, 4)."""

    def ik_all(self, base_from_flange: npt.ArrayLike) -> FloatArray:
        """Solutions inside the limits for a pose of the last link (4, 4); shape (m, n), m >= 0 [rad]."""


class _Numeric:
    def __init__(self, solver: NumericInverse) -> None:
        self._solver = solver

    def flange(self, q: npt.ArrayLike) -> FloatArray:
        return self._solver.flange(q)

    def ik_all(self, base_from_flange: npt.ArrayLike) -> FloatArray:
        return self._solver.ik_all(base_from_flange, n_wanted=N_DESCENTS)


def inverse_kinematics(base_from_joint: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike) -> InverseKinematics:
    """Choose a solver: all branches in closed form for arms like the iiwa and the Panda, descent for any other.

    Args:
        base_from_joint: Fixed transform before each joint's rotation about its own z, shape (n, 4, 4).
        lower: Lower joint limits [rad], shape (n,).
        upper: Upper joint limits [rad], shape (n,).

    Returns:
        The solver.

    Raises:
        PlanningError: Shapes do not fit, or a limit is not finite.
    """
    for family in (SrsGeometry, OffsetGeometry):
        try:
            return family.from_joints(base_from_joint, lower, upper)
        except PlanningError:
            continue  # not an arm of this kind
    return _Numeric(NumericInverse.from_joints(base_from_joint, lower, upper))
