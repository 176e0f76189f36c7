"""Collision checks of an arm's spheres against boxes and against itself, in the arm's base frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.errors import PlanningError
from planners.motion.arm_model import ArmModel
from planners.motion.kinematics import joint_rows, link_frames_into

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_COLLISION, _NEAR, _CLEAR = 0, 1, 2  # states of a configuration
_QUEUE = 8192  # waiting sub-intervals of one edge; 20 rad at the finest step has 4096
_FINEST_RAD = 0.01  # intervals shorter than this are not split again


def _no_points() -> FloatArray:
    return np.empty((0, 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxes:
    """Upright boxes in the arm's base frame: turned about z only."""

    centre: FloatArray = field(default_factory=_no_points)
    """Box centres [m], shape (k, 3)."""
    half: FloatArray = field(default_factory=_no_points)
    """Half edge lengths [m], shape (k, 3)."""
    yaw: FloatArray = field(default_factory=lambda: np.empty(0))
    """Rotations about z [rad], shape (k,)."""
    min_frame: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    """Spheres on link frames below this are not tested (the base may stand on the floor), shape (k,)."""

    def __post_init__(self) -> None:
        k = len(self.yaw)
        if self.centre.shape != (k, 3) or self.half.shape != (k, 3) or self.min_frame.shape != (k,):
            raise PlanningError(
                f"Boxes: centre {self.centre.shape}, half {self.half.shape}, yaw {self.yaw.shape}, "
                f"min_frame {self.min_frame.shape}; expected (k, 3), (k, 3), (k,), (k,)"
            )
        if np.any(self.half <= 0) or not np.all(np.isfinite(self.centre)):
            raise PlanningError("Boxes: half extents must be positive and centres finite")

    @classmethod
    def one(cls, centre: npt.ArrayLike, half: npt.ArrayLike, *, yaw: float = 0.0, min_frame: int = 0) -> Boxes:
        """A single box: centre (3,) and half edge lengths (3,) [m], yaw [rad]."""
        return cls(
            centre=np.array(centre, dtype=np.float64).reshape(1, -1),
            half=np.array(half, dtype=np.float64).reshape(1, -1),
            yaw=np.array([yaw], dtype=np.float64),
            min_frame=np.array([min_frame], dtype=np.int64),
        )

    @classmethod
    def join(cls, *parts: Boxes) -> Boxes:
        """All boxes of several sets, in order."""
        if not parts:
            return cls()
        return cls(
            centre=np.concatenate([p.centre for p in parts]),
            half=np.concatenate([p.half for p in parts]),
            yaw=np.concatenate([p.yaw for p in parts]),
            min_frame=np.concatenate([p.min_frame for p in parts]),
        )

    def __len__(self) -> int:
        return len(self.yaw)


@njit(cache=True)
def _place(q, joints, spheres, frames, points):  # type: ignore[no-untyped-def]
    """Sphere centres in the base frame."""
    link_frames_into(joints, q, frames)
    for s in range(spheres.shape[0]):
        f = int(spheres[s, 4])
        for a in range(3):
            points[s, a] = (
                frames[f, a, 0] * spheres[s, 0]
                + frames[f, a, 1] * spheres[s, 1]
                + frames[f, a, 2] * spheres[s, 2]
                + frames[f, a, 3]
            )


@njit(cache=True)
def _box_distance_squared(point, box):  # type: ignore[no-untyped-def]
    x = point[0] - box[0]
    y = point[1] - box[1]
    dx = max(abs(x * box[6] + y * box[7]) - box[3], 0.0)
    dy = max(abs(y * box[6] - x * box[7]) - box[4], 0.0)
    dz = max(abs(point[2] - box[2]) - box[5], 0.0)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True)
def _distance_squared(a, b):  # type: ignore[no-untyped-def]
    x = a[0] - b[0]
    y = a[1] - b[1]
    z = a[2] - b[2]
    return x * x + y * y + z * z


