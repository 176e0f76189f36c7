"""ClearanceCheck: how far apart the bodies of robots are, each pair of cars, of arms, and of an arm and a car.

Cars are boxes that stand on the floor, arms the spheres that cover their links, tools and held parcels. Pairs that are
too far apart to touch are left out first: by their middles, then by boxes along the axes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.run.view import RunView
from fleet.safety.breach import Breach, Invariant
from fleet.safety.faults import CarFaults
from fleet.stations.arms.arm_spheres import arm_spheres

CLEARANCE_M = 0.01
"""Robots are farther apart than this [m]: half of what two arms over one tray are kept apart by
(`fleet.stations.arms.shared_dock.MARGIN_M`), which come closer than any other robots do."""
STANDS_MPS = 0.05
"""A car that is slower than this stands, and the arm that serves it may touch it [m/s]."""
_NONE, _CARS, _ARM_CAR, _ARMS = 0, 1, 2, 3


class _Car(NamedTuple):
    """What cars look like [m], shape (n_cars,) each."""

    shift: FloatArray
    """From the rear axle to the middle."""
    length: FloatArray
    """Half of it."""
    width: FloatArray
    """Half of it."""
    height: FloatArray


class _Arms(NamedTuple):
    """Arms, m of them with up to n joints and k spheres."""

    joints: FloatArray
    """Fixed transform before each joint's turn about its own z, shape (m, n, 3, 4)."""
    spheres: FloatArray
    """Centre in its link's frame, radius, and number of that frame, -1 for none, shape (m, k, 5)."""
    base: FloatArray
    """x, y, z, yaw, shape (m, 4)."""
    near: IntArray
    """Pairs of arms that can reach each other, shape (p, 2)."""
    reach: float
    """No sphere gets farther from the base [m]."""
    q: FloatArray
    """Joints where spheres were placed last, shape (m, n)."""
    placed: FloatArray
    """Spheres in the world, centre and radius, the last one round what is held, shape (m, k + 1, 4)."""


