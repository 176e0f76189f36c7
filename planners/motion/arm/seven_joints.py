"""SevenJointArm: what arms of seven joints with a closed form of inverse kinematics have in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.kinematics import joint_rows, last_link_pose
from planners.motion.arrays import FloatArray

N_JOINTS = 7
FIT_TOLERANCE = 1e-6
"""Joint angles that lead back to themselves by this much show that an arm is of a kind [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SevenJointArm:
    """Joints and limits of an arm."""

    base_from_joint: FloatArray
    """Joint transforms, shape (7, 4, 4)."""
    lower: FloatArray
    """Lower joint limits [rad], shape (7,)."""
    upper: FloatArray
    """Upper joint limits [rad], shape (7,)."""
    joints: FloatArray
    """Kernel input: upper three rows of the joint transforms, shape (7, 3, 4)."""

    def flange(self, q: npt.ArrayLike) -> FloatArray:
        """Pose of the last link in the base frame for one configuration (7,), shape (4, 4)."""
        return last_link_pose(self.joints, q)


def seven_joint_arm(
    name: str, base_from_joint: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike
) -> SevenJointArm:
    """Check joint transforms and limits.

    Args:
        name: Who asks, for messages.
        base_from_joint: Fixed transform before each joint's rotation about its own z, shape (7, 4, 4).
        lower: Lower joint limits [rad], shape (7,).
        upper: Upper joint limits [rad], shape (7,).

    Raises:
        PlanningError: Not 7 joints, or malformed input.
    """
    transforms = np.array(base_from_joint, dtype=np.float64)
    rows = joint_rows(transforms)
    low, high = checks.limits(name, lower, upper)
    if len(rows) != N_JOINTS or low.shape != (N_JOINTS,) or high.shape != (N_JOINTS,):
        raise PlanningError(
            f"{name}: {len(rows)} joints, limits {low.shape} and {high.shape}; valid: {N_JOINTS} of each"
        )
    return SevenJointArm(base_from_joint=transforms, lower=low, upper=high, joints=rows)
