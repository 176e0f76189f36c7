"""Pose estimator: noisy, late pose measurements and wheel odometry become the pose that cars steer by."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray
from fleet.robots.angle import wrapped
from fleet.robots.cars.models import CarModels

ODOMETRY_M = 0.008
"""Growth of the position error per square root of a metre driven [m]: a correction gain near 0.1 at 1 m/s and 60 Hz."""
ODOMETRY_RAD = math.radians(0.4)
"""Growth of the heading error per square root of a metre driven [rad]."""
STANDING_M, STANDING_RAD = 0.0005, math.radians(0.02)
"""Growth per square root of a second, standing or not: keeps a standing car's filter awake."""
SURPRISE = 5.0
"""An innovation beyond this many standard deviations means that the car was moved; the filter then starts over."""
DOUBT = 7.0
"""One beyond this many may also be a wrong measurement: chance alone makes one in 200,000 hours of a car at 60 Hz."""
DOUBTS_ON = 40
"""After one, whatever is a surprise is doubted for so many ticks more."""
AGREES = 3.0 * math.sqrt(2.0)
"""Two doubtful measurements tell the same if they differ by no more than so many standard deviations of one."""
MOVED_AFTER = 4
"""So many doubtful ones in a row that tell the same are believed. Those before are left out, and the car is told to
brake: a burst of noise passes while it stands."""

BLOCK_TICKS = 64
"""Ticks whose noise is drawn at once."""


class _Filter(NamedTuple):
    """What the filter knows; arrays over the last ticks have a slot for each tick of latency and one for now."""

    tick_s: float
    wheelbase: FloatArray
    """Of each car, 0 = it is told a yaw rate, shape (n,)."""
    sigma: FloatArray
    """Standard deviations of a measurement's x, y, yaw, shape (3,)."""
    truth: FloatArray
    """Poses at the last ticks, shape (l, n, 3)."""
    odometry: FloatArray
    """Ways and turns in the last ticks, shape (l, n, 2)."""
    motion: FloatArray
    """Speed, and steering or yaw rate, at the last tick, shape (n, 2)."""
    past: FloatArray
    """Estimate of the measured instant, shape (n, 3)."""
    variance: FloatArray
    """Of its place and of its yaw, shape (n, 2)."""
    doubt: FloatArray
    """How many doubtful measurements in a row tell the same, the last one's x, y, yaw, and for how many ticks whatever
    is a surprise is doubted, shape (n, 5)."""


class PoseEstimator:
    """Estimates all car poses from measurements that are white noise around the truth some ticks ago.

    Each tick the bicycle model carries the estimate of the measured instant one tick on, the measurement corrects it,
    and the odometry since then carries the result to now. Gains follow from scalar variances per car that grow with
    the distance driven: steady while driving, falling while standing. Without noise and latency it returns the truth.

    Args:
        models: Models of the cars.
        tick_s: Period of `update` [s].
        noise_m: Standard deviation of x and of y of a measurement [m].
        noise_rad: Standard deviation of its yaw [rad].
        latency_ticks: Age of a measurement when it arrives.
        rng: Source of the noise.

    Source: the scalar Kalman filter, e.g. S. Thrun, W. Burgard, D. Fox, "Probabilistic Robotics", MIT Press 2005, 3.2.
    """

    def __init__(
        self,
        models: CarModels,
        tick_s: float,
        *,
        noise_m: float = 0.01,
        noise_rad: float = math.radians(0.5),
        latency_ticks: int = 1,
        rng: np.random.Generator,
    ) -> None:
        self._rng, n_cars = rng, len(models)
        self._noises = np.zeros((BLOCK_TICKS, n_cars, 3))
        self._blur = np.ones((n_cars, 1))
        self._blurred = False
        self.any_in_doubt = False
        """Whether the last measurement of any car is not believed."""
        self._tick = 0
        self._filter = _Filter(
            tick_s=tick_s,
            wheelbase=models.each("turn_base_m"),
            sigma=np.array([noise_m, noise_m, noise_rad]),
            truth=np.zeros((latency_ticks + 1, n_cars, 3)),
            odometry=np.zeros((latency_ticks + 1, n_cars, 2)),
            motion=np.zeros((n_cars, 2)),
            past=np.zeros((n_cars, 3)),
            variance=np.zeros((n_cars, 2)),
            doubt=np.zeros((n_cars, 5)),
        )

    def blur(self, car: int, factor: float) -> None:
        """Let measurements of a car be so many times as noisy from now on; the filter does not know."""
        self._blur[car] = factor
        self._blurred = bool((self._blur != 1.0).any())

    @property
    def in_doubt(self) -> BoolArray:
        """Cars whose last measurement is not believed, shape (n_cars,): they had better brake."""
        in_doubt: BoolArray = self._filter.doubt[:, 0] > 0.0
        return in_doubt

    def update(self, true_poses: FloatArray, speeds: FloatArray, steering: FloatArray) -> FloatArray:
        """Take one tick's measurements.

        The first call tells the estimator where the cars are put up, so its answer is exact.

        Args:
            true_poses: Rear-axle poses x, y, yaw now, shape (n_cars, 3); what is measured, not what is known.
            speeds: Measured signed forward speeds [m/s], shape (n_cars,).
            steering: Measured steering angles [rad], or yaw rates [rad/s], shape (n_cars,).

        Returns:
            Estimated poses now, shape (n_cars, 3).
        """
        known = self._filter
        if self._tick == 0:
            known.truth[:] = true_poses
            known.past[:] = true_poses
            known.motion[:, 0], known.motion[:, 1] = speeds, steering
        if self._tick % BLOCK_TICKS == 0:
            # Drawing for many ticks at once gives the same numbers as drawing tick by tick.
            self._rng.standard_normal(out=self._noises)
            self._noises *= known.sigma
        if self._tick == 0:
            self._noises[0] = 0.0
        estimate = np.empty_like(known.past)
        noise = self._noises[self._tick % BLOCK_TICKS]
        if self._blurred:
            noise = noise * self._blur
        self.any_in_doubt = bool(_estimate(known, self._tick, true_poses, speeds, steering, noise, estimate))
        self._tick += 1
        return estimate


