"""TwistSpec: what the house needs to know about a robot that drives by a speed and a yaw rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from fleet.robots.differential import LeggedChassis, SkidChassis, TwistLimits, TwistResponse
from fleet.robots.spec import Visual

TwistDrive = Literal["differential", "legged"]


@dataclass(frozen=True, kw_only=True)
class TwistSpec:
    """A robot that is told a speed and a yaw rate, and may turn on the spot about the reference point of its pose.

    The reference point is the middle between its wheels or feet, on the floor; x points ahead.
    """

    name: str
    drive: TwistDrive
    chassis: SkidChassis | LeggedChassis
    mass_kg: float
    """Without a load."""
    max_payload_kg: float
    front_m: float
    """Reach of its body and what moves on it ahead of the reference point [m]."""
    rear_m: float
    """Reach behind the reference point [m]."""
    half_width_m: float
    height_m: float
    """Top of the tray walls above the floor [m]."""
    tray_x_m: float
    """Tray centre ahead of the reference point [m]."""
    tray_floor_z_m: float
    """Top of the tray floor above the ground [m]."""
    tray_size_m: tuple[float, float, float]
    """Inner length, inner width, wall height of the tray [m]."""
    limits: TwistLimits
    response: TwistResponse
    visuals: tuple[Visual, ...]
    sources: Mapping[str, str]
    """Where each number is from, by the name of its field here or in `limits`."""
