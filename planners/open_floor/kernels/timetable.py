"""Timetable: where the cars that have a way are at every time, found by place."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.open_floor.arrays import FloatArray, IntArray
from planners.open_floor.kernels.body import CarBody, bodies_touch
from planners.open_floor.kernels.kernel import kernel

NOBODY = -1
NEVER, FOR_GOOD = -1, 1 << 40
"""Times at which nobody is somewhere, and after which somebody is there for good."""


class WayTable(NamedTuple):
    """Samples of all ways at equal times, and for each step a hash of the places where cars are in its middle."""

    pose: FloatArray
    """x, y, cosine and sine of the yaw at each sample, shape (n_cars, n_steps * checks + 1, 4)."""
    n_samples: IntArray
    """Samples of each way; at later times a car is where the last one is. 0 = the car has no way. Shape (n_cars,)."""
    first: npt.NDArray[np.int32]
    """A car in each bucket at each step, or `NOBODY`, shape (n_steps, n_buckets)."""
    following: npt.NDArray[np.int32]
    """The car behind each in the same bucket, shape (n_cars, n_steps)."""
    bucket: npt.NDArray[np.int32]
    """Bucket of each car at each step, shape (n_cars, n_steps)."""
    side: float
    """Of a bucket [m]."""
    n_across: int
    n_up: int
    checks: int
    """Samples of a step."""
    reach: float
    """Most that two cars can be apart in the middle of a step if they touch in it [m]."""

    @property
    def n_steps(self) -> int:
        """Steps that there is room for."""
        return len(self.first)


def empty_timetable(
    n_cars: int, n_steps: int, size_m: tuple[float, float], body: CarBody, step_m: float, margin_m: float, checks: int
) -> WayTable:
    """A timetable of cars that have no way yet.

    Args:
        n_cars: Number of cars.
        n_steps: Steps that there is room for.
        size_m: Of the floor [m].
        body: Of the cars.
        step_m: Most that a car drives in a step [m].
        margin_m: Kept between cars [m].
        checks: Samples of a step.
    """
    # Each centre is at most half a step, and what it swings out in turning, from where it is in the middle.
    reach = 2.0 * (body.reach + margin_m) + 1.5 * step_m
    side = reach
    n_across, n_up = (max(1, math.ceil(length / side)) for length in size_m)
    return WayTable(
        pose=np.zeros((n_cars, n_steps * checks + 1, 4)),
        n_samples=np.zeros(n_cars, dtype=np.int64),
        first=np.full((n_steps, n_across * n_up), NOBODY, dtype=np.int32),
        following=np.full((n_cars, n_steps), NOBODY, dtype=np.int32),
        bucket=np.full((n_cars, n_steps), NOBODY, dtype=np.int32),
        side=side,
        n_across=n_across,
        n_up=n_up,
        checks=checks,
        reach=reach,
    )


def longer(table: WayTable, n_steps: int) -> WayTable:
    """The same timetable with room for more steps."""
    more = n_steps - table.n_steps
    n_cars = len(table.n_samples)
    grown = table._replace(
        pose=np.concatenate([table.pose, np.zeros((n_cars, more * table.checks, 4))], axis=1),
        n_samples=np.zeros_like(table.n_samples),
        first=np.full((n_steps, table.first.shape[1]), NOBODY, dtype=np.int32),
        following=np.full((n_cars, n_steps), NOBODY, dtype=np.int32),
        bucket=np.full((n_cars, n_steps), NOBODY, dtype=np.int32),
    )
    for car in np.flatnonzero(table.n_samples):
        enter(grown, int(car), int(table.n_samples[car]))
    return grown


@kernel
def enter(table: WayTable, car: int, n_samples: int) -> None:
    """Let a car have the way whose samples stand in `pose`."""
    table.n_samples[car] = n_samples
    for step in range(table.first.shape[0]):
        k = min(step * table.checks + table.checks // 2, n_samples - 1)
        b = _bucket(table, table.pose[car, k, 0], table.pose[car, k, 1])
        table.bucket[car, step] = b
        table.following[car, step] = table.first[step, b]
        table.first[step, b] = car


@kernel
def leave(table: WayTable, car: int) -> None:
    """Take a car's way out."""
    table.n_samples[car] = 0
    for step in range(table.first.shape[0]):
        b = table.bucket[car, step]
        if table.first[step, b] == car:
            table.first[step, b] = table.following[car, step]
            continue
        other = table.first[step, b]
        while table.following[other, step] != car:
            other = table.following[other, step]
        table.following[other, step] = table.following[car, step]


