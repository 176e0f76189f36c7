"""Clearance: which bodies are near each other, and how far apart robots are, from geometry alone."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.robots.arms.spec import ArmSpec
from fleet.world.scene import Scene


class CarShape(NamedTuple):
    """The bodies of models of cars round their rear axles [m], shape (k,) each."""

    front: FloatArray
    rear: FloatArray
    half_width: FloatArray
    height: FloatArray


class ArmShapes(NamedTuple):
    """Arms as chains of spheres."""

    base: FloatArray
    """Base poses x, y, z, yaw, shape (m, 4)."""
    joints: FloatArray
    """Fixed transforms before each joint, shape (m, j, 3, 4)."""
    tool_length: FloatArray
    """From the last joint frame to the tip [m], shape (m,)."""
    radii: FloatArray
    """Radius at each joint and of the tool [m], shape (m, j + 1)."""


class Moment(NamedTuple):
    """Where robots are now."""

    poses: FloatArray
    """Rear-axle poses x, y, yaw, shape (n, 3)."""
    kind_of: IntArray
    """Which model each car is, shape (n,)."""
    q: FloatArray
    """Joint positions [rad], shape (m, j)."""
    held: FloatArray
    """Centre and radius of each arm's parcel, radius < 0 for none, shape (m, 4)."""
    serving: IntArray
    """Car that each arm serves, -1 for none, shape (m,)."""


class Near(NamedTuple):
    """What is near what; the kernels fill it in."""

    cars: IntArray
    """Pairs of cars, shape (p, 2)."""
    boxes: IntArray
    """Pairs of a car and a box, shape (k, 2)."""
    arms: BoolArray
    """Whether any car, served or not, is near each arm, shape (m,)."""


class Clearance:
    """Measures how far apart the robots of one world are, tick by tick.

    Attributes:
        smallest_m: Smallest clearance so far, infinite with fewer than two robots that can meet [m].
        near_arms: Whether a car was near each arm at the last look, shape (m,).

    Args:
        scene: Robots and where arms stand.
    """

    def __init__(self, scene: Scene) -> None:
        team, kinds = scene.arms, scene.car_kinds
        self._cars = CarShape(
            front=np.array([kind.front_m for kind in kinds]),
            rear=np.array([kind.rear_m for kind in kinds]),
            half_width=np.array([kind.half_width_m for kind in kinds]),
            height=np.array([kind.height_m for kind in kinds]),
        )
        self._arms = ArmShapes(
            base=scene.arm_base,
            joints=team.joints,
            tool_length=team.tool_length_m,
            radii=np.array([_radii(spec, team.width) for spec in team.specs]).reshape(-1, team.width + 1),
        )
        self.smallest_m = math.inf
        self.near_arms = np.zeros(len(scene.arm_base), dtype=np.bool_)
        self._room = _room(64, 256, self.near_arms)

    def look(self, now: Moment, boxes: FloatArray, margin_m: float) -> tuple[IntArray, IntArray]:
        """Update the smallest clearance and find what cars could touch within a tick.

        Args:
            now: Where robots are.
            boxes: Fixed rectangles x, y, yaw, half length, half width, shape (b, 5).
            margin_m: Distance up to which a pair counts as near [m].

        Returns:
            Near cars, shape (p, 2), and near cars with the row of a box, shape (k, 2).
        """
        while True:
            room = self._room
            n_cars, n_boxes, smallest = near_and_gap(
                self._cars, self._arms, now, boxes, margin_m, self.smallest_m, room
            )
            if n_cars <= len(room.cars) and n_boxes <= len(room.boxes):
                break
            self._room = _room(2 * max(n_cars, 32), 2 * max(n_boxes, 128), self.near_arms)
        self.smallest_m = smallest
        return room.cars[:n_cars], room.boxes[:n_boxes]


def _radii(spec: ArmSpec, width: int) -> list[float]:
    """Radius at each joint of a row, and of the tool [m]; joints that are not there lie in the last link."""
    links = spec.outline.link_radii_m
    return [*links, *[links[-1]] * (width - len(links)), spec.tool.half_width_m]


def _room(n_cars: int, n_boxes: int, near_arms: BoolArray) -> Near:
    """Make room for so many pairs."""
    return Near(
        cars=np.zeros((n_cars, 2), dtype=np.int64), boxes=np.zeros((n_boxes, 2), dtype=np.int64), arms=near_arms
    )