class ClearanceCheck:
    """Distances between robots.

    Args:
        run: The run.
        faults: Cars that may touch others.
    """

    def __init__(self, run: RunView, faults: CarFaults) -> None:
        self._run = run
        self._faults = faults
        models = run.scene.cars
        front_m, rear_m = models.each("front_m"), models.each("rear_m")
        self._cars = _Car(
            (front_m - rear_m) / 2, (front_m + rear_m) / 2, models.each("half_width_m"), models.each("height_m")
        )
        self._by_x = np.arange(run.world.n_cars)
        self._held = np.full(run.world.n_arms, -1, dtype=np.int64)
        self._radius = np.full(run.world.n_arms, -1.0)
        self._arms = self._arms_of(run)

    def look(self, poses: FloatArray, held: IntArray, parcel_ids: IntArray, parcels: FloatArray) -> Breach | None:
        """Find two robots that touch.

        Args:
            poses: True rear-axle poses x, y, yaw, shape (n_cars, 3).
            held: Parcel in each arm's grip, -1 for none, shape (n_arms,).
            parcel_ids: Ids of the parcels in the world, ascending, shape (p,).
            parcels: Their poses, shape (p, 7).
        """
        if not np.array_equal(held, self._held):
            self._held = held
            tasks = self._run.board.tasks
            for arm, parcel in enumerate(held.tolist()):
                size_m = tasks[parcel].delivery.size_m if parcel >= 0 else None
                self._radius[arm] = -1.0 if size_m is None else math.sqrt(sum(edge**2 for edge in size_m)) / 2
        arms = self._arms
        excused, served = self._faults.cars, self._run.missions.served
        stands = np.abs(self._run.world.car_speeds()) < STANDS_MPS
        served = np.where((served >= 0) & stands[served], served, -1)
        _hold(arms.placed, held, self._radius, parcel_ids, parcels)
        kind, first, second, gap = _closest(
            poses, self._cars, self._by_x, arms, self._run.world.arm_positions(), served, excused
        )
        return None if kind == _NONE else self._touch(kind, first, second, gap, poses)

    def _touch(self, kind: int, first: int, second: int, gap: float, poses: FloatArray) -> Breach:
        a = f"car_{first}" if kind == _CARS else f"arm_{first}"
        b = f"arm_{second}" if kind == _ARMS else f"car_{second}"
        served = int(self._run.missions.served[first]) if kind == _ARM_CAR else -1
        whom = "no car" if served < 0 else f"car_{served}, which drives" if served == second else f"car_{served}"
        of = f" (it serves {whom})" if kind == _ARM_CAR else ""
        middle = poses[second, :2] if kind != _ARMS else self._arms.base[second, :2]
        cell = self._run.site.grid.cell_at(*middle.tolist())
        where = {name: poses[int(name[4:])] for name in (a, b) if name.startswith("car")}
        joints = self._run.world.arm_positions()
        where |= {name: joints[int(name[4:])] for name in (a, b) if name.startswith("arm")}
        return Breach(
            invariant=Invariant.CLEARANCE,
            words=f"{a}{of} and {b} are {gap:.4f} m apart",
            valid=f"more than {CLEARANCE_M} m",
            robots=(a, b),
            place="{},{}".format(*cell),
            values={"clearance_m": gap, "where": where},
        )

    def _arms_of(self, run: RunView) -> _Arms:
        scene = run.scene
        own: dict[str, FloatArray] = {}
        reach_m = 0.0
        for spec in scene.arms.models:
            model = arm_spheres(spec)
            away_m = float(np.linalg.norm(spec.joints[:, :, 3], axis=1).sum())
            away_m += float((np.linalg.norm(model.sphere_centre, axis=1) + model.sphere_radius).max())
            reach_m = max(reach_m, away_m)
            rows = np.column_stack([model.sphere_centre, model.sphere_radius, model.sphere_frame])
            own[spec.name] = rows[rows[:, 4].argsort(kind="stable")]
        n_arms, n_spheres = len(scene.arm_base), max((len(rows) for rows in own.values()), default=0)
        spheres = np.full((n_arms, n_spheres, 5), -1.0)
        for row, spec in zip(spheres, scene.arms.specs, strict=True):
            row[: len(own[spec.name])] = own[spec.name]
        base = np.array(scene.arm_base, dtype=np.float64).reshape(-1, 4)
        placed = np.zeros((n_arms, n_spheres + 1, 4))
        placed[:, :-1, 3] = spheres[:, :, 3]
        pairs = [
            (a, b)
            for a in range(n_arms)
            for b in range(a + 1, n_arms)
            if math.dist(base[a, :2], base[b, :2]) < 2 * reach_m
        ]
        return _Arms(
            joints=scene.arms.joints,
            spheres=spheres,
            base=base,
            near=np.array(pairs, dtype=np.int64).reshape(-1, 2),
            reach=reach_m,
            q=np.full((n_arms, scene.arms.width), np.nan),
            placed=placed,
        )


@njit(cache=True)
def _hold(
    placed: FloatArray, held: IntArray, radius: FloatArray, ids: IntArray, poses: FloatArray
) -> None:  # pragma: no cover - compiled
    """Put the last sphere of each arm round the parcel that it holds; radius -1 for none."""
    for arm in range(len(held)):
        placed[arm, -1, 3] = -1.0
        if held[arm] < 0:
            continue
        row = np.searchsorted(ids, held[arm])
        if row < len(ids) and ids[row] == held[arm]:
            placed[arm, -1, 3] = radius[arm]
            for axis in range(3):
                placed[arm, -1, axis] = poses[row, axis]


