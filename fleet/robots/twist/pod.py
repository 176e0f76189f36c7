"""Pod: a shelf on four legs that a low vehicle drives under and lifts, the lift, and who has one."""

from __future__ import annotations

from fleet.robots.description import box_inertia, fill, solid_box, spaced
from fleet.robots.spec import PodShape, Visual, visual

LIFT = "lift"
"""Joint that lifts the plate, upwards from 0."""
LIFT_M = 0.05
"""Stroke of the lift [m]."""
LIFT_MPS = 0.02
"""Its speed [m/s]."""
LIFT_FORCE_N = 6000.0
"""Most force of its motor [N]."""
LIFT_S = LIFT_M / LIFT_MPS
"""Time in which it goes up or down [s]."""

POD_MASS_KG = 100.0
"""A pod with what lies in it [kg]."""
_LEG_M = 0.04
_SHELVES_M = (0.34, 0.74, 1.14, 1.54)
"""Middles of the shelves above the floor; the underside of the lowest is 2 cm above a plate that is down."""
_SHELF_M = 0.04
_COM_Z_M = 0.85
_RGBA = (0.35, 0.45, 0.60, 1.0)

POD = PodShape(length_m=0.85, width_m=0.85, height_m=_SHELVES_M[-1] + _SHELF_M / 2)
"""Turned on the spot it stays within 1.21 m, and so within the widest cell."""


def pod_urdf() -> str:
    """Write the description of a pod: four legs, four shelves; its base frame is its middle, on the floor."""
    ixx, iyy, izz = box_inertia(POD_MASS_KG, (POD.length_m, POD.width_m, POD.height_m))
    return fill(
        "pod",
        mass=POD_MASS_KG,
        com=spaced((0.0, 0.0, _COM_Z_M)),
        ixx=ixx,
        iyy=iyy,
        izz=izz,
        parts="\n".join(solid_box(size, xyz, "shelf") for size, xyz in _boxes()),
    )


def pod_visuals() -> tuple[Visual, ...]:
    """What is drawn of a pod, in its frame."""
    return tuple(visual("pod", rgba=_RGBA, size_m=size, xyz=xyz) for size, xyz in _boxes())


def _boxes() -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Sizes of legs and shelves, and where their middles are in the pod's frame [m]."""
    top = POD.height_m
    off_x, off_y = (size / 2 - _LEG_M / 2 for size in (POD.length_m, POD.width_m))
    legs = [((_LEG_M, _LEG_M, top), (sx * off_x, sy * off_y, top / 2)) for sx in (1, -1) for sy in (1, -1)]
    return [*legs, *(((POD.length_m, POD.width_m, _SHELF_M), (0.0, 0.0, z)) for z in _SHELVES_M)]
