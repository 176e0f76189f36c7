"""Surroundings: what touches what in a world without physics, how close robots came, and what rays hit."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.errors import FleetError
from fleet.robots.twist.pod import POD
from fleet.world.arms import ServoArms
from fleet.world.collisions import NOT_HELD, set_apart, shove
from fleet.world.scene import Scene
from fleet.world.touches import BIN_M, FIRST_SHIFT, KIND_SHIFT, STATIC, ArmBalls, BinnedBoxes, Body, Touches, robots_of

_ADDED_KEY = 1 << 18
"""Keys of run-time boxes begin here, so that they do not depend on how many there are."""
_POD_KEY = 1 << 17
"""Keys of pods begin here."""


@dataclass(frozen=True, kw_only=True)
class SurroundingsSnapshot:
    """State of `Surroundings` at one instant."""

    serving: IntArray
    n_robot_contacts: int
    n_static_contacts: int
    min_clearance_m: float
    of_cars: IntArray
    of_arms: IntArray
    touching: frozenset[int]
    added: dict[int, tuple[float, float, float, float]]


class Surroundings:
    """What touches what, how close robots came, and what rays hit; in the plane, except for arms above cars.

    Cars are oriented rectangles, boxes are their footprints (only boxes that begin below the cars' height), arms and
    the parcels they hold are spheres. Arms are not judged against boxes, nor against the car they serve. A pod is the
    rectangle of the car that carries it, or else a box, under which cars may stand that lift pods.

    Attributes:
        n_robot_contacts: Touches between robots so far; one that lasts counts once.
        n_static_contacts: Touches of cars with boxes so far.
        of_cars: Touches of each car so far, shape (n_cars,); one of two cars counts for both.
        of_arms: Touches of each arm so far, shape (n_arms,).

    Args:
        scene: Boxes, floor and models.
        arms: The arms to judge.
    """

    def __init__(self, scene: Scene, arms: ServoArms) -> None:
        cars = scene.cars
        low = [b for b in scene.boxes if b.centre_m[2] - b.half_m[2] < cars.most("height_m")]
        self._fixed = [(*b.centre_m[:2], *b.half_m[:2]) for b in low]
        self._added: dict[int, tuple[float, float, float, float]] = {}
        self._n_bins = (max(1, math.ceil(scene.size_m[0] / BIN_M)), max(1, math.ceil(scene.size_m[1] / BIN_M)))
        front_m, rear_m, half_width_m = cars.each("front_m"), cars.each("rear_m"), cars.each("half_width_m")
        half_length_m = (front_m + rear_m) / 2
        circle_m = np.hypot(half_length_m, half_width_m)
        self._lifts = np.array([kind.lifts is not None for kind in cars.kinds], dtype=np.bool_)[cars.kind_of]
        self._bodies = Body(
            shift=(front_m - rear_m) / 2,
            length=half_length_m,
            width=half_width_m,
            height=cars.each("height_m"),
            circle=circle_m,
            widest=max(float(circle_m.max(initial=0.0)), math.hypot(*POD.half_m) if self._lifts.any() else 0.0),
        )
        self._alone = [part.copy() for part in self._bodies[:-1]]  # without pods
        self._carried_by = np.empty(0, dtype=np.int64)
        self._standing = np.empty((0, 3))
        self._pods: dict[int, tuple[float, float, float, float]] = {}
        self._may_pass = self._lifts
        self._foot_m = scene.arms.foot_m
        n_arms = len(scene.arm_base)
        self.serving = np.full(n_arms, -1, dtype=np.int64)
        self._balls = ArmBalls(
            spheres=np.empty((n_arms, len(arms.radii) + 1, 4)),
            xy=np.array(scene.arm_base, dtype=np.float64).reshape(-1, 4)[:, :2].copy(),
            serving=self.serving,
            reach=arms.reach_m,
        )
        self._balls.spheres[:, :-1, 3] = arms.radii
        self.n_robot_contacts = 0
        self.n_static_contacts = 0
        self.of_cars = np.zeros(len(scene.car_start), dtype=np.int64)
        self.of_arms = np.zeros(n_arms, dtype=np.int64)
        self._touches = Touches(self._bodies, arms, self._balls)
        self._touching: frozenset[int] = frozenset()
        self._sort_boxes()

    @property
    def min_clearance_m(self) -> float:
        """Smallest clearance so far [m]; infinite until two robots were compared."""
        return self._touches.clearance_m

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

    def see_pods(self, poses: FloatArray, carried_by: IntArray) -> None:
        """Take note of which pods are carried and where the others stand, if that has changed.

        Args:
            poses: x, y, yaw, shape (p, 3); those that stand are as good as turned by quarters.
            carried_by: The car that carries each, -1 for none, shape (p,).
        """
        standing = poses[carried_by < 0]
        if np.array_equal(carried_by, self._carried_by) and np.array_equal(standing, self._standing):
            return
        self._carried_by, self._standing = carried_by, standing
        for part, alone in zip(self._bodies[:-1], self._alone, strict=True):
            part[:] = alone
        loaded = carried_by[carried_by >= 0]
        (length_m, width_m), height_m = POD.half_m, POD.height_m
        own = 0.0, length_m, width_m, height_m, math.hypot(length_m, width_m)
        for part, number in zip(self._bodies[:-1], own, strict=True):
            part[loaded] = number
        self._may_pass = self._lifts.copy()
        self._may_pass[loaded] = False
        stand = np.flatnonzero(carried_by < 0).tolist()
        self._pods = {_POD_KEY + pod: (*poses[pod, :2].tolist(), length_m, width_m) for pod in stand}
        self._sort_boxes()

    def observe(
        self, car_poses: FloatArray, held: FloatArray, known: Callable[[int], bool] | None = None
    ) -> frozenset[int]:
        """Count new touches and note the smallest clearance.

        Args:
            car_poses: Rear-axle poses x, y, yaw, shape (n_cars, 3).
            held: Spheres x, y, z, radius round the held parcels, radius < 0 for none, shape (n_arms, 4).
            known: Whether somebody else looks after what touches, by its code; None = nobody does.

        Returns:
            Codes of the touches that last and that nobody else looks after, as `robots_of` reads them.
        """
        self._touches.look(car_poses, held, self._boxes)
        codes = self._touches.codes
        if self._pods and len(codes):
            codes = codes[~self._below_pods(codes)]
        if len(codes) or self._touching:
            # What somebody else looks after is kept in mind: it is no new touch where it goes on without them.
            now = frozenset(codes.tolist())
            new = [code for code in now - self._touching if known is None or not known(code)]
            static = sum(code >> KIND_SHIFT == STATIC for code in new)
            self.n_robot_contacts += len(new) - static
            self.n_static_contacts += static
            for code in new:
                cars, arms = robots_of(code)
                self.of_cars[cars] += 1
                self.of_arms[arms] += 1
            self._touching = now
        return self._touching if known is None else frozenset(code for code in self._touching if not known(code))

    def _below_pods(self, codes: IntArray) -> BoolArray:
        """Whether touches are of cars that may stand below the pods that they touch, shape of `codes`."""
        key = codes & ((1 << FIRST_SHIFT) - 1)
        of_pods = (codes >> KIND_SHIFT == STATIC) & (key >= _POD_KEY) & (key < _ADDED_KEY)
        below = of_pods.copy()
        below[of_pods] = self._may_pass[(codes[of_pods] >> FIRST_SHIFT) & ((1 << FIRST_SHIFT) - 1)]
        return below

    def set_apart(self, car_poses: FloatArray, car_speeds: FloatArray, before: FloatArray = NOT_HELD) -> None:
        """Set cars apart that overlap each other or a box, in place; see `fleet.world.collisions`.

        Args:
            car_poses: Rear-axle poses x, y, yaw, shape (n_cars, 3).
            car_speeds: Shape (n_cars,) [m/s].
            before: Poses at the beginning of the tick, if friction is to hold noses, shape (n_cars, 3).
        """
        set_apart(car_poses, car_speeds, self._bodies, self._boxes, before)

    def shove(self, car_poses: FloatArray, car: int, way: FloatArray) -> None:
        """Push one car aside until something is in the way, in place; see `fleet.world.collisions.shove`."""
        feet = np.column_stack((self._balls.xy, self._foot_m, self._foot_m))
        shove(car_poses, car, way, self._bodies, np.concatenate((self._boxes.rows, feet)))

    def rays(self, origins: FloatArray, ends: FloatArray, car_poses: FloatArray) -> FloatArray:
        """Hit fractions in the plane, shape (r,); a body that contains a ray's origin does not stop it.

        Of arms only the feet are in the way; a pod is as if there was something between its legs.
        """
        out = np.ones(len(origins))
        _cast(origins, ends, car_poses, self._bodies, self._boxes, self._balls.xy, self._foot_m, out)
        return out

    def save(self) -> SurroundingsSnapshot:
        """Copy of everything that changes."""
        return SurroundingsSnapshot(
            serving=self.serving.copy(),
            n_robot_contacts=self.n_robot_contacts,
            n_static_contacts=self.n_static_contacts,
            min_clearance_m=self.min_clearance_m,
            of_cars=self.of_cars.copy(),
            of_arms=self.of_arms.copy(),
            touching=self._touching,
            added=self._added.copy(),
        )

    def load(self, snapshot: SurroundingsSnapshot) -> None:
        """Return to a saved state."""
        self.serving[:] = snapshot.serving
        self.n_robot_contacts = snapshot.n_robot_contacts
        self.n_static_contacts = snapshot.n_static_contacts
        self._touches.clearance_m = snapshot.min_clearance_m
        self.of_cars[:], self.of_arms[:] = snapshot.of_cars, snapshot.of_arms
        self._touches.forget()
        self._touching = snapshot.touching
        if snapshot.added != self._added:
            self._added = snapshot.added.copy()
            self._sort_boxes()

    def _sort_boxes(self) -> None:
        """Put box numbers into the bins that their footprints touch (compressed rows, bins along x first)."""
        self._touches.forget()
        rows = [*self._fixed, *self._pods.values(), *(self._added[key] for key in sorted(self._added))]
        keys = [*range(len(self._fixed)), *self._pods, *(_ADDED_KEY + key for key in sorted(self._added))]
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
        self._boxes = BinnedBoxes(
            rows=boxes,
            keys=np.array(keys, dtype=np.int64),
            ptr=np.searchsorted(entries[:, 0], np.arange(n_x * n_y + 1)),
            box=entries[:, 1].copy(),
            n_x=n_x,
            n_y=n_y,
        )


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
    bodies: Body,
    bins: BinnedBoxes,
    feet: FloatArray,
    foot: FloatArray,
    out: FloatArray,
) -> None:
    """Walk each ray through the bins it crosses; cars and feet of arms are tried one by one.

    Source: J. Amanatides, A. Woo, "A fast voxel traversal algorithm for ray tracing", Eurographics 1987.
    """
    shift, length, width, _, _, _ = bodies
    boxes, _, bin_ptr, bin_box, n_x, n_y = bins
    frame = np.empty((len(cars), 4))
    for i in range(len(cars)):
        cos, sin = math.cos(cars[i, 2]), math.sin(cars[i, 2])
        frame[i] = cars[i, 0] + shift[i] * cos, cars[i, 1] + shift[i] * sin, cos, sin
    for r in range(len(origins)):
        ox, oy = origins[r, 0], origins[r, 1]
        dx, dy = ends[r, 0] - ox, ends[r, 1] - oy
        square = max(dx * dx + dy * dy, 1e-12)
        best = 1.0
        for i in range(len(cars)):
            px, py = ox - frame[i, 0], oy - frame[i, 1]
            t = min(max(-(px * dx + py * dy) / square, 0.0), 1.0)
            if (px + t * dx) ** 2 + (py + t * dy) ** 2 <= length[i] * length[i] + width[i] * width[i]:
                cos, sin = frame[i, 2], frame[i, 3]
                ahead, left = cos * px + sin * py, cos * py - sin * px
                best = _enter(ahead, left, cos * dx + sin * dy, cos * dy - sin * dx, length[i], width[i], best)
        for i in range(len(feet)):
            best = _enter_circle(ox - feet[i, 0], oy - feet[i, 1], dx, dy, foot[i], best)
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