@njit(cache=True)
def _closest(
    poses: FloatArray, cars: _Car, by_x: IntArray, arms: _Arms, q: FloatArray, served: IntArray, excused: BoolArray
) -> tuple[int, int, int, float]:  # pragma: no cover - compiled
    """The first pair of robots that touch: its kind, both, and their distance [m]; `_NONE` if there is none."""
    frames = np.empty((len(poses), 4))
    for i in range(len(poses)):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        frames[i, 0], frames[i, 1] = poses[i, 0] + cars.shift[i] * cos, poses[i, 1] + cars.shift[i] * sin
        frames[i, 2], frames[i, 3] = cos, sin
    circles = np.empty(len(poses))
    for i in range(len(poses)):
        circles[i] = math.hypot(cars.length[i], cars.width[i])
    widest = circles.max() if len(circles) else 0.0
    _sort(by_x, frames)
    for at in range(len(by_x)):
        i = by_x[at]
        if excused[i]:
            continue
        other = at + 1
        while other < len(by_x):
            j = by_x[other]
            dx, dy = frames[j, 0] - frames[i, 0], frames[j, 1] - frames[i, 1]
            if dx > circles[i] + widest + CLEARANCE_M:
                break
            other += 1
            if excused[j] or abs(dy) > circles[i] + circles[j] + CLEARANCE_M:
                continue
            gap = _between_cars(frames[i], frames[j], (cars.length[i], cars.width[i]), (cars.length[j], cars.width[j]))
            if gap <= CLEARANCE_M:
                return _CARS, min(i, j), max(i, j), gap
    for a in range(len(q)):
        for i in range(len(poses)):
            far = arms.reach + 2.0 * max(arms.placed[a, -1, 3], 0.0) + circles[i] + CLEARANCE_M
            dx, dy = frames[i, 0] - arms.base[a, 0], frames[i, 1] - arms.base[a, 1]
            if dx * dx + dy * dy > far * far or i == served[a] or excused[i]:
                continue
            _place(arms, a, q[a])
            gap = _from_car(arms.placed[a], frames[i], (cars.length[i], cars.width[i], cars.height[i]))
            if gap <= CLEARANCE_M:
                return _ARM_CAR, a, i, gap
    for pair in range(len(arms.near)):
        a, b = arms.near[pair, 0], arms.near[pair, 1]
        _place(arms, a, q[a])
        _place(arms, b, q[b])
        gap = _between_arms(arms.placed[a], arms.placed[b])
        if gap <= CLEARANCE_M:
            return _ARMS, a, b, gap
    return _NONE, -1, -1, 0.0


@njit(cache=True)
def _sort(by_x: IntArray, frames: FloatArray) -> None:  # pragma: no cover - compiled
    """Sort cars by their middles along x; by insertion, as hardly any two change places in a tick."""
    for at in range(1, len(by_x)):
        car, to = by_x[at], at
        while to > 0 and frames[by_x[to - 1], 0] > frames[car, 0]:
            by_x[to] = by_x[to - 1]
            to -= 1
        by_x[to] = car


@njit(cache=True)
def _between_cars(
    a: FloatArray, b: FloatArray, body_a: tuple[float, float], body_b: tuple[float, float]
) -> float:  # pragma: no cover - compiled
    """Distance of two bodies at x, y, cos, sin, of half a length and half a width, in the plane; 0 if they overlap.

    Rectangles overlap unless a side of one parts them (separating axes); else a corner of one is nearest to the other.
    """
    gap, parted = math.inf, False
    for turn in range(2):
        own, other = (a, b) if turn == 0 else (b, a)
        length, width = body_a if turn == 0 else body_b
        other_length, other_width = body_b if turn == 0 else body_a
        least_u, most_u, least_v, most_v = math.inf, -math.inf, math.inf, -math.inf
        for corner in range(4):
            along = other_length if corner < 2 else -other_length
            across = other_width if corner % 2 == 0 else -other_width
            x = other[0] + other[2] * along - other[3] * across - own[0]
            y = other[1] + other[3] * along + other[2] * across - own[1]
            u, v = own[2] * x + own[3] * y, own[2] * y - own[3] * x
            least_u, most_u, least_v, most_v = min(least_u, u), max(most_u, u), min(least_v, v), max(most_v, v)
            gap = min(gap, math.hypot(max(abs(u) - length, 0.0), max(abs(v) - width, 0.0)))
        parted = parted or least_u > length or most_u < -length or least_v > width or most_v < -width
    return gap if parted else 0.0


