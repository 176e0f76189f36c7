"""Standing: how near cars are to each other, and to obstacles, where they start and where they end."""

from __future__ import annotations

import math
from typing import NamedTuple

from planners.open_floor.arrays import FloatArray
from planners.open_floor.kernels.body import CarBody, bodies_touch
from planners.open_floor.kernels.floor import StaticFloor, floor_of, is_free
from planners.open_floor.kernels.kernel import kernel
from planners.open_floor.problem import OpenFloorProblem

_HALVINGS = 6


class KeptMargins(NamedTuple):
    """What is kept free around cars [m]."""

    to_cars: float
    to_obstacles: float


def margins_kept(problem: OpenFloorProblem, body: CarBody, wanted_m: float) -> KeptMargins | None:
    """The margins that starts and goals leave room for: the wanted one, or that halved until it fits, or 0.

    Args:
        problem: Floor and cars.
        body: Of the cars.
        wanted_m: Margin to each other and to obstacles [m].

    Returns:
        The margins; None if cars overlap even so, or stand in an obstacle or off the floor.
    """
    tried = (*(wanted_m / 2**k for k in range(_HALVINGS)), 0.0)
    ends = problem.starts, problem.goals
    to_cars = next((margin for margin in tried if all(_are_apart(poses, body, margin) for poses in ends)), None)
    floors = ((margin, floor_of(problem, body, margin)) for margin in tried)
    to_obstacles = next((margin for margin, floor in floors if all(are_free(p, floor, body) for p in ends)), None)
    return None if to_cars is None or to_obstacles is None else KeptMargins(to_cars, to_obstacles)


@kernel
def are_free(poses: FloatArray, floor: StaticFloor, body: CarBody) -> bool:
    """Whether cars at some poses (n, 3) stand on the floor and clear of obstacles."""
    for k in range(len(poses)):
        if not is_free(poses[k, 0], poses[k, 1], math.cos(poses[k, 2]), math.sin(poses[k, 2]), floor, body):
            return False
    return True


@kernel
def _are_apart(poses: FloatArray, body: CarBody, margin: float) -> bool:
    """Whether of cars at some poses (n, 3) no two are nearer than the margin."""
    for a in range(len(poses)):
        cos, sin = math.cos(poses[a, 2]), math.sin(poses[a, 2])
        for b in range(a):
            if bodies_touch(
                poses[a, 0], poses[a, 1], cos, sin,
                poses[b, 0], poses[b, 1], math.cos(poses[b, 2]), math.sin(poses[b, 2]), body, margin,
            ):  # fmt: skip
                return False
    return True
