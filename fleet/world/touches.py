"""Touches: which bodies touch in the plane, and how close robots came, looked at anew only where something moved."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.world.arms import ServoArms

BIN_M = 1.0
"""Edge of the square bins in which boxes are looked up [m]."""
KIND_SHIFT = 40
"""What a touch is between lies above this bit of its code."""
CAR_CAR, CAR_ARM, ARM_ARM, STATIC = 0, 1, 2, 3
FIRST_SHIFT = 20
"""The first body of a touch lies above this bit, below its kind."""
_SECOND = (1 << FIRST_SHIFT) - 1


class Body(NamedTuple):
    """The bodies of cars round their rear axles [m], shape (n_cars,) each."""

    shift: FloatArray
    """From the axle to its middle."""
    length: FloatArray
    """Half of it."""
    width: FloatArray
    """Half of it."""
    height: FloatArray
    circle: FloatArray
    """Radius of the circle round it, as seen from above."""
    widest: float
    """The greatest of these, 0 without cars."""


class BinnedBoxes(NamedTuple):
    """Boxes in bins, as compressed rows: those of bin (ix, iy) are ``box[ptr[b]:ptr[b + 1]]``, b = iy n_x + ix."""

    rows: FloatArray
    """Centre and half edges x, y, shape (k, 4)."""
    keys: IntArray
    """What a box is called among those that touch, shape (k,)."""
    ptr: IntArray
    box: IntArray
    n_x: int
    n_y: int


class ArmBalls(NamedTuple):
    """Arms as spheres."""

    spheres: FloatArray
    """Centre and radius of each, the last one round what is held, radius < 0 for none, shape (m, k, 4)."""
    xy: FloatArray
    """Where arms stand, shape (m, 2)."""
    serving: IntArray
    """Car that each arm serves, -1 for none, shape (m,)."""
    reach: float


class _Seen(NamedTuple):
    """What was looked at last, and what has moved since."""

    cars: FloatArray
    """Poses x, y, yaw, shape (n, 3)."""
    frame: FloatArray
    """Centre x, y of each car's body, cos and sin of its yaw, shape (n, 4)."""
    by_x: IntArray
    """Cars in the order of their centres along x, shape (n,)."""
    car_moved: BoolArray
    serving: IntArray
    """As in `ArmBalls`, shape (m,)."""
    q: FloatArray
    """Joint positions [rad], shape (m, n_joints)."""
    arm_moved: BoolArray


def robots_of(code: int) -> tuple[list[int], list[int]]:
    """Cars and arms that a touch is one of, by its code in `Touches.codes`."""
    kind, a, b = code >> KIND_SHIFT, (code >> FIRST_SHIFT) & _SECOND, code & _SECOND
    if kind == CAR_CAR:
        return [a, b], []
    if kind == CAR_ARM:
        return [a], [b]
    return ([], [a, b]) if kind == ARM_ARM else ([a], [])


class Touches:
    """The touches of one tick after the other.

    Bodies that both rest touch as they did before, and came no closer.

    Attributes:
        clearance_m: Smallest clearance of robots so far [m]; infinite until two were compared.
        codes: Codes of all pairs that touch now, in no order: the kind above `KIND_SHIFT`, then both bodies.

    Args:
        bodies: What cars look like.
        arms: The arms.
        balls: Their spheres, which are brought to where the arms are.
    """

    def __init__(self, bodies: Body, arms: ServoArms, balls: ArmBalls) -> None:
        self._bodies = bodies
        self._arms = arms
        self._balls = balls
        self.clearance_m = math.inf
        self.codes = np.zeros(0, dtype=np.int64)
        self._room = np.zeros(256, dtype=np.int64)
        self._seen: _Seen | None = None

    def forget(self) -> None:
        """Look at everything anew: boxes have changed, or robots are elsewhere."""
        self._seen = None

    def look(self, car_poses: FloatArray, held: FloatArray, boxes: BinnedBoxes) -> None:
        """Find out what touches now.

        Args:
            car_poses: Rear-axle poses x, y, yaw, shape (n_cars, 3).
            held: Spheres x, y, z, radius round the held parcels, radius < 0 for none, shape (n_arms, 4).
            boxes: What stands on the floor.
        """
        if self._seen is None:
            self._seen = self._nothing_seen(car_poses)
        seen, bodies, balls = self._seen, self._bodies, self._balls
        _look_around(seen, bodies, car_poses, balls, self._arms.q, self._arms.points, held)
        while True:
            n_codes, clearance = _touches(seen, bodies, boxes, balls, self.clearance_m, self.codes, self._room)
            if n_codes <= len(self._room):
                break
            self._room = np.zeros(2 * n_codes, dtype=np.int64)
        self.clearance_m = clearance
        self.codes = self._room[:n_codes].copy()

    def _nothing_seen(self, car_poses: FloatArray) -> _Seen:
        """Nothing rests: no number equals NaN."""
        n_cars = len(car_poses)
        self.codes = self.codes[:0]
        return _Seen(
            cars=np.full((n_cars, 3), np.nan),
            frame=np.zeros((n_cars, 4)),
            by_x=np.argsort(car_poses[:, 0]),
            car_moved=np.ones(n_cars, dtype=np.bool_),
            serving=self._balls.serving.copy(),
            q=np.full_like(self._arms.q, np.nan),
            arm_moved=np.ones(len(self._arms.q), dtype=np.bool_),
        )