@njit(cache=True)
def _state(q, reach, joints, spheres, parts, pairs, groups, boxes, margin, frames, points):  # type: ignore[no-untyped-def]
    """_COLLISION, _NEAR (free, but not for all motion within `reach`) or _CLEAR.

    `reach` (k, n+1): bound on how far sphere s moves while joints f..n-1 make their allowed motion. The spheres of
    one rigid part have a common hull sphere: only when that is near does the test look at the single ones.
    """
    _place(q, joints, spheres, frames, points)
    near = False
    for p in range(parts.shape[0] - 1, -1, -1):  # tip first: it hits most
        hull = parts[p, 0]
        hull_frame = spheres[hull, 4]
        hull_wide = spheres[hull, 3] + max(margin, reach[hull, 0])
        for b in range(boxes.shape[0]):
            if _box_distance_squared(points[hull], boxes[b]) >= hull_wide * hull_wide or hull_frame < boxes[b, 8]:
                continue
            for s in range(parts[p, 1], parts[p, 2]):
                r = spheres[s, 3] + margin
                square = _box_distance_squared(points[s], boxes[b])
                if square < r * r:
                    return _COLLISION
                wide = spheres[s, 3] + reach[s, 0]
                if square < wide * wide:
                    near = True
    for g in range(groups.shape[0]):
        i = groups[g, 0]
        j = groups[g, 1]
        wide = spheres[i, 3] + spheres[j, 3] + reach[j, int(spheres[i, 4])]
        if _distance_squared(points[i], points[j]) >= wide * wide:
            continue
        for k in range(groups[g, 2], groups[g, 3]):
            i = pairs[k, 0]
            j = pairs[k, 1]
            r = spheres[i, 3] + spheres[j, 3]
            square = _distance_squared(points[i], points[j])
            if square < r * r:
                return _COLLISION
            wide = r + reach[j, int(spheres[i, 4])]
            if square < wide * wide:
                near = True
    return _NEAR if near else _CLEAR


@njit(cache=True)
def edge_free(a, b, scene):  # type: ignore[no-untyped-def]
    """Whether the straight joint-space motion from a to b is free; a itself is taken as free.

    Intervals are halved breadth first until motion bounds prove each free. `scene` is `CollisionChecker.scene`.
    """
    joints, spheres, parts, pairs, groups, boxes, lever, margin, frames, points, q, reach, total, queue = scene
    n = q.shape[0]
    length = 0.0
    for i in range(n):
        length += (b[i] - a[i]) ** 2
    length = np.sqrt(length)
    for s in range(spheres.shape[0]):
        bound = 0.0
        total[s, n] = 0.0
        reach[s, n] = 0.0
        for i in range(n - 1, -1, -1):
            bound += lever[s, i] * abs(b[i] - a[i])
            total[s, i] = bound
            reach[s, i] = 0.0
    if _state(b, reach, joints, spheres, parts, pairs, groups, boxes, margin, frames, points) == _COLLISION:
        return False
    queue[0, 0] = 0.0
    queue[0, 1] = 1.0
    head = 0
    tail = 1
    last_width = 0.0
    while head < tail:
        lo = queue[head % queue.shape[0], 0]
        hi = queue[head % queue.shape[0], 1]
        head += 1
        middle = 0.5 * (lo + hi)
        width = hi - lo
        for i in range(n):
            q[i] = a[i] + (b[i] - a[i]) * middle
        if width != last_width:
            for s in range(spheres.shape[0]):
                for i in range(n):
                    reach[s, i] = 0.5 * width * total[s, i]
            last_width = width
        state = _state(q, reach, joints, spheres, parts, pairs, groups, boxes, margin, frames, points)
        if state == _COLLISION:
            return False
        if state == _NEAR and width * length > _FINEST_RAD:
            for h in range(2):
                slot = tail % queue.shape[0]
                queue[slot, 0] = middle if h else lo
                queue[slot, 1] = hi if h else middle
                tail += 1
    return True


@njit(cache=True)
def _states_free(q, still, joints, spheres, parts, pairs, groups, boxes, margin, frames, points, out):  # type: ignore[no-untyped-def]
    for i in range(q.shape[0]):
        state = _state(q[i], still, joints, spheres, parts, pairs, groups, boxes, margin, frames, points)
        out[i] = state != _COLLISION


