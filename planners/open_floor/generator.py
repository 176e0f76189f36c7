"""Generator: problems on an open floor in the manner of published ones, legal by construction."""

from __future__ import annotations

import numpy as np

from planners.open_floor.arrays import FloatArray
from planners.open_floor.problem import BENCHMARK_CAR, CarOutline, OpenFloorError, OpenFloorProblem

_EDGE_M = (3.0, 5.0)
"""Kept free along the sides through (0, 0), and along the others [m]."""
_DISC_M = 0.8
_TRIES = 10_000


def generate_open_floor(
    size_m: float, n_cars: int, n_discs: int, *, seed: int, car: CarOutline = BENCHMARK_CAR
) -> OpenFloorProblem:
    """Scatter obstacles, starts and goals, of any heading, over a square floor.

    Starts are so far apart that cars could turn on the spot, and so are goals; so is each goal from its own start, and
    every start and goal is as clear of obstacles.

    Args:
        size_m: Side of the floor [m].
        n_cars: Number of cars.
        n_discs: Number of obstacles of 0.8 m radius.
        seed: The same seed gives the same problem.
        car: Shape of the cars.

    Returns:
        The problem.

    Raises:
        OpenFloorError: There is no room for so many.

    Source: the manner is that of the instances with any heading in https://github.com/YangSVM/CSDOTrajectoryPlanning:
        places from 3 m to 5 m before the opposite side, and 4.47 m, twice the reach of a car, between cars.
    """
    rng = np.random.default_rng(seed)
    reach = float(np.hypot(max(car.front_m, car.rear_m), car.half_width_m))
    discs = np.column_stack([rng.uniform(0.0, size_m, (n_discs, 2)), np.full(n_discs, _DISC_M)])
    starts = _scattered(rng, size_m, n_cars, reach, discs, np.empty((0, 3)))
    goals = _scattered(rng, size_m, n_cars, reach, discs, starts)
    return OpenFloorProblem(size_m=(size_m, size_m), car=car, starts=starts, goals=goals, discs=discs)


def _scattered(
    rng: np.random.Generator, size_m: float, n: int, reach: float, discs: FloatArray, away: FloatArray
) -> FloatArray:
    """Poses apart from each other and from obstacles, the k-th also from the k-th of `away` if there is one."""
    poses = np.empty((n, 3))
    done = 0
    for _ in range(_TRIES):
        if done == n:
            return poses
        x, y = rng.uniform(_EDGE_M[0], size_m - _EDGE_M[1], 2)
        others = np.concatenate([poses[:done, :2], away[done : done + 1, :2]])
        clear = np.hypot(discs[:, 0] - x, discs[:, 1] - y) > discs[:, 2] + reach
        if clear.all() and (np.hypot(others[:, 0] - x, others[:, 1] - y) > 2.0 * reach).all():
            poses[done] = x, y, rng.uniform(-np.pi, np.pi)
            done += 1
    raise OpenFloorError(f"open floor: {n} cars on {size_m} m x {size_m} m; valid: fewer, {done} found a place")