class _Rectangle(NamedTuple):
    """A rectangle anywhere in the plane."""

    x: float
    y: float
    cos: float
    sin: float
    length: float
    """Half of it [m]."""
    width: float
    """Half of it [m]."""


@njit(cache=True)
def _corner_gap(a: _Rectangle, b: _Rectangle) -> tuple[float, bool]:
    """Smallest distance from the corners of rectangle a to rectangle b, and whether an axis of b parts them."""
    best, low_u, high_u, low_v, high_v = math.inf, math.inf, -math.inf, math.inf, -math.inf
    for k in range(4):
        du = a.length if k < 2 else -a.length
        dv = a.width if k % 2 == 0 else -a.width
        x, y = a.x + a.cos * du - a.sin * dv - b.x, a.y + a.sin * du + a.cos * dv - b.y
        u, v = b.cos * x + b.sin * y, b.cos * y - b.sin * x
        low_u, high_u, low_v, high_v = min(low_u, u), max(high_u, u), min(low_v, v), max(high_v, v)
        best = min(best, math.hypot(max(abs(u) - b.length, 0.0), max(abs(v) - b.width, 0.0)))
    parted = low_u > b.length or high_u < -b.length or low_v > b.width or high_v < -b.width
    return best, parted


@njit(cache=True)
def _rectangle_gap(a: _Rectangle, b: _Rectangle) -> float:
    """Distance of two rectangles, 0 if they overlap.

    Rectangles that no side of either parts overlap (separating axes); else a corner of one is nearest to the other.
    """
    gap_a, parted_a = _corner_gap(a, b)
    gap_b, parted_b = _corner_gap(b, a)
    return min(gap_a, gap_b) if parted_a or parted_b else 0.0


@njit(cache=True)
def _note(codes: IntArray, n_codes: int, kind: int, a: int, b: int) -> int:
    if n_codes < len(codes):
        codes[n_codes] = (kind << KIND_SHIFT) + (a << FIRST_SHIFT) + b
    return n_codes + 1


@njit(cache=True)
def _arm_gap(spheres: FloatArray, frame: FloatArray, length: float, width: float, height: float) -> float:
    """Distance of an arm's spheres from a car (centre, cos, sin) that stands on the floor, 0 if they overlap."""
    gap = math.inf
    for k in range(len(spheres)):
        radius = spheres[k, 3]
        if radius < 0.0:
            continue
        px, py = spheres[k, 0] - frame[0], spheres[k, 1] - frame[1]
        u = max(abs(frame[2] * px + frame[3] * py) - length, 0.0)
        v = max(abs(frame[2] * py - frame[3] * px) - width, 0.0)
        w = max(spheres[k, 2] - height, 0.0)
        gap = min(gap, max(math.sqrt(u * u + v * v + w * w) - radius, 0.0))
    return gap


@njit(cache=True)
def _overlap(a: FloatArray, b: FloatArray) -> bool:
    for k in range(len(a)):
        for m in range(len(b)):
            if a[k, 3] < 0.0 or b[m, 3] < 0.0:
                continue
            dx, dy, dz = a[k, 0] - b[m, 0], a[k, 1] - b[m, 1], a[k, 2] - b[m, 2]
            if dx * dx + dy * dy + dz * dz < (a[k, 3] + b[m, 3]) ** 2:
                return True
    return False