@njit(cache=True)
def _clearance(q, n_spheres, joints, spheres, boxes, frames, points):  # type: ignore[no-untyped-def]
    _place(q, joints, spheres, frames, points)
    best = np.inf
    for s in range(n_spheres):
        for b in range(boxes.shape[0]):
            if spheres[s, 4] < boxes[b, 8]:
                continue
            x = points[s, 0] - boxes[b, 0]
            y = points[s, 1] - boxes[b, 1]
            dx = abs(x * boxes[b, 6] + y * boxes[b, 7]) - boxes[b, 3]
            dy = abs(y * boxes[b, 6] - x * boxes[b, 7]) - boxes[b, 4]
            dz = abs(points[s, 2] - boxes[b, 2]) - boxes[b, 5]
            outside = np.sqrt(max(dx, 0.0) ** 2 + max(dy, 0.0) ** 2 + max(dz, 0.0) ** 2)
            best = min(best, outside + min(0.0, max(dx, dy, dz)) - spheres[s, 3])
    return best


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


def _with_hulls(
    centre: FloatArray, radius: FloatArray, part: IntArray, pairs: IntArray, lever: FloatArray, n: int
) -> tuple[FloatArray, IntArray, IntArray, IntArray, FloatArray]:
    """Append one hull sphere per part and group the sphere pairs by pair of parts.

    Returns the sphere table (k+m, 5) of centre, radius, frame; parts (m, 3) of hull row, first and end sphere; groups
    (g, 4) of hull rows, first and end pair; the sorted pairs (p, 2); the levers (k+m, n).
    """
    names, first, count = np.unique(part, return_index=True, return_counts=True)
    rows, parts = [], []
    for i, (a, m) in enumerate(zip(first, count, strict=True)):
        own, size = centre[a : a + m], radius[a : a + m]
        middle = 0.5 * ((own - size[:, None]).min(0) + (own + size[:, None]).max(0))
        rows.append([*middle, (np.linalg.norm(own - middle, axis=1) + size).max(), min(names[i], n)])
        parts.append([len(centre) + i, a, a + m])
        # The hull moves less than its farthest sphere may: the largest bound keeps the pre-test safe.
        lever = np.concatenate([lever, lever[a : a + m].max(0, keepdims=True)])
    spheres = np.concatenate([np.column_stack([centre, radius, np.minimum(part, n)]), np.reshape(rows, (-1, 5))])
    owner = np.searchsorted(names, part[pairs])  # (p, 2)
    pairs = pairs[np.lexsort((owner[:, 1], owner[:, 0]))]
    owner = np.searchsorted(names, part[pairs])
    both, start, length = np.unique(owner, axis=0, return_index=True, return_counts=True)
    groups = np.column_stack([both + len(centre), start, start + length])
    return (
        np.ascontiguousarray(spheres),
        np.array(parts, dtype=np.int64).reshape(-1, 3),
        np.ascontiguousarray(groups.astype(np.int64).reshape(-1, 4)),
        np.ascontiguousarray(pairs),
        np.ascontiguousarray(lever),
    )


