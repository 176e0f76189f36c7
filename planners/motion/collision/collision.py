"""Collision checks of an arm's spheres against obstacles and against itself, in the arm's base frame."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arm.arm_model import ArmModel
from planners.motion.arm.kinematics import joint_rows
from planners.motion.arrays import BoolArray, FloatArray, IntArray
from planners.motion.collision.obstacles import Boxes, Capsules, rounded_boxes
from planners.motion.collision.scene_kernel import (
    MAX_PARTS,
    checks_from_python,
    clearance,
    make_scene,
    path_free,
    spheres_at,
    states_free,
)

_FLOAT = np.float64


def _lever_bounds(joints: FloatArray, centre: FloatArray, frame: IntArray) -> FloatArray:
    """Upper bounds of the distance from each joint's axis to each sphere over all configurations, shape (k, n)."""
    n = len(joints)
    step = np.linalg.norm(joints[:, :, 3], axis=1)
    lever = np.zeros((len(centre), n))
    for s, (c, f) in enumerate(zip(centre, frame, strict=True)):
        for j in range(f):
            # The first offset after a joint is fixed in that joint's frame: only its part off the axis counts.
            if f == j + 1:
                lever[s, j] = np.hypot(c[0], c[1])
            else:
                lever[s, j] = np.hypot(*joints[j + 1, :2, 3]) + step[j + 2 : f].sum() + np.linalg.norm(c)
    return lever


def _hulls(spheres: FloatArray, part: IntArray) -> tuple[FloatArray, IntArray]:
    """A sphere around each part (m, 4) and the first and end sphere of each (m, 2)."""
    _, first, count = np.unique(part, return_index=True, return_counts=True)
    hulls = []
    for a, m in zip(first, count, strict=True):
        own, size = spheres[a : a + m, :3], spheres[a : a + m, 3]
        middle = 0.5 * ((own - size[:, None]).min(0) + (own + size[:, None]).max(0))
        hulls.append([*middle, (np.linalg.norm(own - middle, axis=1) + size).max()])
    return np.reshape(hulls, (-1, 4)), np.column_stack([first, first + count])