@njit(cache=True)
def _advance(poses: FloatArray, car: int, distance: float, turn: float) -> None:
    if distance == 0.0 and turn == 0.0:  # most cars stand
        return
    middle = poses[car, 2] + 0.5 * turn
    poses[car, 0] += distance * math.cos(middle)
    poses[car, 1] += distance * math.sin(middle)
    poses[car, 2] += turn


@njit(cache=True)
def _tells_the_same(doubt: FloatArray, dx: float, dy: float, turn: float, sigma: FloatArray) -> bool:
    """Take in a doubtful measurement; returns whether enough in a row tell the same."""
    near = math.hypot(dx - doubt[1], dy - doubt[2]) <= AGREES * sigma[0] or sigma[0] == 0.0
    alike = abs(wrapped(turn - doubt[3])) <= AGREES * sigma[2] or sigma[2] == 0.0
    doubt[0] = doubt[0] + 1.0 if doubt[0] > 0.0 and near and alike else 1.0
    doubt[1], doubt[2], doubt[3] = dx, dy, turn
    return doubt[0] >= MOVED_AFTER


@njit(cache=True)
def _estimate(
    known: _Filter,
    tick: int,
    true_poses: FloatArray,
    speeds: FloatArray,
    steering: FloatArray,
    noise: FloatArray,
    estimate: FloatArray,
) -> bool:
    """Take one tick's measurements of all cars, and fill in the estimated poses now; tells whether any is in doubt."""
    any_in_doubt = False
    tick_s, wheelbase, sigma, truth, odometry, motion, past, variance, doubt = known
    n_slots = len(truth)
    now, oldest = tick % n_slots, (tick + 1) % n_slots
    for i in range(len(true_poses)):
        for axis in range(3):
            truth[now, i, axis] = true_poses[i, axis]
        # Odometry of the tick that just ended: speed and steering change linearly inside it.
        distance = 0.5 * (motion[i, 0] + speeds[i]) * tick_s
        odometry[now, i, 0] = distance
        odometry[now, i, 1] = 0.0
        if wheelbase[i] == 0.0:
            odometry[now, i, 1] = 0.5 * (motion[i, 1] + steering[i]) * tick_s
        elif distance != 0.0:
            odometry[now, i, 1] = distance * math.tan(0.5 * (motion[i, 1] + steering[i])) / wheelbase[i]
        motion[i, 0], motion[i, 1] = speeds[i], steering[i]

        driven = abs(odometry[oldest, i, 0])
        _advance(past, i, odometry[oldest, i, 0], odometry[oldest, i, 1])
        variance[i, 0] += ODOMETRY_M**2 * driven + STANDING_M**2 * tick_s
        variance[i, 1] += ODOMETRY_RAD**2 * driven + STANDING_RAD**2 * tick_s

        dx = truth[oldest, i, 0] + noise[i, 0] - past[i, 0]
        dy = truth[oldest, i, 1] + noise[i, 1] - past[i, 1]
        turn = wrapped(truth[oldest, i, 2] + noise[i, 2] - past[i, 2])
        off_2, place_2 = dx * dx + dy * dy, variance[i, 0] + sigma[0] ** 2
        turn_2, yaw_2 = turn * turn, variance[i, 1] + sigma[2] ** 2
        bound = SURPRISE**2 if doubt[i, 4] > 0.0 else DOUBT**2
        doubtful = (sigma[0] > 0.0 and off_2 > bound * place_2) or (sigma[2] > 0.0 and turn_2 > bound * yaw_2)
        doubt[i, 4] = DOUBTS_ON if doubtful else max(doubt[i, 4] - 1.0, 0.0)
        if not doubtful or _tells_the_same(doubt[i], dx, dy, turn, sigma):
            doubt[i, 0] = 0.0
            variance[i, 0] += off_2 * (off_2 > SURPRISE**2 * place_2)
            variance[i, 1] += turn_2 * (turn_2 > SURPRISE**2 * yaw_2)
            if sigma[0] > 0.0:
                gain = variance[i, 0] / (variance[i, 0] + sigma[0] ** 2)
                variance[i, 0] *= 1.0 - gain
                past[i, 0] += gain * dx
                past[i, 1] += gain * dy
            else:
                past[i, 0], past[i, 1] = truth[oldest, i, 0], truth[oldest, i, 1]
            if sigma[2] > 0.0:
                gain = variance[i, 1] / (variance[i, 1] + sigma[2] ** 2)
                variance[i, 1] *= 1.0 - gain
                past[i, 2] += gain * turn
            else:
                past[i, 2] = truth[oldest, i, 2]

        any_in_doubt = any_in_doubt or doubt[i, 0] > 0.0
        for axis in range(3):
            estimate[i, axis] = past[i, axis]
        for age in range(1, n_slots):
            slot = (oldest + age) % n_slots
            _advance(estimate, i, odometry[slot, i, 0], odometry[slot, i, 1])
    return any_in_doubt