@kernel
def cars_near(table: WayTable, x: float, y: float, step: int, radius: float, found: IntArray) -> int:
    """Fill in the cars whose axles are within a radius of a place in the middle of a step; returns how many."""
    step = min(step, table.first.shape[0] - 1)
    n = 0
    k = step * table.checks + table.checks // 2
    for i in range(_column(table, x - radius), _column(table, x + radius) + 1):
        for j in range(_row(table, y - radius), _row(table, y + radius) + 1):
            car = table.first[step, i * table.n_up + j]
            while car != NOBODY:
                at = min(k, table.n_samples[car] - 1)
                dx, dy = table.pose[car, at, 0] - x, table.pose[car, at, 1] - y
                if dx * dx + dy * dy < radius * radius:
                    found[n] = car
                    n += 1
                car = table.following[car, step]
    return n


@kernel
def touches(
    table: WayTable, car: int, sample: int, x: float, y: float, cos: float, sin: float, body: CarBody, margin: float
) -> bool:
    """Whether a pose is nearer than the margin to a car at a sample."""
    pose = table.pose
    k = min(sample, table.n_samples[car] - 1)
    return bodies_touch(
        x, y, cos, sin, pose[car, k, 0], pose[car, k, 1], pose[car, k, 2], pose[car, k, 3], body, margin
    )


@kernel
def last_touch(
    table: WayTable, car: int, x: float, y: float, cos: float, sin: float, body: CarBody, margin: float
) -> int:
    """Last sample at which a car is nearer than the margin to a pose; `NEVER`, or `FOR_GOOD` if it stays there."""
    end = table.n_samples[car] - 1
    far = 2.0 * (body.reach + abs(body.centre) + margin)
    for k in range(end, -1, -1):
        dx, dy = table.pose[car, k, 0] - x, table.pose[car, k, 1] - y
        if dx * dx + dy * dy < far * far and touches(table, car, k, x, y, cos, sin, body, margin):
            return FOR_GOOD if k == end else k
    return NEVER


@kernel
def cars_in_the_way(table: WayTable, car: int, body: CarBody, margin: float, near: IntArray, hit: IntArray) -> int:
    """Fill in the other cars that come nearer than the margin to a car on its way or at its end; returns how many."""
    n = 0
    last = 0
    for other in range(len(table.n_samples)):
        last = max(last, table.n_samples[other])
    for step in range(last // table.checks + 2):
        k = min(step * table.checks + table.checks // 2, table.n_samples[car] - 1)
        x, y = table.pose[car, k, 0], table.pose[car, k, 1]
        for i in range(cars_near(table, x, y, step, table.reach + 2.0 * abs(body.centre), near)):
            other = near[i]
            known = other == car
            for j in range(n):
                known = known or hit[j] == other
            if not known and _meet_in(table, car, other, step, body, margin):
                hit[n] = other
                n += 1
    return n


@kernel
def _meet_in(table: WayTable, car: int, other: int, step: int, body: CarBody, margin: float) -> bool:
    """Whether two cars come nearer than the margin in a step."""
    pose = table.pose
    for k in range(step * table.checks, (step + 1) * table.checks + 1):
        i = min(k, table.n_samples[car] - 1)
        x, y, cos, sin = pose[car, i, 0], pose[car, i, 1], pose[car, i, 2], pose[car, i, 3]
        if touches(table, other, k, x, y, cos, sin, body, margin):
            return True
    return False


@kernel
def _bucket(table: WayTable, x: float, y: float) -> int:
    return _column(table, x) * table.n_up + _row(table, y)


@kernel
def _column(table: WayTable, x: float) -> int:
    return min(max(int(x / table.side), 0), table.n_across - 1)


@kernel
def _row(table: WayTable, y: float) -> int:
    return min(max(int(y / table.side), 0), table.n_up - 1)