def _runs(pairs: IntArray, owner: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Group pairs of spheres by parts, then by the first sphere; `owner` is the part of each sphere, by row."""
    parts = owner[pairs]  # (p, 2)
    order = np.lexsort((pairs[:, 1], pairs[:, 0], parts[:, 1], parts[:, 0]))
    keys = np.column_stack([parts, pairs[:, :1]])[order]
    heads, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
    both, start, length = np.unique(heads[:, :2], axis=0, return_index=True, return_counts=True)
    return (
        np.column_stack([both, start, start + length]),
        np.column_stack([heads[:, 2], first, first + count]),
        pairs[order, 1],
    )


def _reachable_boxes(
    joints: FloatArray, hulls: FloatArray, frame: IntArray, boxes: FloatArray, margin: float
) -> list[IntArray]:
    """Which boxes each part's hull can come near at all, by the triangle inequality; shape (m,) of rows.

    The joints' offsets are summed from the first point that all of the arm turns about: the base for the first
    frame, the second joint's origin for the others if it lies on the first axis.
    """
    on_axis = len(joints) > 1 and bool(np.hypot(*joints[1, :2, 3]) < 1e-9)
    root = joints[0, :, 3] + (joints[0, :, 2] * joints[1, 2, 3] if on_axis else 0.0)
    step = np.linalg.norm(joints[:, :, 3], axis=1)
    rows = []
    for hull, f in zip(hulls, frame, strict=True):
        apart = np.linalg.norm(hull[:3])
        if f == 0:
            centre, reach = hull[:3], 0.0
        elif f == 1 or not on_axis:
            centre, reach = joints[0, :, 3], step[1:f].sum() + apart
        else:
            centre, reach = root, step[2:f].sum() + apart
        offset = np.einsum("bij,bj->bi", boxes[:, 6:15].reshape(-1, 3, 3), centre - boxes[:, :3])
        gap = np.linalg.norm(np.maximum(np.abs(offset) - boxes[:, 3:6], 0.0), axis=1) - boxes[:, 15]
        rows.append(np.flatnonzero((gap <= reach + hull[3] + margin + 1e-9) & (f >= boxes[:, 16])))
    return rows


class CollisionChecker:
    """Answers whether an arm, and what it holds, is free of obstacles and of itself.

    Edges are checked by motion bounds: an accepted edge keeps every sphere, without the margin, out of every obstacle
    all along, not only at samples (down to sub-intervals of 0.01 rad, where the margin has to cover the rest: 0.01 m
    does for an arm of 1.3 m reach). Not thread-safe: the scratch memory belongs to the object.
    """

    def __init__(
        self,
        model: ArmModel,
        boxes: Boxes,
        held_spheres: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        margin: float = 0.01,
        capsules: Capsules | None = None,
    ) -> None:
        """Prepare the arrays of one scene.

        Args:
            model: The arm.
            boxes: Obstacles in the arm's base frame.
            held_spheres: Centres in the last link frame (m, 3) and radii (m,) of a held parcel [m]; tested against the
                obstacles and against all links but the last two.
            margin: Extra distance kept from obstacles [m], >= 0; self collision has none.
            capsules: More obstacles, such as the spheres of another arm at rest; None for none.

        Raises:
            PlanningError: Shapes or kinds do not fit, a number is out of range, or the arm has too many parts.
        """
        if not isinstance(model, ArmModel) or not isinstance(boxes, Boxes):
            raise PlanningError(
                f"CollisionChecker: {type(model).__name__} and {type(boxes).__name__}; valid: ArmModel and Boxes"
            )
        margin = checks.positive("CollisionChecker: margin", margin, zero=True)
        held_centre, held_radius = checks.spheres("CollisionChecker: held spheres", held_spheres)
        n = model.n_joints
        own_part = model.sphere_frame if model.sphere_part is None else model.sphere_part
        order = np.argsort(own_part, kind="stable")  # the kernels want each part's spheres side by side
        arm_frame = model.sphere_frame[order]
        centre = np.concatenate([model.sphere_centre[order], held_centre])
        radius = np.concatenate([model.sphere_radius[order], held_radius])
        part = np.concatenate([own_part[order], np.full(len(held_radius), n + 2)]).astype(np.int64)
        body, held = np.flatnonzero(arm_frame <= n - 2), np.flatnonzero(part > n + 1)
        held_pairs = np.stack(np.meshgrid(body, held, indexing="ij"), axis=-1).reshape(-1, 2)
        pairs = np.concatenate([np.argsort(order)[model.self_pairs], held_pairs]).astype(np.int64)

        names = np.unique(part)
        if len(names) > MAX_PARTS:
            raise PlanningError(f"CollisionChecker: {len(names)} rigid parts; valid: at most {MAX_PARTS}")
        joints = joint_rows(model.base_from_joint)
        spheres = np.column_stack([centre, radius])
        hulls, ranges = _hulls(spheres, part)
        frame = np.minimum(names, n)
        lever = _lever_bounds(joints, centre, np.minimum(part, n))
        groups, runs, partners = _runs(pairs, np.searchsorted(names, part))
        table = rounded_boxes(boxes, capsules if capsules is not None else Capsules())
        self.model = model
        self.boxes = boxes
        self.margin = margin
        self.n_spheres = len(centre)
        """Spheres of the arm and of what it holds."""
        self.scene = make_scene(
            joints=joints,
            spheres=spheres,
            hulls=hulls,
            parts=np.column_stack([frame, ranges]),
            near_boxes=_reachable_boxes(joints, hulls, frame, table, self.margin),
            groups=groups,
            runs=runs,
            partners=partners,
            boxes=table,
            # A part moves no farther than its farthest sphere may.
            lever=np.array([lever[a:b].max(0) for a, b in ranges]).reshape(-1, n),
            margin=self.margin,
        )
        """What `edge_free` takes after its two configurations, for kernels that plan: the scene and scratch memory."""
        self._shape = (n,)
        self._held = held_spheres
        self._capsules = capsules

    def with_margin(self, margin: float) -> CollisionChecker:
        """The same scene with another distance kept from obstacles [m]."""
        return CollisionChecker(self.model, self.boxes, self._held, margin, self._capsules)

    def free(self, q: npt.ArrayLike) -> bool:
        """Whether one configuration (n,) is free of obstacles (with margin) and of itself; limits are not looked at.

        What is not finite is not free.

        Raises:
            PlanningError: It has another shape, or is no numbers.
        """
        return checks_from_python().state_free(self._angles(q), self.scene)

    def edge(self, a: npt.ArrayLike, b: npt.ArrayLike) -> bool:
        """Whether the straight joint-space motion from a (n,) to b (n,) is free; `a` itself is taken as free.

        What is not finite is not free, nor is a motion of more than 40 rad.

        Raises:
            PlanningError: An end has another shape, or is no numbers.
        """
        return checks_from_python().edge_free(self._angles(a), self._angles(b), self.scene)

    def path_free(self, path: npt.ArrayLike) -> bool:
        """Whether a piecewise straight path (m, n) is free, its first configuration included; an empty one is not.

        Raises:
            PlanningError: The path has another shape, or is no numbers.
        """
        points = checks.floats("path", path)
        if points.ndim and len(points) == 0:
            return False
        if points.ndim != 2 or points.shape[1:] != self._shape:
            raise PlanningError(f"path: shape {points.shape}; valid: (m, {self._shape[0]})")
        return bool(path_free(points, self.scene))

    def batch(self, q: npt.ArrayLike) -> BoolArray:
        """`free` for many configurations (m, n), shape (m,).

        Raises:
            PlanningError: They have another shape, or are no numbers.
        """
        angles = checks.floats("q", q)
        if angles.ndim != 2 or angles.shape[1:] != self._shape:
            raise PlanningError(f"q: shape {angles.shape}; valid: (m, {self._shape[0]})")
        out = np.empty(len(angles), dtype=np.bool_)
        states_free(angles, out, self.scene)
        return out

    def clearance(self, q: npt.ArrayLike) -> float:
        """Smallest distance from any sphere to any obstacle [m]; negative when they overlap, infinite without any.

        Raises:
            PlanningError: Not one finite number per joint.
        """
        return float(clearance(checks.vector("q", q, *self._shape), self.scene))

    def sphere_centres(self, q: npt.ArrayLike) -> FloatArray:
        """Sphere centres of arm and held parcel in the base frame [m], shape (k, 3).

        Raises:
            PlanningError: Not one finite number per joint.
        """
        points = np.empty((self.n_spheres, 3))
        spheres_at(checks.vector("q", q, *self._shape), self.scene, points)
        return points

    def _angles(self, q: npt.ArrayLike) -> FloatArray:
        try:
            angles = np.ascontiguousarray(q, _FLOAT)
        except (TypeError, ValueError):
            raise PlanningError(f"q: {q!r}; valid: {self._shape[0]} numbers") from None
        if angles.shape != self._shape:
            raise PlanningError(f"q: shape {angles.shape}; valid: {self._shape}")
        return angles
