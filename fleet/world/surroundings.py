"""Surroundings: what touches what in a world without physics, how close robots came, and what rays hit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import FloatArray, IntArray
from fleet.errors import FleetError
from fleet.world.arms import ServoArms
from fleet.world.scene import Scene

BIN_M = 1.0
"""Edge of the square bins in which boxes are looked up [m]."""
_KIND_SHIFT = 40
_CAR_CAR, _CAR_ARM, _ARM_ARM, _STATIC = 0, 1, 2, 3
_ADDED_KEY = 1 << 18
"""Keys of run-time boxes begin here, so that they do not depend on how many there are."""


class _Body(NamedTuple):
    """A car's body round its rear axle [m]."""

    shift: float
    """From the axle to its middle."""
    length: float
    """Half of it."""
    width: float
    """Half of it."""
    height: float


class _Boxes(NamedTuple):
    """Boxes in bins, as compressed rows: those of bin (ix, iy) are ``box[ptr[b]:ptr[b + 1]]``, b = iy n_x + ix."""

    rows: FloatArray
    """Centre and half edges x, y, shape (k, 4)."""
    keys: IntArray
    """What a box is called among those that touch, shape (k,)."""
    ptr: IntArray
    box: IntArray
    n_x: int
    n_y: int


class _ArmBalls(NamedTuple):
    """Arms as spheres."""

    spheres: FloatArray
    """Centre and radius of each, the last one round what is held, radius < 0 for none, shape (m, k, 4)."""
    xy: FloatArray
    """Where arms stand, shape (m, 2)."""
    serving: IntArray
    """Car that each arm serves, -1 for none, shape (m,)."""
    reach: float


@dataclass(frozen=True, kw_only=True)
class SurroundingsSnapshot:
    """State of `Surroundings` at one instant."""

    serving: IntArray
    robot_contacts_n: int
    static_contacts_n: int
    min_clearance_m: float
    touching: frozenset[int]
    added: dict[int, tuple[float, float, float, float]]


