"""Referee: what is wrong with a plan on an open floor, and with a problem; it shares no code with the planner.

A way is looked at in equal times, each pose found from its leg in closed form. Rectangles are told apart by their
corners' shadows, discs by their distance from a rectangle's edges.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from planners.open_floor.arrays import BoolArray, FloatArray
from planners.open_floor.plan import CarWay, OpenFloorPlan
from planners.open_floor.problem import CarOutline, OpenFloorProblem

_DEPTH_M = 1e-6
"""Bodies that reach no deeper into each other only touch [m]."""
_PLACE_M, _YAW_RAD = 1e-3, 1e-3
"""How far from its start and goal a way may begin and end."""


class BreachKind(StrEnum):
    """What a plan does that it must not."""

    MISSING = "missing"
    """A car has no way."""
    START = "start"
    GOAL = "goal"
    MOTION = "motion"
    """A leg is too fast, too tightly curved, or no motion."""
    OFF_FLOOR = "off the floor"
    OBSTACLE = "obstacle"
    OVERLAP = "overlap"


@dataclass(frozen=True, kw_only=True)
class FloorBreach:
    """One thing that is wrong."""

    kind: BreachKind
    cars: tuple[int, ...]
    time_s: float
    """When it is first wrong [s]."""

    def __str__(self) -> str:
        who = f"car {self.cars[0]}" if len(self.cars) == 1 else f"cars {self.cars[0]} and {self.cars[1]}"
        return f"{self.kind}, {who}, {self.time_s:.2f} s"


def breaches(
    problem: OpenFloorProblem, plan: OpenFloorPlan, *, checks: int = 32, speed_mps: float = 1.0
) -> list[FloorBreach]:
    """Check a plan from the first start to the last arrival.

    Args:
        problem: What the plan is for.
        plan: Of any planner.
        checks: Poses of each of the plan's steps that are looked at.
        speed_mps: Fastest that cars drive.

    Returns:
        What is wrong, for each car and pair of cars the first of each kind; empty for a legal plan.
    """
    found = []
    for car, way in enumerate(plan.ways):
        if way is None:
            found.append(FloorBreach(kind=BreachKind.MISSING, cars=(car,), time_s=0.0))
        else:
            wrong = _wrong_legs(way, problem, car, speed_mps)
            found += [FloorBreach(kind=kind, cars=(car,), time_s=time_s) for kind, time_s in wrong]
    if plan.step_s <= 0 or any(breach.kind in (BreachKind.MISSING, BreachKind.MOTION) for breach in found):
        return found
    times = np.arange(0, int(np.ceil(plan.makespan_s / plan.step_s * checks)) + 1) * (plan.step_s / checks)
    poses = (
        np.stack([_driven(way, times) for way in plan.ways if way is not None]) if plan.ways else np.empty((0, 1, 3))
    )
    for kind, cars, k in _wrong_places(problem, poses):
        found.append(FloorBreach(kind=kind, cars=cars, time_s=float(times[k])))
    return found


def illegal_poses(problem: OpenFloorProblem) -> list[str]:
    """Why a problem cannot be solved by anybody: starts or goals in obstacles, off the floor, or in each other.

    Args:
        problem: The problem.

    Returns:
        One text for each such pose or pair; empty if the problem is legal.
    """
    texts = []
    for what, poses in (("start", problem.starts), ("goal", problem.goals)):
        for kind, cars, _ in _wrong_places(problem, np.asarray(poses, dtype=np.float64)[:, None]):
            if len(cars) == 2:
                texts.append(f"{what}s of cars {cars[0]} and {cars[1]} overlap")
            else:
                where = "in an obstacle" if kind is BreachKind.OBSTACLE else kind.value
                texts.append(f"{what} of car {cars[0]} is {where}")
    return texts


def corners_of(car: CarOutline, poses: FloatArray) -> FloatArray:
    """Corners of a car, counter-clockwise from the front left one.

    Args:
        car: Its shape.
        poses: x, y, yaw, shape (..., 3).

    Returns:
        x, y [m], shape (..., 4, 2).
    """
    along = np.array([car.front_m, -car.rear_m, -car.rear_m, car.front_m])
    across = np.array([car.half_width_m, car.half_width_m, -car.half_width_m, -car.half_width_m])
    turned = np.exp(1j * poses[..., 2, None]) * (along + 1j * across)
    place = poses[..., 0, None] + 1j * poses[..., 1, None] + turned
    return np.stack([place.real, place.imag], axis=-1)


def _wrong_legs(
    way: CarWay, problem: OpenFloorProblem, car: int, speed_mps: float
) -> Iterator[tuple[BreachKind, float]]:
    """Legs that no car can drive, and ends that are not those of the problem."""
    duration, length, curvature = way.legs.T
    sound = np.isfinite(way.legs).all(axis=1) & (duration >= 0)
    sound &= np.abs(length) <= speed_mps * duration * (1.0 + 1e-9) + 1e-9
    sound &= np.abs(curvature) * problem.car.turning_radius_m <= 1.0 + 1e-9
    if not sound.all():
        yield BreachKind.MOTION, float(duration[: int(np.argmin(sound))].sum())
        return
    ends = _driven(way, np.array([0.0, duration.sum()]))
    for kind, is_pose, time_s in zip((BreachKind.START, BreachKind.GOAL), ends, (0.0, duration.sum()), strict=True):
        wanted = (problem.starts if kind is BreachKind.START else problem.goals)[car]
        turn = np.angle(np.exp(1j * (is_pose[2] - wanted[2])))
        if np.hypot(*(is_pose - wanted)[:2]) > _PLACE_M or abs(turn) > _YAW_RAD:
            yield kind, float(time_s)


def _driven(way: CarWay, times: npt.NDArray[np.floating]) -> FloatArray:
    """Poses at ascending times, by complex numbers: an arc turns what is left of the way, shape (k, 3)."""
    place, yaw, begin = complex(way.start[0], way.start[1]), float(way.start[2]), 0.0
    poses = np.empty((len(times), 3))
    poses[:] = way.start
    for duration, length, curvature in way.legs:
        later = times >= begin
        share = np.clip((times[later] - begin) / duration, 0.0, 1.0) if duration > 0 else np.ones(later.sum())
        turn = share * length * curvature
        if curvature == 0:
            moved = share * length * np.exp(1j * yaw)
        else:
            moved = (np.exp(1j * (yaw + turn)) - np.exp(1j * yaw)) / (1j * curvature)
        poses[later] = np.column_stack(((place + moved).real, (place + moved).imag, yaw + turn))
        whole = length * curvature
        if curvature == 0:
            place += length * np.exp(1j * yaw)
        else:
            place += (np.exp(1j * (yaw + whole)) - np.exp(1j * yaw)) / (1j * curvature)
        yaw, begin = yaw + whole, begin + duration
    return poses


def _wrong_places(problem: OpenFloorProblem, poses: FloatArray) -> Iterator[tuple[BreachKind, tuple[int, ...], int]]:
    """What is wrong with poses of cars at some times (n, k, 3), with the time at which it first is."""
    corners = corners_of(problem.car, poses)
    reach = float(np.hypot(max(problem.car.front_m, problem.car.rear_m), problem.car.half_width_m))
    for car in range(len(poses)):
        on_floor = corners[car].reshape(-1, 4, 2) if problem.walled else poses[car][:, None, :2]
        off = ((on_floor < -_DEPTH_M) | (on_floor > np.asarray(problem.size_m) + _DEPTH_M)).any(axis=(1, 2))
        if off.any():
            yield BreachKind.OFF_FLOOR, (car,), int(np.argmax(off))
        hit = np.zeros(poses.shape[1], dtype=np.bool_)
        for x, y, radius in problem.discs:
            close = np.flatnonzero(np.hypot(poses[car, :, 0] - x, poses[car, :, 1] - y) < reach + radius)
            hit[close] |= _distance(corners[car, close], np.array([x, y])) < radius - _DEPTH_M
        if hit.any():
            yield BreachKind.OBSTACLE, (car,), int(np.argmax(hit))
        for other in range(car):
            gap = np.hypot(*(poses[car, :, :2] - poses[other, :, :2]).T)
            close = np.flatnonzero(gap < 2.0 * reach)
            overlap = _overlap(corners[car, close], corners[other, close])
            if overlap.any():
                yield BreachKind.OVERLAP, (other, car), int(close[np.argmax(overlap)])


def _overlap(first: FloatArray, second: FloatArray) -> BoolArray:
    """Whether rectangles (k, 4, 2) overlap: on no edge's normal do the shadows of their corners lie apart."""
    apart = np.zeros(len(first), dtype=np.bool_)
    for rectangle in (first, second):
        for edge in range(2):
            normal = rectangle[:, edge + 1] - rectangle[:, edge]
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            a, b = (np.einsum("kij,kj->ki", one, normal) for one in (first, second))
            apart |= (a.max(axis=1) <= b.min(axis=1) + _DEPTH_M) | (b.max(axis=1) <= a.min(axis=1) + _DEPTH_M)
    return ~apart


def _distance(corners: FloatArray, point: FloatArray) -> FloatArray:
    """Distance of a point from rectangles (k, 4, 2), 0 inside, shape (k,)."""
    best = np.full(len(corners), np.inf)
    inside = np.ones(len(corners), dtype=np.bool_)
    for edge in range(4):
        a, b = corners[:, edge], corners[:, (edge + 1) % 4]
        along, to_point = b - a, point - a
        share = np.clip((along * to_point).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(to_point - share[:, None] * along, axis=1))
        inside &= along[:, 0] * to_point[:, 1] - along[:, 1] * to_point[:, 0] >= 0
    return np.where(inside, 0.0, best)
