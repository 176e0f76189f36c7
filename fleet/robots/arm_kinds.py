"""Arm kinds: the arms of `pybullet_data` that can be named, with the limits of the real ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pybullet_data

from fleet.arrays import FloatArray
from fleet.errors import ConfigError
from fleet.robots.iiwa import iiwa_spec


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmKind:
    """An arm that can be named."""

    path: Path
    """Its description."""
    max_velocity_radps: FloatArray
    """Limits of the real arm, shape (n,)."""
    max_acceleration_radps2: FloatArray
    """Limits of the real arm, shape (n,)."""
    max_torque_nm: FloatArray
    """Limits of the real arm, shape (n,)."""
    frozen: Mapping[str, float] = field(default_factory=dict)
    """Where other joints are held [rad or m]."""
    allowed: tuple[tuple[str, str], ...] = ()
    """Pairs of links that may touch, by name: their covers meet where the links themselves do not."""


def arm_kind(name: str) -> ArmKind:
    """Look up an arm by its name.

    Raises:
        ConfigError: It is none in `ARM_NAMES`.
    """
    if name not in ARM_NAMES:
        raise ConfigError(f"arm {name!r}; valid: {', '.join(ARM_NAMES)}")
    data = Path(pybullet_data.getDataPath())
    if name == "iiwa":
        spec = iiwa_spec()
        return ArmKind(
            path=spec.urdf,
            max_velocity_radps=spec.max_velocity_radps,
            max_acceleration_radps2=spec.max_acceleration_radps2,
            max_torque_nm=spec.max_torque_nm,
        )
    if name == "panda":
        # Franka Emika, FCI documentation, "Limits for Panda": joint space limits.
        return ArmKind(
            path=data / "franka_panda" / "panda.urdf",
            max_velocity_radps=np.array([2.175] * 4 + [2.61] * 3),
            max_acceleration_radps2=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
            max_torque_nm=np.array([87.0] * 4 + [12.0] * 3),
            frozen={"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04},
            # Their spheres overlap by 4 mm in every ordinary posture; the links themselves are apart.
            allowed=(("panda_link5", "panda_link7"),),
        )
    # UFACTORY, xArm 6 user manual: 180 deg/s and 1145 deg/s^2 for every joint; torques of the description.
    return ArmKind(
        path=data / "xarm" / "xarm6_robot.urdf",
        max_velocity_radps=np.full(6, np.radians(180.0)),
        max_acceleration_radps2=np.full(6, np.radians(1145.0)),
        max_torque_nm=np.array([50.0, 50.0, 32.0, 32.0, 32.0, 20.0]),
    )


ARM_NAMES = ("iiwa", "panda", "xarm")
"""Arms that `arm_kind` knows."""