class CollisionChecker:
    """Answers whether an arm, and what it holds, is free of boxes and of itself.

    Edges are checked by motion bounds: an accepted edge keeps every sphere, without the margin, out of every box all
    along, not only at samples (down to sub-intervals of 0.01 rad, where the margin has to cover the rest: 0.01 m
    does for an arm of 1.3 m reach). Not thread-safe: the scratch memory belongs to the object.
    """

    def __init__(
        self,
        model: ArmModel,
        boxes: Boxes,
        held_spheres: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        margin: float = 0.01,
    ) -> None:
        """Prepare the arrays of one scene.

        Args:
            model: The arm.
            boxes: Obstacles in the arm's base frame.
            held_spheres: Centres in the last link frame (m, 3) and radii (m,) of a held parcel [m]; tested against the
                boxes and against all links but the last two.
            margin: Extra distance kept from boxes [m], >= 0; self collision has none.

        Raises:
            PlanningError: Shapes do not fit, or the margin is negative.
        """
        if not margin >= 0:
            raise PlanningError(f"CollisionChecker: margin {margin} m, expected >= 0")
        held_centre = np.empty((0, 3)) if held_spheres is None else np.asarray(held_spheres[0], dtype=np.float64)
        held_radius = np.empty(0) if held_spheres is None else np.asarray(held_spheres[1], dtype=np.float64)
        if held_centre.shape != (len(held_radius), 3):
            raise PlanningError(
                f"CollisionChecker: held spheres {held_centre.shape} and {held_radius.shape}, expected (m, 3) and (m,)"
            )
        n = model.n_joints
        order = np.argsort(model.sphere_frame, kind="stable")  # the kernels want each part's spheres side by side
        arm_frame = model.sphere_frame[order]
        centre = np.concatenate([model.sphere_centre[order], held_centre])
        radius = np.concatenate([model.sphere_radius[order], held_radius])
        part = np.concatenate([arm_frame, np.full(len(held_radius), n + 1)]).astype(np.int64)
        body, held = np.flatnonzero(arm_frame <= n - 2), np.flatnonzero(part > n)
        held_pairs = np.stack(np.meshgrid(body, held, indexing="ij"), axis=-1).reshape(-1, 2)
        pairs = np.concatenate([np.argsort(order)[model.self_pairs], held_pairs]).astype(np.int64)
        lever = _lever_bounds(joint_rows(model.base_from_joint), centre, np.minimum(part, n))
        spheres, parts, groups, pairs, lever = _with_hulls(centre, radius, part, pairs, lever, n)
        table = np.column_stack([boxes.centre, boxes.half, np.cos(boxes.yaw), np.sin(boxes.yaw), boxes.min_frame])
        self.model = model
        self.boxes = boxes
        self.margin = float(margin)
        self.n_spheres = len(centre)
        """Spheres of the arm and of what it holds."""
        self._joints = joint_rows(model.base_from_joint)
        self._spheres = spheres
        self._parts = parts
        self._pairs = pairs
        self._groups = groups
        self._table = np.ascontiguousarray(table, dtype=np.float64)
        self._frames = np.empty((n + 1, 3, 4))
        self._points = np.empty((len(spheres), 3))
        self._still = np.zeros((len(spheres), n + 1))
        self.scene = (
            self._joints,
            spheres,
            parts,
            pairs,
            groups,
            self._table,
            lever,
            self.margin,
            self._frames,
            self._points,
            np.empty(n),
            np.empty((len(spheres), n + 1)),
            np.empty((len(spheres), n + 1)),
            np.empty((_QUEUE, 2)),
        )
        """What `edge_free` takes after its two configurations, for kernels that plan: the scene and scratch memory."""

    def free(self, q: npt.ArrayLike) -> bool:
        """Whether one configuration (n,) is free of boxes (with margin) and of itself; limits are not looked at."""
        state = _state(
            self._angles(q),
            self._still,
            self._joints,
            self._spheres,
            self._parts,
            self._pairs,
            self._groups,
            self._table,
            self.margin,
            self._frames,
            self._points,
        )
        return bool(state != _COLLISION)

    def edge(self, a: npt.ArrayLike, b: npt.ArrayLike) -> bool:
        """Whether the straight joint-space motion from a (n,) to b (n,) is free; `a` itself is taken as free."""
        return bool(edge_free(self._angles(a), self._angles(b), self.scene))

    def path_free(self, path: npt.ArrayLike) -> bool:
        """Whether a piecewise straight path (m, n) is free, its first configuration included."""
        points = np.asarray(path, dtype=np.float64)
        if len(points) == 0 or not self.free(points[0]):
            return False
        return all(self.edge(a, b) for a, b in pairwise(points))

    def batch(self, q: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """`free` for many configurations (m, n), shape (m,)."""
        angles = np.ascontiguousarray(q, dtype=np.float64).reshape(-1, self.model.n_joints)
        out = np.empty(len(angles), dtype=np.bool_)
        _states_free(
            angles,
            self._still,
            self._joints,
            self._spheres,
            self._parts,
            self._pairs,
            self._groups,
            self._table,
            self.margin,
            self._frames,
            self._points,
            out,
        )
        return out

    def clearance(self, q: npt.ArrayLike) -> float:
        """Smallest distance from any sphere to any box [m]; negative when they overlap, infinite without boxes."""
        distance = _clearance(
            self._angles(q), self.n_spheres, self._joints, self._spheres, self._table, self._frames, self._points
        )
        return float(distance)

    def sphere_centres(self, q: npt.ArrayLike) -> FloatArray:
        """Sphere centres of arm and held parcel in the base frame [m], shape (k, 3)."""
        _place(self._angles(q), self._joints, self._spheres, self._frames, self._points)
        return self._points[: self.n_spheres].copy()

    def _angles(self, q: npt.ArrayLike) -> FloatArray:
        angles = np.ascontiguousarray(q, dtype=np.float64)
        if angles.shape != (self.model.n_joints,):
            raise PlanningError(f"q: shape {angles.shape}, expected ({self.model.n_joints},)")
        return angles