@njit(cache=True)
def _place(arms: _Arms, arm: int, q: FloatArray) -> None:  # pragma: no cover - compiled
    """Put an arm's spheres where its joints have them, unless they are there."""
    same = True
    for joint in range(len(q)):
        same = same and arms.q[arm, joint] == q[joint]
    if same:
        return
    arms.q[arm] = q
    base = arms.base[arm]
    pose = np.zeros((3, 4))
    pose[0, 0] = pose[1, 1] = math.cos(base[3])
    pose[1, 0] = math.sin(base[3])
    pose[0, 1] = -pose[1, 0]
    pose[2, 2] = 1.0
    pose[:, 3] = base[:3]
    sphere = 0
    for frame in range(len(q) + 1):
        if frame > 0:
            pose = _turned(pose, arms.joints[arm, frame - 1], q[frame - 1])
        while sphere < arms.spheres.shape[1] and arms.spheres[arm, sphere, 4] == frame:
            for axis in range(3):
                arms.placed[arm, sphere, axis] = pose[axis, 3]
                for k in range(3):
                    arms.placed[arm, sphere, axis] += pose[axis, k] * arms.spheres[arm, sphere, k]
            sphere += 1


@njit(cache=True)
def _turned(pose: FloatArray, joint: FloatArray, angle: float) -> FloatArray:  # pragma: no cover - compiled
    """The pose of the link after a joint: the link's before it, the joint's place in it, the turn about z."""
    out = np.empty((3, 4))
    cos, sin = math.cos(angle), math.sin(angle)
    for row in range(3):
        x, y, z, at = 0.0, 0.0, 0.0, pose[row, 3]
        for k in range(3):
            x += pose[row, k] * joint[k, 0]
            y += pose[row, k] * joint[k, 1]
            z += pose[row, k] * joint[k, 2]
            at += pose[row, k] * joint[k, 3]
        out[row, 0], out[row, 1], out[row, 2], out[row, 3] = cos * x + sin * y, cos * y - sin * x, z, at
    return out


@njit(cache=True)
def _from_car(
    spheres: FloatArray, frame: FloatArray, body: tuple[float, float, float]
) -> float:  # pragma: no cover - compiled
    """Distance of an arm from the box of a car, negative where it reaches into it."""
    gap, (length, width, height) = math.inf, body
    for k in range(len(spheres)):
        if spheres[k, 3] < 0.0:
            continue
        px, py = spheres[k, 0] - frame[0], spheres[k, 1] - frame[1]
        u = max(abs(frame[2] * px + frame[3] * py) - length, 0.0)
        v = max(abs(frame[2] * py - frame[3] * px) - width, 0.0)
        w = max(spheres[k, 2] - height, 0.0)
        gap = min(gap, math.sqrt(u * u + v * v + w * w) - spheres[k, 3])
    return gap


@njit(cache=True)
def _between_arms(a: FloatArray, b: FloatArray) -> float:  # pragma: no cover - compiled
    """Distance of two arms; infinite if boxes round them, along the axes, are apart."""
    for axis in range(3):
        low_a, high_a = _extent(a, axis)
        low_b, high_b = _extent(b, axis)
        if low_a > high_b + CLEARANCE_M or low_b > high_a + CLEARANCE_M:
            return math.inf
    gap = math.inf
    for i in range(len(a)):
        for j in range(len(b)):
            if a[i, 3] < 0.0 or b[j, 3] < 0.0:
                continue
            dx, dy, dz = a[i, 0] - b[j, 0], a[i, 1] - b[j, 1], a[i, 2] - b[j, 2]
            gap = min(gap, math.sqrt(dx * dx + dy * dy + dz * dz) - a[i, 3] - b[j, 3])
    return gap


@njit(cache=True)
def _extent(spheres: FloatArray, axis: int) -> tuple[float, float]:  # pragma: no cover - compiled
    """Lowest and highest point of spheres along an axis."""
    low, high = math.inf, -math.inf
    for k in range(len(spheres)):
        if spheres[k, 3] >= 0.0:
            low, high = min(low, spheres[k, axis] - spheres[k, 3]), max(high, spheres[k, axis] + spheres[k, 3])
    return low, high