@njit(cache=True)
def _look_around(
    seen: _Seen,
    bodies: Body,
    car_poses: FloatArray,
    arms: ArmBalls,
    arm_q: FloatArray,
    points: FloatArray,
    held: FloatArray,
) -> None:
    """Find out what has moved, and bring frames, their order along x, and spheres to where cars and arms are."""
    cars, frame, by_x, car_moved, serving, q, arm_moved = seen
    spheres = arms.spheres
    for i in range(len(cars)):
        car_moved[i] = False
        for axis in range(3):
            if cars[i, axis] != car_poses[i, axis]:
                car_moved[i] = True
                cars[i, axis] = car_poses[i, axis]
        if car_moved[i]:
            cos, sin = math.cos(cars[i, 2]), math.sin(cars[i, 2])
            frame[i, 0], frame[i, 1] = cars[i, 0] + bodies.shift[i] * cos, cars[i, 1] + bodies.shift[i] * sin
            frame[i, 2], frame[i, 3] = cos, sin
    # By insertion: hardly any two cars change places in a tick.
    for at in range(1, len(by_x)):
        car, to = by_x[at], at
        while to > 0 and frame[by_x[to - 1], 0] > frame[car, 0]:
            by_x[to] = by_x[to - 1]
            to -= 1
        by_x[to] = car
    for a in range(len(serving)):
        arm_moved[a] = serving[a] != arms.serving[a]
        serving[a] = arms.serving[a]
        for joint in range(q.shape[1]):
            if q[a, joint] != arm_q[a, joint]:
                arm_moved[a] = True
                q[a, joint] = arm_q[a, joint]
        for axis in range(4):
            if spheres[a, -1, axis] != held[a, axis]:
                arm_moved[a] = True
                spheres[a, -1, axis] = held[a, axis]
        if arm_moved[a]:
            for k in range(points.shape[1]):
                for axis in range(3):
                    spheres[a, k, axis] = points[a, k, axis]


@njit(cache=True)
def _touches(
    seen: _Seen,
    bodies: Body,
    boxes: BinnedBoxes,
    arms: ArmBalls,
    clearance: float,
    before: IntArray,
    codes: IntArray,
) -> tuple[int, float]:
    """Fill in codes of all pairs that touch now; returns how many, room or not, and the smallest clearance so far."""
    n_codes = _keep(seen, before, codes)
    n_codes, clearance = _cars_near_cars(seen, bodies, clearance, codes, n_codes)
    n_codes = _cars_in_boxes(seen, bodies, boxes, codes, n_codes)
    n_codes, clearance = _cars_near_arms(seen, bodies, arms, clearance, codes, n_codes)
    return _arms_in_arms(seen, arms, codes, n_codes), clearance


@njit(cache=True)
def _keep(seen: _Seen, before: IntArray, codes: IntArray) -> int:
    """Note again the touches of what did not move; returns how many."""
    n_codes = 0
    for code in before:
        kind, a, b = code >> KIND_SHIFT, (code >> FIRST_SHIFT) & _SECOND, code & _SECOND
        moved = seen.arm_moved[a] if kind == ARM_ARM else seen.car_moved[a]
        if kind == CAR_CAR:
            moved = moved or seen.car_moved[b]
        elif kind != STATIC:
            moved = moved or seen.arm_moved[b]
        if not moved:
            n_codes = _note(codes, n_codes, kind, a, b)
    return n_codes


@njit(cache=True)
def _cars_near_cars(seen: _Seen, bodies: Body, clearance: float, codes: IntArray, n_codes: int) -> tuple[int, float]:
    """Compare each car that has moved with those that are near along x."""
    _, frame, by_x, moved, _, _, _ = seen
    _, length, width, _, circles, widest = bodies
    for at in range(len(by_x)):
        if not moved[by_x[at]]:
            continue
        for step in (1, -1):
            other = at + step
            while 0 <= other < len(by_x):
                i, j = min(by_x[at], by_x[other]), max(by_x[at], by_x[other])
                if abs(frame[j, 0] - frame[i, 0]) > circles[by_x[at]] + widest + clearance:
                    break
                near = circles[i] + circles[j] + clearance
                dx, dy = frame[j, 0] - frame[i, 0], frame[j, 1] - frame[i, 1]
                # Of two that have moved, the first one is compared with the second.
                again = step < 0 and moved[by_x[other]]
                other += step
                if again or dx * dx + dy * dy > near * near:
                    continue
                gap = _rectangle_gap(
                    _Rectangle(frame[i, 0], frame[i, 1], frame[i, 2], frame[i, 3], length[i], width[i]),
                    _Rectangle(frame[j, 0], frame[j, 1], frame[j, 2], frame[j, 3], length[j], width[j]),
                )
                clearance = min(clearance, gap)
                if gap == 0.0:
                    n_codes = _note(codes, n_codes, CAR_CAR, i, j)
    return n_codes, clearance


