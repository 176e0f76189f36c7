"""What the rest of the house needs to know about a robot model: sizes, limits with their source, visuals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fleet.arrays import FloatArray

WHEELS = ("rear_left", "rear_right", "front_left", "front_right")
"""Wheel links of a car, in the order of `CarSpec.wheel_places`; each spins in the joint ``<link>_spin``."""


@dataclass(frozen=True, kw_only=True)
class Visual:
    """One drawn part of a robot, rigid in one of its links."""

    link: str
    """Name of the link the part is fixed to."""
    mesh: Path | None
    """Mesh file (.stl or .obj); None for a box."""
    size_m: tuple[float, float, float]
    """Full box size [m]; ignored for a mesh."""
    link_from_visual: FloatArray
    """Pose of the part in its link, 4x4 matrix."""
    rgba: tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class CarSpec:
    """An Ackermann car; the reference point of its pose is the centre of the rear axle, on the floor."""

    name: str
    mass_kg: float
    """Without a load."""
    wheelbase_m: float
    track_m: float
    wheel_radius_m: float
    front_m: float
    """Body reach ahead of the rear axle [m]."""
    rear_m: float
    """Body reach behind the rear axle [m]."""
    half_width_m: float
    height_m: float
    """Top of the tray walls above the floor [m]."""
    max_speed_mps: float
    max_accel_mps2: float
    max_brake_mps2: float
    max_steering_rad: float
    max_steering_rate_radps: float
    tray_x_m: float
    """Tray centre ahead of the rear axle [m]."""
    tray_floor_z_m: float
    """Top of the tray floor above the ground [m]."""
    tray_size_m: tuple[float, float, float]
    """Inner length, inner width, wall height of the tray [m]."""
    tray_wall_m: float
    max_payload_kg: float
    visuals: tuple[Visual, ...]
    """Links: 'chassis' (rear axle frame), `WHEELS`, 'tray'."""

    @property
    def wheel_places(self) -> FloatArray:
        """Centres x, y, z of the wheels in the car's frame, in the order of `WHEELS` [m], shape (4, 3)."""
        y = self.track_m / 2
        return np.array([[x, side * y, self.wheel_radius_m] for x in (0.0, self.wheelbase_m) for side in (1.0, -1.0)])
