"""Pods: shelves that carriers lift, carry and set down; what a run asks of them, and how they move without physics."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.robots.twist.pod import LIFT_M, LIFT_S

NO_CAR, NO_POD = -1, -1
_QUARTER_RAD = math.pi / 2


class PodLifts(Protocol):
    """The pods of a world, and the plates of the cars that lift them."""

    def poses(self) -> FloatArray:
        """Poses of the pods' frames, whose origin is below their middle at the height of their feet, shape (p, 7)."""

    def carried_by(self) -> IntArray:
        """The car that has lifted each pod, -1 for one that stands, shape (p,)."""

    def lift(self, car: int, pod: int) -> None:
        """Let a car that stands under a pod lift it from now on."""

    def lower(self, car: int) -> None:
        """Let a car set down what it has lifted from now on."""

    def put(self, pod: int, pose: FloatArray) -> None:
        """Let a pod stand at a pose x, y, yaw, shape (3,), taken off the car that had it, whose plate is down."""

    def is_up(self, car: int) -> bool:
        """Whether a car has lifted a pod, so that it may drive."""

    def is_down(self, car: int) -> bool:
        """Whether a car's plate is down, so that it may drive from under a pod."""


class PlanarPodsSnapshot(NamedTuple):
    """State of `PlanarPods` at one instant."""

    poses: FloatArray
    offsets: FloatArray
    pod_of: IntArray
    heights: FloatArray
    rises: FloatArray


class PlanarPods:
    """`PodLifts` without physics: a pod that has left the floor moves with its car.

    While the plate rises, its pins find the cones below the pod and draw that to the middle of the plate, square to it:
    where a pod is set down depends on where its car stands, and errors of many carriages do not add up.

    Attributes:
        planar: Poses x, y, yaw of the pods, shape (p, 3).

    Args:
        start: Where they stand, shape (p, 3).
        n_cars: Number of cars.
        tick_s: Length of a tick [s].
    """

    def __init__(self, start: FloatArray, n_cars: int, tick_s: float) -> None:
        self.planar = np.array(start, dtype=np.float64).reshape(-1, 3)
        self._offsets = np.zeros((n_cars, 3))  # of the pod in the car's frame
        self._pod_of = np.full(n_cars, NO_POD, dtype=np.int64)
        self._heights = np.zeros(n_cars)  # of the plates, as shares of the stroke
        self._rises = np.zeros(n_cars)  # their directions
        self._share = tick_s / LIFT_S

    def poses(self) -> FloatArray:
        """See `PodLifts`."""
        half, zeros = self.planar[:, 2] / 2, np.zeros(len(self.planar))
        z = zeros.copy()
        for car in self.loaded():
            z[self._pod_of[car]] = LIFT_M * self._heights[car]
        return np.column_stack((self.planar[:, :2], z, zeros, zeros, np.sin(half), np.cos(half)))

    def carried_by(self) -> IntArray:
        """See `PodLifts`."""
        cars = np.full(len(self.planar), NO_CAR, dtype=np.int64)
        loaded = self.loaded()
        cars[self._pod_of[loaded]] = loaded
        return cars

    def loaded(self) -> list[int]:
        """Cars with a pod on their plate, ascending."""
        found: list[int] = np.flatnonzero(self._pod_of != NO_POD).tolist()
        return found

    def lift(self, car: int, pod: int) -> None:
        """See `PodLifts`."""
        self._pod_of[car], self._rises[car] = pod, 1.0
        self._offsets[car] = np.nan

    def lower(self, car: int) -> None:
        """See `PodLifts`."""
        self._rises[car] = -1.0

    def put(self, pod: int, pose: FloatArray) -> None:
        """See `PodLifts`."""
        cars = self._pod_of == pod
        self._pod_of[cars], self._heights[cars], self._rises[cars] = NO_POD, 0.0, 0.0
        self.planar[pod] = pose

    def is_up(self, car: int) -> bool:
        """See `PodLifts`."""
        return bool(self._pod_of[car] != NO_POD and self._heights[car] >= 1.0)

    def is_down(self, car: int) -> bool:
        """See `PodLifts`."""
        return bool(self._heights[car] <= 0.0)

    def step(self, car_poses: FloatArray) -> None:
        """Move plates on, and pods with their cars; poses x, y, yaw, shape (n_cars, 3)."""
        if not self._rises.any() and not (self._pod_of != NO_POD).any():
            return
        before = self._heights
        self._heights = np.clip(before + self._share * self._rises, 0.0, 1.0)
        for car in self.loaded():
            pod = self._pod_of[car]
            if self._rises[car] < 0.0 and self._heights[car] <= 0.0:
                self._pod_of[car], self._rises[car] = NO_POD, 0.0
                continue
            if math.isnan(self._offsets[car, 0]):
                self._offsets[car] = _seen_from(car_poses[car], self.planar[pod])
            if self._heights[car] > before[car]:
                left = (1.0 - self._heights[car]) / (1.0 - before[car])
                self._offsets[car] = centred(self._offsets[car], left)
            self.planar[pod] = _moved(car_poses[car], self._offsets[car])

    def save(self) -> PlanarPodsSnapshot:
        """Copies of all that changes."""
        return PlanarPodsSnapshot(
            poses=self.planar.copy(),
            offsets=self._offsets.copy(),
            pod_of=self._pod_of.copy(),
            heights=self._heights.copy(),
            rises=self._rises.copy(),
        )

    def load(self, snapshot: PlanarPodsSnapshot) -> None:
        """Return to a saved state."""
        self.planar[:], self._offsets[:], self._pod_of[:] = snapshot.poses, snapshot.offsets, snapshot.pod_of
        self._heights[:], self._rises[:] = snapshot.heights, snapshot.rises


def centred(offset: FloatArray, left: float) -> FloatArray:
    """Where a pod is on a plate, x, y, yaw, when a share of how far it is from its middle, and askew, is left.

    Square to the plate it may be by any quarter of a turn.
    """
    square = round(offset[2] / _QUARTER_RAD) * _QUARTER_RAD
    return np.array([left * offset[0], left * offset[1], square + left * (offset[2] - square)])


def _seen_from(car: FloatArray, pod: FloatArray) -> FloatArray:
    """A pose in the frame of another one, both x, y, yaw, shape (3,)."""
    cos, sin = math.cos(car[2]), math.sin(car[2])
    x, y = pod[:2] - car[:2]
    return np.array([cos * x + sin * y, cos * y - sin * x, pod[2] - car[2]])


def _moved(car: FloatArray, offset: FloatArray) -> FloatArray:
    """The inverse of `_seen_from`."""
    cos, sin = math.cos(car[2]), math.sin(car[2])
    x, y, yaw = offset
    return np.array([car[0] + cos * x - sin * y, car[1] + sin * x + cos * y, math.remainder(car[2] + yaw, math.tau)])
