"""Crossings: who passes first where ways cross, however late the cars are.

A way is a row of samples. A car may come to a sample once every other car has passed all samples of its own way that
are in conflict with it and that it was planned to pass before. What waits for what follows the order of planned times,
so nobody waits in a ring.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.open_floor.arrays import FloatArray, IntArray
from planners.open_floor.kernels.body import CarBody, bodies_touch
from planners.open_floor.kernels.kernel import kernel

STUCK, NO_ROOM = -1, -2


class CrossingWays(NamedTuple):
    """The ways that cars are on."""

    pose: FloatArray
    """x, y, cosine and sine of the yaw at each sample, shape (n_cars, most, 4)."""
    n_samples: IntArray
    """Samples of each way, >= 1; the car stays at the last one. Shape (n_cars,)."""
    need: npt.NDArray[np.int32]
    """Sample that car j has to have come to before car i may come to its sample k, never less than that of k - 1, shape
    (n_cars, n_cars, most) for i, j, k."""


@kernel
def foresee(ways: CrossingWays, now: IntArray, at: npt.NDArray[np.int32], arrival: IntArray) -> int:
    """Let all cars drive on, a sample in each tick as long as they need not wait.

    Args:
        ways: The ways.
        now: Sample that each car is at, shape (n_cars,).
        at: Filled with the sample of each car at each tick, shape (n_cars, n_ticks).
        arrival: Filled with the tick at which each comes to its last sample, shape (n_cars,).

    Returns:
        Ticks until all have arrived; `STUCK` if they never do, `NO_ROOM` if `at` is too short.
    """
    n_cars = len(now)
    left = 0
    for car in range(n_cars):
        at[car, 0], arrival[car] = now[car], 0
        left += 1 if now[car] < ways.n_samples[car] - 1 else 0
    tick = 0
    while left > 0:
        tick += 1
        if tick >= at.shape[1]:
            return NO_ROOM
        moved = False
        for car in range(n_cars):
            here = at[car, tick - 1]
            at[car, tick] = here
            if here == ways.n_samples[car] - 1:
                continue
            free = True
            for other in range(n_cars):
                free = free and ways.need[car, other, here + 1] <= at[other, tick - 1]
            if free:
                at[car, tick] = here + 1
                moved = True
                if here + 1 == ways.n_samples[car] - 1:
                    arrival[car] = tick
                    left -= 1
        if not moved:
            return STUCK
    return tick


@kernel
def order(
    ways: CrossingWays,
    car: int,
    granted: IntArray,
    at: npt.NDArray[np.int32],
    n_ticks: int,
    span: float,
    body: CarBody,
    margin: float,
) -> bool:
    """Note who passes first where the new way of a car crosses those of others.

    Args:
        ways: The ways; `need` is set for this car, and raised for the others where they have to let it pass.
        car: Whose way is new: it is at its sample k at tick k, and no other car has to wait for it yet.
        granted: Sample that each other car may come to, whatever is planned now, shape (n_cars,).
        at: Sample of each other car at each tick, as `foresee` fills it.
        n_ticks: Ticks that are filled; afterwards all stand.
        span: Most that a car drives from sample to sample [m].
        body: Of the cars.
        margin: Nearer than this, samples are in conflict [m].

    Returns:
        False, with nothing noted, if the way would have to be let pass where another car has been granted to come.
    """
    n_cars = len(ways.n_samples)
    for other in range(n_cars):
        if other != car and not _ordered(ways, car, other, granted, at, n_ticks, span, body, margin, False):
            return False
    for other in range(n_cars):
        for k in range(ways.n_samples[car]):
            ways.need[car, other, k] = 0
        if other != car:
            _ordered(ways, car, other, granted, at, n_ticks, span, body, margin, True)
            for k in range(1, ways.n_samples[car]):
                ways.need[car, other, k] = max(ways.need[car, other, k], ways.need[car, other, k - 1])
            for k in range(1, ways.n_samples[other]):
                ways.need[other, car, k] = max(ways.need[other, car, k], ways.need[other, car, k - 1])
    return True


@kernel
def _ordered(
    ways: CrossingWays,
    car: int,
    other: int,
    granted: IntArray,
    at: npt.NDArray[np.int32],
    n_ticks: int,
    span: float,
    body: CarBody,
    margin: float,
    noted: bool,
) -> bool:
    """Whether the conflicts of two ways can be ordered as planned; and, if they are to be noted, who passes first.

    Samples of the other that are too far off to matter are skipped by distance.
    """
    pose = ways.pose
    far = 2.0 * (body.reach + abs(body.centre)) + 1.5 * margin
    for k in range(ways.n_samples[car]):
        x, y, cos, sin = pose[car, k, 0], pose[car, k, 1], pose[car, k, 2], pose[car, k, 3]
        tick = 0
        while tick <= n_ticks:
            i = at[other, tick]
            dx, dy = pose[other, i, 0] - x, pose[other, i, 1] - y
            gap = np.sqrt(dx * dx + dy * dy) - far
            if gap > span:
                tick += int(gap / span)
                continue
            if tick != k and bodies_touch(
                x, y, cos, sin, pose[other, i, 0], pose[other, i, 1], pose[other, i, 2], pose[other, i, 3], body, margin
            ):
                if tick > k and i <= granted[other]:
                    return False
                if noted and tick < k:
                    ways.need[car, other, k] = max(ways.need[car, other, k], i + 1)
                elif noted:
                    ways.need[other, car, i] = max(ways.need[other, car, i], k + 1)
            tick += 1
    return True


@kernel
def grant(ways: CrossingWays, now: IntArray, granted: IntArray, most: int) -> None:
    """Raise the samples that cars may come to, as far as what they need has been passed.

    Args:
        ways: The ways.
        now: Sample that each car has come to, shape (n_cars,).
        granted: Sample that each may come to, shape (n_cars,).
        most: Samples ahead of where it is that a car is granted.
    """
    for car in range(len(now)):
        k = granted[car]
        while k < min(ways.n_samples[car] - 1, now[car] + most):
            free = True
            for other in range(len(now)):
                free = free and ways.need[car, other, k + 1] <= now[other]
            if not free:
                break
            k += 1
        granted[car] = k
