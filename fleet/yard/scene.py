"""Scene of a yard: walls, pillars and cars."""

from __future__ import annotations

import math

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots import ArmTeam
from fleet.robots.cars.models import usual_car
from fleet.world.scene import Scene, StaticBox
from maps.yard import Yard
from planners.open_floor import CarOutline

_WALL_M, _HEIGHT_M = 0.2, 0.6


def car_shape(turning_radius_m: float) -> CarOutline:
    """The body of a car, with a turning radius to plan with."""
    spec = usual_car()
    return CarOutline(
        front_m=spec.front_m,
        rear_m=spec.rear_m,
        half_width_m=spec.half_width_m,
        turning_radius_m=turning_radius_m,
    )


def yard_scene(yard: Yard, car_start: FloatArray) -> Scene:
    """Build the scene of a yard.

    Args:
        yard: The yard.
        car_start: Rear-axle poses, shape (n_cars, 3).

    Returns:
        Four walls around the floor, a box inside the disc of each pillar, and the cars; no arms.
    """
    width, height = yard.size_m
    boxes = []
    for x, y, half_x, half_y in (
        (0.5 * width, -_WALL_M, 0.5 * width, _WALL_M),
        (0.5 * width, height + _WALL_M, 0.5 * width, _WALL_M),
        (-_WALL_M, 0.5 * height, _WALL_M, 0.5 * height),
        (width + _WALL_M, 0.5 * height, _WALL_M, 0.5 * height),
    ):
        boxes.append(_box("wall", x, y, half_x, half_y))
    for x, y, radius in yard.pillars.tolist():
        boxes.append(_box("shelf", x, y, radius / math.sqrt(2.0), radius / math.sqrt(2.0)))
    return Scene(
        size_m=yard.size_m,
        boxes=tuple(boxes),
        car_kinds=(usual_car(),),
        car_start=car_start,
        arms=ArmTeam.of(()),
        arm_base=np.empty((0, 4)),
        arm_start=np.empty((0, 0)),
    )


def _box(kind: str, x: float, y: float, half_x: float, half_y: float) -> StaticBox:
    return StaticBox(kind=kind, centre_m=(x, y, 0.5 * _HEIGHT_M), half_m=(half_x, half_y, 0.5 * _HEIGHT_M))
