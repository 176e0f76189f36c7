"""Home: where an arm rests, so that it hangs over neither its dock's lane nor its slots."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.errors import ArmDescriptionError
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.arm.kinematics import pointing_down

HOME_TIP_M = (-0.40, 0.62)
"""Usual x and z of the tool's tip at rest, in the base frame [m]: behind the base, between the default slots, pointing
down."""

Home = Callable[[FloatArray, FloatArray, FloatArray, float], FloatArray]
"""Joint positions (n,) from `base_from_joint` (n, 4, 4), lower and upper limits (n,), all in rad, and the tool's length
[m]."""


def behind_the_base(*near_rad: float, z_m: float = HOME_TIP_M[1]) -> Home:
    """Rest with the tip where `HOME_TIP_M` says, by descent from a rough guess, which decides the posture.

    Args:
        near_rad: The guess, one angle for each joint.
        z_m: Height of the tip over the base, where it is not the usual one.

    Returns:
        What finds the rest position.

    Raises:
        ArmDescriptionError: By what is returned, of a guess for another number of joints, or from which descent finds
            no such posture.
    """

    def home(base_from_joint: FloatArray, lower: FloatArray, upper: FloatArray, tool_length_m: float) -> FloatArray:
        inverse = NumericInverse.from_joints(base_from_joint, lower, upper)
        guess = np.array(near_rad, dtype=np.float64)
        if guess.shape != lower.shape:
            raise ArmDescriptionError(f"home: a guess of {len(guess)} angles; valid: {len(lower)}, one for each joint")
        across = inverse.flange(guess)[:3, 0]
        pose = pointing_down(math.atan2(across[1], across[0]))
        pose[[0, 2], 3] = HOME_TIP_M[0], z_m + tool_length_m
        found = inverse.ik_near(pose, guess)
        if found is None:
            raise ArmDescriptionError(
                f"home: no posture near {[round(float(q), 3) for q in guess]} has the tool's tip at x = "
                f"{HOME_TIP_M[0]}, z = {z_m} m, pointing down; valid: a guess from which descent finds one"
            )
        return found

    return home