@njit(cache=True)
def _rectangle_gap(a: FloatArray, b: FloatArray, cutoff: float) -> float:
    """Distance of rectangles (x, y, yaw, half length, half width), 0 if they overlap; a lower bound above `cutoff`."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    ca, sa, cb, sb = math.cos(a[2]), math.sin(a[2]), math.cos(b[2]), math.sin(b[2])
    cos, sin = abs(ca * cb + sa * sb), abs(ca * sb - sa * cb)
    # Separating axes of two boxes: the four edge directions.
    separation = max(
        abs(dx * ca + dy * sa) - a[3] - b[3] * cos - b[4] * sin,
        abs(dy * ca - dx * sa) - a[4] - b[3] * sin - b[4] * cos,
        abs(dx * cb + dy * sb) - b[3] - a[3] * cos - a[4] * sin,
        abs(dy * cb - dx * sb) - b[4] - a[3] * sin - a[4] * cos,
    )
    if separation <= 0.0:
        return 0.0
    if separation > cutoff:
        return separation
    # The nearest points of two separate convex polygons include a corner of one of them.
    least = np.inf
    for swap in range(2):
        p, q = (a, b) if swap == 0 else (b, a)
        cp, sp, cq, sq = (ca, sa, cb, sb) if swap == 0 else (cb, sb, ca, sa)
        for u in (-p[3], p[3]):
            for v in (-p[4], p[4]):
                x, y = p[0] + u * cp - v * sp - q[0], p[1] + u * sp + v * cp - q[1]
                across = max(abs(x * cq + y * sq) - q[3], 0.0)
                along = max(abs(y * cq - x * sq) - q[4], 0.0)
                least = min(least, math.hypot(across, along))
    return least


@njit(cache=True)
def car_rectangles(cars: CarShape, now: Moment) -> FloatArray:
    """Find the ground plans of cars.

    Args:
        cars: Bodies of their models.
        now: Where they are.

    Returns:
        Rectangles x, y, yaw, half length, half width, shape (n, 5).
    """
    poses = now.poses
    rectangles = np.empty((len(poses), 5))
    for car in range(len(poses)):
        kind = now.kind_of[car]
        front, rear, half_width = cars.front[kind], cars.rear[kind], cars.half_width[kind]
        middle = (front - rear) / 2
        yaw = poses[car, 2]
        rectangles[car, 0] = poses[car, 0] + middle * math.cos(yaw)
        rectangles[car, 1] = poses[car, 1] + middle * math.sin(yaw)
        rectangles[car, 2], rectangles[car, 3], rectangles[car, 4] = yaw, (front + rear) / 2, half_width
    return rectangles


@njit(cache=True)
def near_cars(
    bodies: FloatArray,
    boxes: FloatArray,
    margin: float,
    best: float,
    car_pairs: IntArray,
    box_pairs: IntArray,
) -> tuple[int, int, float]:
    """Find what cars could touch within a tick, and their smallest distance from each other.

    Args:
        bodies: Car rectangles x, y, yaw, half length, half width, shape (n, 5).
        boxes: Fixed rectangles in the same form, shape (k, 5).
        margin: Distance up to which a pair counts as near [m].
        best: Smallest distance found so far; only what is closer is measured exactly [m].
        car_pairs: Out: indices of near cars, shape (>= n (n - 1) / 2 or fewer, 2).
        box_pairs: Out: car and box of near pairs, shape (p, 2).

    Returns:
        Number of near car pairs, number of near car-box pairs, smallest distance between cars or `best`. A number
        larger than the room in an output array says how much room is needed.
    """
    n_cars, n_boxes = 0, 0
    for i in range(len(bodies)):
        reach = math.hypot(bodies[i, 3], bodies[i, 4])
        for j in range(i + 1, len(bodies)):
            cutoff = max(margin, best)
            gap = math.hypot(bodies[j, 0] - bodies[i, 0], bodies[j, 1] - bodies[i, 1])
            gap -= reach + math.hypot(bodies[j, 3], bodies[j, 4])
            if gap > cutoff:
                continue
            gap = _rectangle_gap(bodies[i], bodies[j], cutoff)
            best = min(best, gap)
            if gap <= margin:
                if n_cars < len(car_pairs):
                    car_pairs[n_cars, 0], car_pairs[n_cars, 1] = i, j
                n_cars += 1
        for j in range(len(boxes)):
            dx = abs(boxes[j, 0] - bodies[i, 0]) - reach - boxes[j, 3]
            dy = abs(boxes[j, 1] - bodies[i, 1]) - reach - boxes[j, 4]
            if max(dx, dy) > margin:
                continue
            if _rectangle_gap(bodies[i], boxes[j], margin) <= margin:
                if n_boxes < len(box_pairs):
                    box_pairs[n_boxes, 0], box_pairs[n_boxes, 1] = i, j
                n_boxes += 1
    return n_cars, n_boxes, best


@njit(cache=True)
def arm_gap(
    arms: ArmShapes,
    now: Moment,
    bodies: FloatArray,
    heights: FloatArray,
    margin: float,
    best: float,
    near: BoolArray,
) -> float:
    """Find the smallest distance between arms and the cars they do not serve, and which arms cars are near to.

    An arm is a chain of spheres at its joints, half-way between them, and along its tool; a held parcel is the sphere
    around it. Spheres enclose the links to about 2 cm, so the distance is rather too small than too large.

    Args:
        arms: The arms.
        now: Their joints, what they hold and whom they serve.
        bodies: Car rectangles x, y, yaw, half length, half width, shape (n, 5).
        heights: Heights of the models of cars [m], shape (k,).
        margin: Distance from an arm's reach up to which a car counts as near [m].
        best: Smallest distance so far [m].
        near: Out: whether any car, served or not, is near each arm, shape (m,).

    Returns:
        Smallest distance, at most `best`, not below 0 [m].
    """
    base, joints, tool_length, radii = arms
    _, kind_of, q, held, serving = now
    m, n_joints = q.shape
    n_points = 2 * n_joints + 4
    points = np.empty((n_points, 4))
    for arm in range(m):
        reach = tool_length[arm]
        for j in range(n_joints):
            t = joints[arm, j]
            reach += math.sqrt(t[0, 3] ** 2 + t[1, 3] ** 2 + t[2, 3] ** 2)
        bare = True
        near[arm] = False
        for car in range(len(bodies)):
            gap = math.hypot(bodies[car, 0] - base[arm, 0], bodies[car, 1] - base[arm, 1])
            gap -= reach + math.hypot(bodies[car, 3], bodies[car, 4]) + max(held[arm, 3], radii[arm, 0])
            near[arm] = near[arm] or gap <= margin
            if car == serving[arm] or gap > best:
                continue
            if bare:
                _chain(base[arm], joints[arm], q[arm], tool_length[arm], radii[arm], points)
                for k in range(4):
                    points[n_points - 1, k] = held[arm, k]
                bare = False
            x, y, yaw = bodies[car, 0], bodies[car, 1], bodies[car, 2]
            half_length, half_width = bodies[car, 3], bodies[car, 4]
            c, s = math.cos(yaw), math.sin(yaw)
            for k in range(n_points):
                if points[k, 3] < 0.0:
                    continue
                dx, dy = points[k, 0] - x, points[k, 1] - y
                u = max(abs(dx * c + dy * s) - half_length, 0.0)
                v = max(abs(dy * c - dx * s) - half_width, 0.0)
                w = max(points[k, 2] - heights[kind_of[car]], -points[k, 2], 0.0)
                best = min(best, max(math.sqrt(u * u + v * v + w * w) - points[k, 3], 0.0))
    return best


@njit(cache=True)
def _chain(
    base: FloatArray,
    joints: FloatArray,
    q: FloatArray,
    tool_length: float,
    radii: FloatArray,
    points: FloatArray,
) -> None:
    """Fill in the spheres of one arm (all rows but the last): x, y, z, radius."""
    n_joints = len(q)
    # Rows of the frame's matrix; products written out, because a library product takes seconds to compile.
    pose, step = np.zeros((3, 4)), np.zeros((3, 4))
    pose[0, 0] = pose[1, 1] = math.cos(base[3])
    pose[1, 0] = math.sin(base[3])
    pose[0, 1] = -pose[1, 0]
    pose[2, 2] = 1.0
    for r in range(3):
        pose[r, 3] = base[r]
    for j in range(n_joints):
        t = joints[j]
        c, s = math.cos(q[j]), math.sin(q[j])
        for r in range(3):
            for k in range(4):
                step[r, k] = pose[r, 0] * t[0, k] + pose[r, 1] * t[1, k] + pose[r, 2] * t[2, k]
            step[r, 3] += pose[r, 3]
        for r in range(3):
            points[2 * j, r] = (pose[r, 3] + step[r, 3]) / 2
            points[2 * j + 1, r] = step[r, 3]
            pose[r, 0], pose[r, 1] = step[r, 0] * c + step[r, 1] * s, step[r, 1] * c - step[r, 0] * s
            pose[r, 2], pose[r, 3] = step[r, 2], step[r, 3]
        points[2 * j, 3] = points[2 * j + 1, 3] = radii[j]
    for k in range(3):
        row = 2 * n_joints + k
        for r in range(3):
            points[row, r] = pose[r, 3] + pose[r, 2] * tool_length * (k + 1) / 3
        points[row, 3] = radii[n_joints]


@njit(cache=True)
def near_and_gap(
    cars: CarShape,
    arms: ArmShapes,
    now: Moment,
    boxes: FloatArray,
    margin: float,
    best: float,
    near: Near,
) -> tuple[int, int, float]:
    """Do `near_cars` and `arm_gap` in one call; returns what the first does, the distance of both.

    Named parts cost 3 us per tick of the engine, which takes a thousand.
    """
    bodies = car_rectangles(cars, now)
    n_cars, n_boxes, best = near_cars(bodies, boxes, margin, best, near.cars, near.boxes)
    best = arm_gap(arms, now, bodies, cars.height, margin, best, near.arms)
    return n_cars, n_boxes, best