class Surroundings:
    """What touches what, how close robots came, and what rays hit; in the plane, except for arms above cars.

    Cars are oriented rectangles, boxes are their footprints (only boxes that begin below the cars' height), arms and
    the parcels they hold are spheres. Arms are not judged against boxes, nor against the car they serve.

    Attributes:
        robot_contacts_n: Touches between robots so far; one that lasts counts once.
        static_contacts_n: Touches of cars with boxes so far.
        min_clearance_m: Smallest clearance so far [m]; infinite until two robots were compared.

    Args:
        scene: Boxes, floor and models.
        arms: The arms to judge.
    """

    def __init__(self, scene: Scene, arms: ServoArms) -> None:
        car = scene.car
        low = [b for b in scene.boxes if b.centre_m[2] - b.half_m[2] < car.height_m]
        self._fixed = [(*b.centre_m[:2], *b.half_m[:2]) for b in low]
        self._added: dict[int, tuple[float, float, float, float]] = {}
        self._n_bins = (max(1, math.ceil(scene.size_m[0] / BIN_M)), max(1, math.ceil(scene.size_m[1] / BIN_M)))
        self._body = _Body(
            shift=(car.front_m - car.rear_m) / 2,
            length=(car.front_m + car.rear_m) / 2,
            width=car.half_width_m,
            height=car.height_m,
        )
        self._foot_m = scene.arm.outline.foot_m
        self._arms = arms
        n_arms = len(scene.arm_base)
        self.serving = np.full(n_arms, -1, dtype=np.int64)
        self._balls = _ArmBalls(
            spheres=np.empty((n_arms, len(arms.radii) + 1, 4)),
            xy=np.array(scene.arm_base, dtype=np.float64).reshape(-1, 4)[:, :2].copy(),
            serving=self.serving,
            reach=arms.reach_m,
        )
        self._balls.spheres[:, :-1, 3] = arms.radii
        self.robot_contacts_n = 0
        self.static_contacts_n = 0
        self.min_clearance_m = math.inf
        self._touching: frozenset[int] = frozenset()
        self._codes = np.zeros(256, dtype=np.int64)
        self._sort_boxes()

    def add_box(self, obstacle: int, centre_m: FloatArray, half_m: FloatArray) -> None:
        """Put up a box at run time, in place of an earlier one of the same id."""
        self._added[obstacle] = (float(centre_m[0]), float(centre_m[1]), float(half_m[0]), float(half_m[1]))
        self._sort_boxes()

    def remove_box(self, obstacle: int) -> None:
        """Take down such a box.

        Raises:
            FleetError: No such box.
        """
        if obstacle not in self._added:
            raise FleetError(f"obstacle {obstacle} does not exist; valid: {sorted(self._added)}")
        del self._added[obstacle]
        self._sort_boxes()

    def observe(self, car_poses: FloatArray, held: FloatArray) -> None:
        """Count new touches and note the smallest clearance.

        Args:
            car_poses: Rear-axle poses x, y, yaw, shape (n_cars, 3).
            held: Spheres x, y, z, radius round the held parcels, radius < 0 for none, shape (n_arms, 4).
        """
        spheres = self._balls.spheres
        spheres[:, :-1, :3] = self._arms.points
        spheres[:, -1] = held
        while True:
            n_codes, clearance = _touches(
                car_poses, self._body, self._boxes, self._balls, self.min_clearance_m, self._codes
            )
            if n_codes <= len(self._codes):
                break
            self._codes = np.zeros(2 * n_codes, dtype=np.int64)
        self.min_clearance_m = clearance
        if n_codes or self._touching:
            now = frozenset(self._codes[:n_codes].tolist())
            new = now - self._touching
            static = sum(code >> _KIND_SHIFT == _STATIC for code in new)
            self.robot_contacts_n += len(new) - static
            self.static_contacts_n += static
            self._touching = now

    def rays(self, origins: FloatArray, ends: FloatArray, car_poses: FloatArray) -> FloatArray:
        """Hit fractions in the plane, shape (r,); a body that contains a ray's origin does not stop it.

        Of arms only the feet are in the way.
        """
        out = np.ones(len(origins))
        _cast(origins, ends, car_poses, self._body, self._boxes, self._balls.xy, self._foot_m, out)
        return out

    def save(self) -> SurroundingsSnapshot:
        """Copy of everything that changes."""
        return SurroundingsSnapshot(
            serving=self.serving.copy(),
            robot_contacts_n=self.robot_contacts_n,
            static_contacts_n=self.static_contacts_n,
            min_clearance_m=self.min_clearance_m,
            touching=self._touching,
            added=self._added.copy(),
        )

    def load(self, snapshot: SurroundingsSnapshot) -> None:
        """Return to a saved state."""
        self.serving[:] = snapshot.serving
        self.robot_contacts_n = snapshot.robot_contacts_n
        self.static_contacts_n = snapshot.static_contacts_n
        self.min_clearance_m = snapshot.min_clearance_m
        self._touching = snapshot.touching
        if snapshot.added != self._added:
            self._added = snapshot.added.copy()
            self._sort_boxes()

    def _sort_boxes(self) -> None:
        """Put box numbers into the bins that their footprints touch (compressed rows, bins along x first)."""
        rows = self._fixed + [self._added[key] for key in sorted(self._added)]
        boxes = np.array(rows, dtype=np.float64).reshape(-1, 4)
        n_x, n_y = self._n_bins
        limit = np.array([n_x, n_y]) - 1
        low = np.clip(np.floor((boxes[:, :2] - boxes[:, 2:]) / BIN_M).astype(np.int64), 0, limit)
        high = np.clip(np.floor((boxes[:, :2] + boxes[:, 2:]) / BIN_M).astype(np.int64), 0, limit)
        pairs = [
            (iy * n_x + ix, box)
            for box, ((x0, y0), (x1, y1)) in enumerate(zip(low.tolist(), high.tolist(), strict=True))
            for iy in range(y0, y1 + 1)
            for ix in range(x0, x1 + 1)
        ]
        entries = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)
        self._boxes = _Boxes(
            rows=boxes,
            keys=np.array([*range(len(self._fixed)), *(_ADDED_KEY + key for key in sorted(self._added))], np.int64),
            ptr=np.searchsorted(entries[:, 0], np.arange(n_x * n_y + 1)),
            box=entries[:, 1].copy(),
            n_x=n_x,
            n_y=n_y,
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
        codes[n_codes] = (kind << _KIND_SHIFT) + (a << 20) + b
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
def _arms_touch(a: FloatArray, b: FloatArray) -> bool:
    for k in range(len(a)):
        for m in range(len(b)):
            if a[k, 3] < 0.0 or b[m, 3] < 0.0:
                continue
            dx, dy, dz = a[k, 0] - b[m, 0], a[k, 1] - b[m, 1], a[k, 2] - b[m, 2]
            if dx * dx + dy * dy + dz * dz < (a[k, 3] + b[m, 3]) ** 2:
                return True
    return False


@njit(cache=True)
def _touches(
    cars: FloatArray,
    body: _Body,
    bins: _Boxes,
    arms: _ArmBalls,
    clearance: float,
    codes: IntArray,
) -> tuple[int, float]:
    """Codes of all pairs that touch now, and the smallest clearance so far."""
    shift, length, width, height = body
    boxes, keys, bin_ptr, bin_box, n_x, n_y = bins
    spheres, arm_xy, serving, reach = arms
    n_cars, n_arms, n_codes = len(cars), len(spheres), 0
    circle = math.hypot(length, width)
    frame = np.empty((n_cars, 4))
    for i in range(n_cars):
        cos, sin = math.cos(cars[i, 2]), math.sin(cars[i, 2])
        frame[i, 0], frame[i, 1] = cars[i, 0] + shift * cos, cars[i, 1] + shift * sin
        frame[i, 2], frame[i, 3] = cos, sin

    # Only cars that are near along x can touch.
    by_x = np.argsort(frame[:, 0])
    xs = frame[by_x, 0]
    for at in range(n_cars):
        for other in range(at + 1, n_cars):
            near = 2.0 * circle + clearance
            if xs[other] - xs[at] > near:
                break
            i, j = min(by_x[at], by_x[other]), max(by_x[at], by_x[other])
            dx, dy = frame[j, 0] - frame[i, 0], frame[j, 1] - frame[i, 1]
            if dx * dx + dy * dy > near * near:
                continue
            gap = _rectangle_gap(
                _Rectangle(frame[i, 0], frame[i, 1], frame[i, 2], frame[i, 3], length, width),
                _Rectangle(frame[j, 0], frame[j, 1], frame[j, 2], frame[j, 3], length, width),
            )
            clearance = min(clearance, gap)
            if gap == 0.0:
                n_codes = _note(codes, n_codes, _CAR_CAR, i, j)
    for i in range(n_cars):
        x, y = frame[i, 0], frame[i, 1]
        car = _Rectangle(x, y, frame[i, 2], frame[i, 3], length, width)
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
                        n_codes = _note(codes, n_codes, _STATIC, i, keys[b])

    for a in range(n_arms):
        farthest = reach + 2.0 * max(spheres[a, -1, 3], 0.0) + circle + clearance
        for at in range(np.searchsorted(xs, arm_xy[a, 0] - farthest), n_cars):
            if xs[at] > arm_xy[a, 0] + farthest:
                break
            i = by_x[at]
            dx, dy = frame[i, 0] - arm_xy[a, 0], frame[i, 1] - arm_xy[a, 1]
            near = reach + 2.0 * max(spheres[a, -1, 3], 0.0) + circle + clearance
            if i == serving[a] or dx * dx + dy * dy > near * near:
                continue
            gap = _arm_gap(spheres[a], frame[i], length, width, height)
            clearance = min(clearance, gap)
            if gap == 0.0:
                n_codes = _note(codes, n_codes, _CAR_ARM, i, a)
        for b in range(a + 1, n_arms):
            near = 2.0 * (reach + max(spheres[a, -1, 3], 0.0) + max(spheres[b, -1, 3], 0.0))
            if math.hypot(arm_xy[a, 0] - arm_xy[b, 0], arm_xy[a, 1] - arm_xy[b, 1]) > near:
                continue
            if _arms_touch(spheres[a], spheres[b]):
                n_codes = _note(codes, n_codes, _ARM_ARM, a, b)
    return n_codes, clearance


@njit(cache=True)
def _enter(ox: float, oy: float, dx: float, dy: float, half_x: float, half_y: float, best: float) -> float:
    """Fraction at which a ray enters an axis-aligned box round the origin, `best` if later, never, or from inside."""
    first, last = 0.0, best
    inside = True
    for axis in range(2):
        o, d, half = (ox, dx, half_x) if axis == 0 else (oy, dy, half_y)
        inside = inside and abs(o) < half
        if abs(d) < 1e-12:
            if abs(o) > half:
                return best
            continue
        t0, t1 = (-half - o) / d, (half - o) / d
        first, last = max(first, min(t0, t1)), min(last, max(t0, t1))
    return best if inside or first > last else first


@njit(cache=True)
def _enter_circle(ox: float, oy: float, dx: float, dy: float, radius: float, best: float) -> float:
    """Fraction at which a ray enters a circle round the origin, `best` if later, never, or from inside."""
    a, b, c = dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy - radius * radius
    under = b * b - a * c
    if c <= 0.0 or b >= 0.0 or under < 0.0:
        return best
    return min(best, (-b - math.sqrt(under)) / a)


@njit(cache=True)
def _cast(
    origins: FloatArray,
    ends: FloatArray,
    cars: FloatArray,
    body: _Body,
    bins: _Boxes,
    feet: FloatArray,
    foot: float,
    out: FloatArray,
) -> None:
    """Walk each ray through the bins it crosses; cars and feet of arms are tried one by one.

    Source: J. Amanatides, A. Woo, "A fast voxel traversal algorithm for ray tracing", Eurographics 1987.
    """
    shift, length, width, _ = body
    boxes, _, bin_ptr, bin_box, n_x, n_y = bins
    circle2 = length * length + width * width
    frame = np.empty((len(cars), 4))
    for i in range(len(cars)):
        cos, sin = math.cos(cars[i, 2]), math.sin(cars[i, 2])
        frame[i] = cars[i, 0] + shift * cos, cars[i, 1] + shift * sin, cos, sin
    for r in range(len(origins)):
        ox, oy = origins[r, 0], origins[r, 1]
        dx, dy = ends[r, 0] - ox, ends[r, 1] - oy
        square = max(dx * dx + dy * dy, 1e-12)
        best = 1.0
        for i in range(len(cars)):
            px, py = ox - frame[i, 0], oy - frame[i, 1]
            t = min(max(-(px * dx + py * dy) / square, 0.0), 1.0)
            if (px + t * dx) ** 2 + (py + t * dy) ** 2 <= circle2:
                cos, sin = frame[i, 2], frame[i, 3]
                ahead, left = cos * px + sin * py, cos * py - sin * px
                best = _enter(ahead, left, cos * dx + sin * dy, cos * dy - sin * dx, length, width, best)
        for i in range(len(feet)):
            best = _enter_circle(ox - feet[i, 0], oy - feet[i, 1], dx, dy, foot, best)
        ix, iy = math.floor(ox / BIN_M), math.floor(oy / BIN_M)
        step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        next_x = ((ix + (dx > 0.0)) * BIN_M - ox) / dx if dx != 0.0 else math.inf
        next_y = ((iy + (dy > 0.0)) * BIN_M - oy) / dy if dy != 0.0 else math.inf
        while True:
            if 0 <= ix < n_x and 0 <= iy < n_y:
                for entry in range(bin_ptr[iy * n_x + ix], bin_ptr[iy * n_x + ix + 1]):
                    b = bin_box[entry]
                    best = _enter(ox - boxes[b, 0], oy - boxes[b, 1], dx, dy, boxes[b, 2], boxes[b, 3], best)
            if min(next_x, next_y) > best:
                break
            if next_x < next_y:
                ix += step_x
                next_x += BIN_M / abs(dx)
            else:
                iy += step_y
                next_y += BIN_M / abs(dy)
        out[r] = best
