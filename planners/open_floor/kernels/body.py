"""Body: rectangles and discs that touch, for the kernels of the planner."""

from __future__ import annotations

import math
from typing import NamedTuple

from planners.open_floor.kernels.kernel import kernel
from planners.open_floor.problem import CarOutline


class CarBody(NamedTuple):
    """A car as kernels take it [m]."""

    centre: float
    """Of the rectangle, ahead of the rear axle."""
    half_length: float
    half_width: float
    reach: float
    """Of a corner from the centre of the rectangle."""


def body_of(car: CarOutline) -> CarBody:
    """The rectangle of a car."""
    half_length = 0.5 * (car.front_m + car.rear_m)
    return CarBody(
        centre=0.5 * (car.front_m - car.rear_m),
        half_length=half_length,
        half_width=car.half_width_m,
        reach=math.hypot(half_length, car.half_width_m),
    )


@kernel
def bodies_touch(
    x1: float, y1: float, cos1: float, sin1: float, x2: float, y2: float, cos2: float, sin2: float,
    body: CarBody, margin: float,
) -> bool:  # fmt: skip
    """Whether two cars come nearer than a margin, by the separating axes of their rectangles.

    Near corners the margin is a little more than was asked for.
    """
    dx = x2 + body.centre * cos2 - x1 - body.centre * cos1
    dy = y2 + body.centre * sin2 - y1 - body.centre * sin1
    far = 2.0 * body.reach + 1.5 * margin
    if dx * dx + dy * dy > far * far:
        return False
    cos, sin = abs(cos1 * cos2 + sin1 * sin2), abs(cos1 * sin2 - sin1 * cos2)
    along = body.half_length * (1.0 + cos) + body.half_width * sin + margin
    across = body.half_width * (1.0 + cos) + body.half_length * sin + margin
    return (
        abs(dx * cos1 + dy * sin1) <= along
        and abs(dy * cos1 - dx * sin1) <= across
        and abs(dx * cos2 + dy * sin2) <= along
        and abs(dy * cos2 - dx * sin2) <= across
    )


@kernel
def body_meets_disc(
    x: float, y: float, cos: float, sin: float, disc_x: float, disc_y: float, radius: float, body: CarBody
) -> bool:
    """Whether a car touches a disc."""
    dx, dy = disc_x - x - body.centre * cos, disc_y - y - body.centre * sin
    along = max(abs(dx * cos + dy * sin) - body.half_length, 0.0)
    across = max(abs(dy * cos - dx * sin) - body.half_width, 0.0)
    return along * along + across * across < radius * radius