@njit(cache=True)
def _cars_in_boxes(seen: _Seen, bodies: Body, bins: BinnedBoxes, codes: IntArray, n_codes: int) -> int:
    """Compare each car that has moved with the boxes in its bins."""
    _, frame, _, moved, _, _, _ = seen
    _, length, width, _, circles, _ = bodies
    boxes, keys, bin_ptr, bin_box, n_x, n_y = bins
    for i in range(len(frame)):
        if not moved[i]:
            continue
        x, y, circle = frame[i, 0], frame[i, 1], circles[i]
        car = _Rectangle(x, y, frame[i, 2], frame[i, 3], length[i], width[i])
        x0, x1 = max(int((x - circle) / BIN_M), 0), min(int((x + circle) / BIN_M), n_x - 1)
        y0, y1 = max(int((y - circle) / BIN_M), 0), min(int((y + circle) / BIN_M), n_y - 1)
        for iy in range(y0, y1 + 1):
            for ix in range(x0, x1 + 1):
                for entry in range(bin_ptr[iy * n_x + ix], bin_ptr[iy * n_x + ix + 1]):
                    b = bin_box[entry]
                    if abs(boxes[b, 0] - x) > circle + boxes[b, 2] or abs(boxes[b, 1] - y) > circle + boxes[b, 3]:
                        continue
                    box = _Rectangle(boxes[b, 0], boxes[b, 1], 1.0, 0.0, boxes[b, 2], boxes[b, 3])
                    if _rectangle_gap(car, box) == 0.0:
                        n_codes = _note(codes, n_codes, STATIC, i, keys[b])
    return n_codes


@njit(cache=True)
def _cars_near_arms(
    seen: _Seen, bodies: Body, arms: ArmBalls, clearance: float, codes: IntArray, n_codes: int
) -> tuple[int, float]:
    """Compare arms that have moved with all cars near them, and the others with cars that have moved."""
    _, frame, by_x, car_moved, _, _, arm_moved = seen
    _, length, width, height, circles, widest = bodies
    spheres, arm_xy, serving, reach = arms
    moving = by_x[car_moved[by_x]]
    all_x, moving_x = frame[by_x, 0], frame[moving, 0]
    for a in range(len(spheres)):
        cars, xs = (by_x, all_x) if arm_moved[a] else (moving, moving_x)
        farthest = reach + 2.0 * max(spheres[a, -1, 3], 0.0) + widest + clearance
        for at in range(np.searchsorted(xs, arm_xy[a, 0] - farthest), len(cars)):
            if xs[at] > arm_xy[a, 0] + farthest:
                break
            i = cars[at]
            dx, dy = frame[i, 0] - arm_xy[a, 0], frame[i, 1] - arm_xy[a, 1]
            near = reach + 2.0 * max(spheres[a, -1, 3], 0.0) + circles[i] + clearance
            if i == serving[a] or dx * dx + dy * dy > near * near:
                continue
            gap = _arm_gap(spheres[a], frame[i], length[i], width[i], height[i])
            clearance = min(clearance, gap)
            if gap == 0.0:
                n_codes = _note(codes, n_codes, CAR_ARM, i, a)
    return n_codes, clearance


@njit(cache=True)
def _arms_in_arms(seen: _Seen, arms: ArmBalls, codes: IntArray, n_codes: int) -> int:
    """Compare each arm that has moved with those in its reach."""
    spheres, arm_xy, _, reach = arms
    moved = seen.arm_moved
    for a in range(len(spheres)):
        if not moved[a]:
            continue
        for b in range(len(spheres)):
            if b == a or (b < a and moved[b]):
                continue
            near = 2.0 * (reach + max(spheres[a, -1, 3], 0.0) + max(spheres[b, -1, 3], 0.0))
            if math.hypot(arm_xy[a, 0] - arm_xy[b, 0], arm_xy[a, 1] - arm_xy[b, 1]) > near:
                continue
            if _overlap(spheres[a], spheres[b]):
                n_codes = _note(codes, n_codes, ARM_ARM, min(a, b), max(a, b))
    return n_codes
