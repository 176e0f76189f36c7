"""Robots of `pybullet_data` that only stand here: where their motors hold them, and in which steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pybullet_data


@dataclass(frozen=True, kw_only=True)
class StandingRobot:
    """A robot that its motors hold in one posture."""

    name: str
    path: Path
    maker: str
    """Who makes the real one."""
    upright_xyzw: tuple[float, float, float, float]
    """Orientation of its base when it stands."""
    scale: float
    """Of the description, whose lengths may be in other units than metres."""
    posture: Mapping[str, float]
    """Angle of each joint whose name ends so [rad]; all others are held at zero."""
    torque_nm: float
    """Most torque of a joint."""
    gains: tuple[float, float] = (0.2, 0.5)
    """Of the engine's position motors, for position and velocity."""
    step_s: float = 1 / 120
    """Length of a physics step [s]."""
    n_iterations: int = 30
    """Of the engine's solver."""


def _quadruped(
    name: str, file: str, maker: str, posture: Mapping[str, float], torque_nm: float, *, fine: bool = False
) -> StandingRobot:
    return StandingRobot(
        name=name,
        path=Path(pybullet_data.getDataPath()) / file,
        maker=maker,
        upright_xyzw=(0.0, 0.0, 0.0, 1.0),
        scale=1.0,
        posture=posture,
        torque_nm=torque_nm,
        step_s=1 / 240 if fine else 1 / 120,
        n_iterations=50 if fine else 30,
    )


STANDING: dict[str, StandingRobot] = {
    robot.name: robot
    for robot in (
        _quadruped(
            "laikago",
            "laikago/laikago_toes_zup.urdf",
            "Unitree Laikago",
            {"upper_leg_2_hip_motor_joint": 0.07, "lower_leg_2_upper_leg_joint": -0.59},
            60.0,
        ),
        _quadruped(
            "aliengo",
            "aliengo/aliengo.urdf",
            "Unitree Aliengo",
            {"upper_joint": 0.8, "lower_joint": -1.6},
            44.4,
        ),
        _quadruped(
            "mini_cheetah",
            "mini_cheetah/mini_cheetah.urdf",
            "MIT Mini Cheetah",
            {
                **{f"thigh_{leg}_j": -0.8 for leg in ("fr", "fl", "hr", "hl")},
                **{f"knee_{leg}_j": 1.6 for leg in ("fr", "fl", "hr", "hl")},
            },
            18.0,
        ),
        _quadruped(
            "vision60",
            "quadruped/vision60.urdf",
            "Ghost Robotics Vision 60",
            {**{str(joint): 0.8 for joint in (0, 2, 4, 6)}, **{str(joint): 1.6 for joint in (1, 3, 5, 7)}},
            87.5,
        ),
        _quadruped(
            "spirit40",
            "quadruped/spirit40.urdf",
            "Ghost Robotics Spirit 40",
            {**{str(joint): 0.8 for joint in (0, 2, 4, 6)}, **{str(joint): 1.6 for joint in (1, 3, 5, 7)}},
            40.0,
            fine=True,  # at 1/120 s its feet slide by 16 mm a second
        ),
        StandingRobot(
            name="humanoid",
            path=Path(pybullet_data.getDataPath()) / "humanoid" / "humanoid.urdf",
            maker="none: the figure of DeepMimic",
            upright_xyzw=(0.7071067811865476, 0.0, 0.0, 0.7071067811865476),
            scale=0.25,
            posture={},
            torque_nm=300.0,
            gains=(0.3, 1.0),
            # It falls without a push in steps of 1/120 s with 30 iterations.
            step_s=1 / 240,
            n_iterations=50,
        ),
    )
}
"""By name."""
