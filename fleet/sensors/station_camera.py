"""Station cameras: one over each station, on what its arm picks from: the rack, or the tray of a car at the dock."""

from __future__ import annotations

import math

import numpy as np

from fleet.arrays import FloatArray
from fleet.sensors.camera import MAX_EDGE_PX, Camera
from maps.stations import StationPlace

HEIGHT_M = 2.4
"""Height of the cameras over the floor: over everything that moves."""
BEHIND_M = 0.9
"""A rack's camera hangs so far behind the arm's base, where the resting arm hides no slot [m]."""
MARGIN_M = 0.12
"""Seen around the outermost slots, and around the middle of a tray with half its length besides [m]."""
TRAY_HALF_M = 0.15
"""Half of a tray's length."""
PIXEL_M = 0.0018
"""What a pixel covers in the middle of the image [m]: a parcel of 5 cm is 28 pixels wide."""
NEAR_M, FAR_M = 0.5, 5.0


def station_camera(place: StationPlace, tray_xy: tuple[float, float], tray_z_m: float) -> Camera:
    """Hang a camera over a station, upright for somebody behind the arm.

    Args:
        place: The station; a pick station's camera looks at its rack, a drop station's at the tray.
        tray_xy: Centre of the tray of a car at the dock [m].
        tray_z_m: Height of the tray's floor [m].

    Returns:
        A camera that sees all places the arm picks from, with a margin.
    """
    x, y, _, yaw = place.arm.pose
    ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    if place.kind == "pick":
        middle = (place.slots.min(axis=0) + place.slots.max(axis=0)) / 2
        eye = np.array([x, y, HEIGHT_M]) - BEHIND_M * ahead
        corners = _around(place.slots, MARGIN_M)
    else:
        middle = np.array([*tray_xy, tray_z_m])
        eye = np.array([*tray_xy, HEIGHT_M])
        corners = _around(middle[None], TRAY_HALF_M + MARGIN_M)
    look = Camera.looking_at(f"camera_{place.name}", eye_m=eye, target_m=middle, up=ahead)
    # What has to be in the image, as seen by a camera of any field of view: tangents of the angles from its axis.
    u, v, _ = np.moveaxis(look.project(corners) - (*look.centre_px, 0.0), -1, 0) / look.focal_px
    wide, high = float(np.abs(u).max()), float(np.abs(v).max())
    focal_px = float(np.linalg.norm(middle - eye)) / PIXEL_M
    return Camera(
        name=look.name,
        world_from_camera=look.world_from_camera,
        width_px=min(round(2.0 * wide * focal_px), MAX_EDGE_PX),
        height_px=min(round(2.0 * high * focal_px), MAX_EDGE_PX),
        fov_rad=2.0 * math.atan(high),
        near_m=NEAR_M,
        far_m=FAR_M,
    )


def _around(points: FloatArray, margin_m: float) -> FloatArray:
    """Corners of squares around points, on their height, shape (4 k, 3)."""
    corners = [(a * margin_m, b * margin_m, 0.0) for a in (-1, 1) for b in (-1, 1)]
    return (points[:, None] + np.array(corners)).reshape(-1, 3)
