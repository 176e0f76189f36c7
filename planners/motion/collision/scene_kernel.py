"""Kernels of collision checks: an arm's spheres against rounded boxes and against each other, at states and on edges.

A scene brings its scratch memory along: these kernels are asked hundreds of thousands of times, and make no array.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from planners.motion.arrays import BoolArray, FloatArray, Int, IntArray, RowArray
from planners.motion.kernel import borrowing, entry_point, inlined

COLLISION = -1.0
"""What `_state` gives for a configuration that is not free."""
_QUEUE = 8192  # waiting sub-intervals of one edge; 20 rad at the finest step has 4096
_LONGEST_RAD = 40.0  # what that queue has room for
_LARGEST = 1e6
_FINEST_RAD = 0.01  # intervals shorter than this are not split again
MAX_PARTS = 50
"""Parts of one arm with what it holds; the kernels keep a bit for each."""
_LAST_BIT = 50  # groups beyond it share a bit


class Scratch(NamedTuple):
    """What the kernels write into: for an arm of n joints in m parts with k spheres."""

    frames: FloatArray
    """Link frames, shape (n+1, 3, 4)."""
    points: FloatArray
    """Centres of the spheres of parts that were placed, shape (k, 3)."""
    tops: FloatArray
    """Centres of the spheres around parts, shape (m, 3)."""
    turns: FloatArray
    """Cosines and sines of the joints, shape (2, n)."""
    total: FloatArray
    """How far a sphere of a part moves while joints f..n-1 make all of a motion, at most [m], shape (m, n+1)."""
    reach: FloatArray
    """The same for the interval that is tested, shape (m, n+1)."""
    q: FloatArray
    """The configuration that is tested, shape (n,)."""
    todo: IntArray
    """Parts and groups that are tested at all, a bit each, shape (2,)."""
    waiting: FloatArray
    """Beginning and end of intervals of an edge that wait, shape (`_QUEUE`, 2)."""
    waiting_todo: IntArray
    """What has to be tested in each, as in `todo`, shape (`_QUEUE`, 2)."""


class SceneArrays(NamedTuple):
    """An arm of n joints in m rigid parts, what it holds, and b obstacles."""

    joints: FloatArray
    """Joint transforms, shape (n, 3, 4)."""
    spheres: FloatArray
    """Centre and radius in the frame of the part [m], part by part, shape (k, 4)."""
    hulls: FloatArray
    """One sphere around each part, shape (m, 4)."""
    boxes: FloatArray
    """Of `rounded_boxes`, shape (b, 17)."""
    lever: FloatArray
    """Largest distance from each joint's axis to a part's spheres [m], shape (m, n)."""
    parts: RowArray
    """Frame, first and end sphere, first and end entry of `near`, shape (m, 5)."""
    near: RowArray
    """Rows of the boxes that each part can reach, part by part, shape (e,)."""
    groups: RowArray
    """Two parts tested against each other, the one with the lower frame first, first and end run, shape (g, 4)."""
    runs: RowArray
    """A sphere of the first part, and its first and end partner of the second, shape (r, 3)."""
    partners: RowArray
    """Spheres, shape (p,)."""
    margin: float
    """Distance kept from boxes [m]."""
    scratch: Scratch


def make_scene(
    *,
    joints: FloatArray,
    spheres: FloatArray,
    hulls: FloatArray,
    parts: IntArray,
    near_boxes: list[IntArray],
    groups: IntArray,
    runs: IntArray,
    partners: IntArray,
    boxes: FloatArray,
    lever: FloatArray,
    margin: float,
) -> SceneArrays:
    """Lay a scene out for the kernels; everything is copied, as they take on trust how it lies in memory.

    Args:
        joints: As in `SceneArrays`.
        spheres: As in `SceneArrays`.
        hulls: As in `SceneArrays`.
        parts: Frame, first and end sphere of each part, shape (m, 3).
        near_boxes: Rows of the boxes that each part can reach.
        groups: As in `SceneArrays`.
        runs: As in `SceneArrays`.
        partners: As in `SceneArrays`.
        boxes: As in `SceneArrays`.
        lever: As in `SceneArrays`.
        margin: As in `SceneArrays`.
    """
    n, k, m = len(joints), len(spheres), len(hulls)
    ends = np.cumsum([0] + [len(rows) for rows in near_boxes])
    return SceneArrays(
        joints=_numbers(joints),
        spheres=_numbers(spheres),
        hulls=_numbers(hulls),
        boxes=_numbers(boxes),
        lever=_numbers(lever),
        parts=_rows(np.column_stack([parts, ends[:-1], ends[1:]])),
        near=_rows(np.concatenate([np.empty(0, dtype=np.int64), *near_boxes])),
        groups=_rows(groups),
        runs=_rows(runs),
        partners=_rows(partners),
        margin=float(margin),
        scratch=Scratch(
            frames=np.zeros((n + 1, 3, 4)),
            points=np.zeros((k, 3)),
            tops=np.zeros((m, 3)),
            turns=np.zeros((2, n)),
            total=np.zeros((m, n + 1)),
            reach=np.zeros((m, n + 1)),
            q=np.zeros(n),
            todo=np.zeros(2, dtype=np.int64),
            waiting=np.zeros((_QUEUE, 2)),
            waiting_todo=np.zeros((_QUEUE, 2), dtype=np.int64),
        ),
    )


def _numbers(values: FloatArray) -> FloatArray:
    return np.array(values, dtype=np.float64, order="C")


def _rows(values: IntArray) -> RowArray:
    return np.array(values, dtype=np.uint64, order="C")


class Checks(NamedTuple):
    """Checks as Python calls them, of contiguous arrays of floats; see `entry_point`."""

    state_free: Callable[[FloatArray, SceneArrays], bool]
    edge_free: Callable[[FloatArray, FloatArray, SceneArrays], bool]


@cache
def checks_from_python() -> Checks:
    """Compile the checks for scenes, all of which have the same types."""
    numbers, rows = np.empty((0, 0)), np.empty((0, 0), dtype=np.int64)
    nothing = make_scene(
        joints=np.empty((0, 3, 4)),
        spheres=numbers,
        hulls=numbers,
        parts=np.empty((0, 3), dtype=np.int64),
        near_boxes=[],
        groups=rows,
        runs=rows,
        partners=np.empty(0, dtype=np.int64),
        boxes=numbers,
        lever=numbers,
        margin=0.0,
    )
    q = np.empty(0)
    return Checks(entry_point(state_free, q, nothing), entry_point(edge_free, q, q, nothing))


@borrowing
def _sines_into(q: FloatArray, turns: FloatArray) -> None:
    """Cosines and sines of all joints, without a branch, so that the compiler takes several joints at once.

    Quarter turns are taken off in two parts (Cody and Waite, Software Manual for the Elementary Functions, 1980); the
    Taylor series that is left has an error below 1e-15 on |x| <= pi / 4.
    """
    for i in range(q.shape[0]):
        quarter = np.floor(q[i] * 0.6366197723675814 + 0.5)
        x = (q[i] - quarter * 1.5707963267948966) - quarter * 6.123233995736766e-17
        z = x * x
        s = x * (1.0 + z * (-1.6666666666666666e-1 + z * (8.333333333333333e-3 + z * (-1.984126984126984e-4 + z * (2.7557319223985893e-6 + z * (-2.505210838544172e-8 + z * (1.6059043836821613e-10 - z * 7.647163731819816e-13)))))))  # noqa: E501  # fmt: skip
        c = 1.0 + z * (-0.5 + z * (4.1666666666666664e-2 + z * (-1.388888888888889e-3 + z * (2.48015873015873e-5 + z * (-2.755731922398589e-7 + z * (2.08767569878681e-9 + z * (-1.1470745597729725e-11 + z * 4.779477332387385e-14)))))))  # noqa: E501  # fmt: skip
        # sin(x + k pi/2): odd quarters swap sine and cosine, quarters 2 and 3 change the sign.
        half = 0.5 * quarter
        odd = 2.0 * (half - np.floor(half))
        sign = 1.0 - 2.0 * (np.floor(half) - 2.0 * np.floor(0.5 * np.floor(half)))
        turns[0, i] = sign * (c - odd * (c + s))
        turns[1, i] = sign * (s + odd * (c - s))


@borrowing
def _frames_into(joints: FloatArray, q: FloatArray, turns: FloatArray, frames: FloatArray) -> None:
    """Link frames as `kinematics.link_frames_into` has them, to the last digits."""
    _sines_into(q, turns)
    for a in range(3):
        for b in range(4):
            frames[0, a, b] = 1.0 if a == b else 0.0
    for i in range(q.shape[0]):
        c = turns[0, i]
        s = turns[1, i]
        for a in range(3):
            x, y, z = frames[i, a, 0], frames[i, a, 1], frames[i, a, 2]
            r0 = x * joints[i, 0, 0] + y * joints[i, 1, 0] + z * joints[i, 2, 0]
            r1 = x * joints[i, 0, 1] + y * joints[i, 1, 1] + z * joints[i, 2, 1]
            frames[i + 1, a, 0] = r0 * c + r1 * s
            frames[i + 1, a, 1] = r1 * c - r0 * s
            frames[i + 1, a, 2] = x * joints[i, 0, 2] + y * joints[i, 1, 2] + z * joints[i, 2, 2]
            frames[i + 1, a, 3] = frames[i, a, 3] + x * joints[i, 0, 3] + y * joints[i, 1, 3] + z * joints[i, 2, 3]


@inlined
def _put(frames: FloatArray, f: Int, spheres: FloatArray, s: Int, points: FloatArray, to: Int) -> None:
    x, y, z = spheres[s, 0], spheres[s, 1], spheres[s, 2]
    for a in range(3):
        points[to, a] = frames[f, a, 0] * x + frames[f, a, 1] * y + frames[f, a, 2] * z + frames[f, a, 3]


@borrowing
def _place(p: Int, frames: FloatArray, parts: RowArray, spheres: FloatArray, points: FloatArray) -> None:
    """Sphere centres of one part in the base frame."""
    for s in range(parts[p, 1], parts[p, 2]):
        _put(frames, parts[p, 0], spheres, s, points, s)


@inlined
def _box_gap(x: float, y: float, z: float, wide: float, boxes: FloatArray, b: Int) -> float:
    """Squared distance from a point to the core of a rounded box, zero inside; infinite if one axis shows > wide.

    The early ends also keep the compiler from gathering rows into vectors, which took seven times as long.
    """
    x -= boxes[b, 0]
    y -= boxes[b, 1]
    z -= boxes[b, 2]
    dz = abs(x * boxes[b, 12] + y * boxes[b, 13] + z * boxes[b, 14]) - boxes[b, 5]
    if dz >= wide:
        return np.inf
    dx = abs(x * boxes[b, 6] + y * boxes[b, 7] + z * boxes[b, 8]) - boxes[b, 3]
    if dx >= wide:
        return np.inf
    dy = abs(x * boxes[b, 9] + y * boxes[b, 10] + z * boxes[b, 11]) - boxes[b, 4]
    if dy >= wide:
        return np.inf
    dx = max(dx, 0.0)
    dy = max(dy, 0.0)
    dz = max(dz, 0.0)
    square: float = dx * dx + dy * dy + dz * dz
    return square


@borrowing
def _state(q: FloatArray, moving: bool, scene: SceneArrays) -> float:  # noqa: PLR0912, PLR0915 - one pass over parts and groups
    """COLLISION, or the share of the motion within `reach` that is free for sure; without `moving`, reach is zero.

    `scratch.reach` bounds how far a sphere of part p moves while joints f..n-1 make their allowed motion. Only when the
    sphere around a part is near does the test look at the part's own spheres. Of `scratch.todo`, those that are not
    clear for all of the motion stay set.
    """
    spheres, hulls, boxes, parts = scene.spheres, scene.hulls, scene.boxes, scene.parts
    near, groups, runs, partners = scene.near, scene.groups, scene.runs, scene.partners
    frames, points, tops = scene.scratch.frames, scene.scratch.points, scene.scratch.tops
    reach, todo, margin = scene.scratch.reach, scene.scratch.todo, scene.margin
    todo_parts = todo[0] if moving else -1
    todo_groups = todo[1] if moving else -1
    left_parts = 0
    left_groups = 0
    share = 1.0
    _frames_into(scene.joints, q, scene.scratch.turns, frames)
    placed = 0  # a bit per part
    for p in range(parts.shape[0] - 1, -1, -1):  # tip first: it hits most
        f = parts[p, 0]
        _put(frames, f, hulls, p, tops, p)
        if todo_parts & (1 << p) == 0:
            continue
        way = reach[p, 0] if moving else 0.0
        hull_wide = hulls[p, 3] + max(margin, way)
        top_x, top_y, top_z = tops[p, 0], tops[p, 1], tops[p, 2]
        for k in range(parts[p, 3], parts[p, 4]):
            b = near[k]
            wide = hull_wide + boxes[b, 15]
            x = top_x - boxes[b, 0]
            y = top_y - boxes[b, 1]
            z = top_z - boxes[b, 2]
            dz = abs(x * boxes[b, 12] + y * boxes[b, 13] + z * boxes[b, 14]) - boxes[b, 5]
            if dz >= wide:
                continue
            dx = abs(x * boxes[b, 6] + y * boxes[b, 7] + z * boxes[b, 8]) - boxes[b, 3]
            if dx >= wide:
                continue
            dy = abs(x * boxes[b, 9] + y * boxes[b, 10] + z * boxes[b, 11]) - boxes[b, 4]
            if dy >= wide:
                continue
            dx = max(dx, 0.0)
            dy = max(dy, 0.0)
            dz = max(dz, 0.0)
            if dx * dx + dy * dy + dz * dz >= wide * wide:
                continue
            if placed & (1 << p) == 0:
                _place(p, frames, parts, spheres, points)
                placed |= 1 << p
            for s in range(parts[p, 1], parts[p, 2]):
                r = spheres[s, 3] + boxes[b, 15]
                square = _box_gap(points[s, 0], points[s, 1], points[s, 2], r + max(margin, way), boxes, b)
                if square < (r + margin) * (r + margin):
                    return COLLISION
                if square < (r + way) * (r + way):
                    left_parts |= 1 << p
                    share = min(share, (np.sqrt(square) - r) / way)
    for g in range(groups.shape[0]):
        bit = 1 << min(g, _LAST_BIT)
        if todo_groups & bit == 0:
            continue
        i = int(groups[g, 0])
        j = int(groups[g, 1])
        way = reach[j, parts[i, 0]] if moving else 0.0
        wide = hulls[i, 3] + hulls[j, 3] + way
        x, y, z = tops[i, 0] - tops[j, 0], tops[i, 1] - tops[j, 1], tops[i, 2] - tops[j, 2]
        if x * x + y * y + z * z >= wide * wide:
            continue
        if placed & (1 << i) == 0:
            _place(i, frames, parts, spheres, points)
            placed |= 1 << i
        if placed & (1 << j) == 0:
            _place(j, frames, parts, spheres, points)
            placed |= 1 << j
        for k in range(groups[g, 2], groups[g, 3]):
            s = runs[k, 0]
            x, y, z = points[s, 0], points[s, 1], points[s, 2]
            size = spheres[s, 3]
            wide = size + hulls[j, 3] + way
            dx, dy, dz = x - tops[j, 0], y - tops[j, 1], z - tops[j, 2]
            square = dx * dx + dy * dy + dz * dz
            if square >= wide * wide:
                continue
            for h in range(runs[k, 1], runs[k, 2]):
                s = partners[h]
                r = size + spheres[s, 3]
                dx, dy, dz = x - points[s, 0], y - points[s, 1], z - points[s, 2]
                square = dx * dx + dy * dy + dz * dz
                if square < r * r:
                    return COLLISION
                if square < (r + way) * (r + way):
                    left_groups |= bit
                    share = min(share, (np.sqrt(square) - r) / way)
    todo[0] = left_parts
    todo[1] = left_groups
    return share


@inlined
def _usable(q: FloatArray) -> bool:
    """Whether all numbers are finite, and small enough for a sine: nothing touches a NaN, so it would count as free."""
    for i in range(q.shape[0]):  # noqa: SIM110 - compiled
        if not abs(q[i]) < _LARGEST:
            return False
    return True


@borrowing
def state_free(q: FloatArray, scene: SceneArrays) -> bool:
    """Whether one configuration is free, with the margin; one that is not finite is not."""
    if not _usable(q):
        return False
    state = _state(q, False, scene)
    return state != COLLISION


@borrowing
def states_free(q: FloatArray, out: BoolArray, scene: SceneArrays) -> None:
    """`state_free` for many configurations (m, n)."""
    for i in range(q.shape[0]):
        if not _usable(q[i]):
            out[i] = False
            continue
        state = _state(q[i], False, scene)
        out[i] = state != COLLISION


@borrowing
def edge_free(a: FloatArray, b: FloatArray, scene: SceneArrays) -> bool:
    """Whether the straight joint-space motion from a to b is free; a is taken as free, and edges beyond 40 rad are not.

    Breadth first: the middle of an interval is tested, motion bounds prove a part around it free, and the rest on both
    sides waits in a queue. What is clear for a whole interval is not tested again inside. `scene` is
    `CollisionChecker.scene`.
    """
    scratch = scene.scratch
    lever, total, reach, q = scene.lever, scratch.total, scratch.reach, scratch.q
    waiting, waiting_todo, todo = scratch.waiting, scratch.waiting_todo, scratch.todo
    n = q.shape[0]
    m = lever.shape[0]
    if not (_usable(a) and _usable(b)):
        return False
    if _state(b, False, scene) == COLLISION:
        return False
    length = 0.0
    for i in range(n):
        length += (b[i] - a[i]) ** 2
    length = np.sqrt(length)
    if length > _LONGEST_RAD:
        return False
    for p in range(m):
        bound = 0.0
        total[p, n] = 0.0
        for i in range(n - 1, -1, -1):
            bound += lever[p, i] * abs(b[i] - a[i])
            total[p, i] = bound
    waiting[0, 0] = 0.0
    waiting[0, 1] = 1.0
    waiting_todo[0, 0] = -1
    waiting_todo[0, 1] = -1
    head = 0
    tail = 1
    while head < tail:
        lo = waiting[head % _QUEUE, 0]
        hi = waiting[head % _QUEUE, 1]
        todo[0] = waiting_todo[head % _QUEUE, 0]
        todo[1] = waiting_todo[head % _QUEUE, 1]
        head += 1
        middle = 0.5 * (lo + hi)
        half = 0.5 * (hi - lo)
        for i in range(n):
            q[i] = a[i] + (b[i] - a[i]) * middle
        for p in range(m):
            for i in range(n + 1):
                reach[p, i] = half * total[p, i]
        share = _state(q, True, scene)
        if share == COLLISION:
            return False
        if share < 1.0 and 2.0 * half * length > _FINEST_RAD:
            for side in range(2):
                slot = tail % _QUEUE
                waiting[slot, 0] = middle + share * half if side else lo
                waiting[slot, 1] = hi if side else middle - share * half
                waiting_todo[slot, 0] = todo[0]
                waiting_todo[slot, 1] = todo[1]
                tail += 1
    return True


@borrowing
def path_free(path: FloatArray, scene: SceneArrays) -> bool:
    """Whether a piecewise straight path (m, n), m >= 1, is free, its first configuration included."""
    if not state_free(path[0], scene):
        return False
    for i in range(path.shape[0] - 1):  # noqa: SIM110 - compiled
        if not edge_free(path[i], path[i + 1], scene):
            return False
    return True


@borrowing
def _inside(q: FloatArray, lower: FloatArray, upper: FloatArray) -> bool:
    for i in range(q.shape[0]):  # noqa: SIM110 - compiled
        if not lower[i] <= q[i] <= upper[i]:
            return False
    return True


@borrowing
def straight_goal(
    start: FloatArray,
    goals: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    scene: SceneArrays,
    order: IntArray,
    distance: FloatArray,
) -> tuple[int, int]:
    """Check both ends of a query and try the straight lines, nearest goal first.

    Fills `order` (k,) with the rows of the goals that are inside the limits and free, nearest first, and `distance`
    (k,) with their joint-space distances. Returns their number (-1 if the start is not inside and free), and the row of
    the nearest goal that a free straight line leads to, or -1.
    """
    if not _inside(start, lower, upper) or not state_free(start, scene):
        return -1, -1
    n = 0
    for row in range(goals.shape[0]):
        if not _inside(goals[row], lower, upper) or not state_free(goals[row], scene):
            continue
        square = 0.0
        for i in range(start.shape[0]):
            square += (goals[row, i] - start[i]) ** 2
        at = n
        while at > 0 and distance[at - 1] > square:
            distance[at] = distance[at - 1]
            order[at] = order[at - 1]
            at -= 1
        distance[at] = square
        order[at] = row
        n += 1
    for k in range(n):
        distance[k] = np.sqrt(distance[k])
    for k in range(n):
        if edge_free(start, goals[order[k]], scene):
            return n, order[k]
    return n, -1


@borrowing
def spheres_at(q: FloatArray, scene: SceneArrays, out: FloatArray) -> None:
    """Sphere centres in the base frame (k, 3)."""
    frames = scene.scratch.frames
    _frames_into(scene.joints, q, scene.scratch.turns, frames)
    for p in range(scene.parts.shape[0]):
        _place(p, frames, scene.parts, scene.spheres, out)


@borrowing
def clearance(q: FloatArray, scene: SceneArrays) -> float:
    """Smallest distance from a sphere to an obstacle; negative when they overlap."""
    spheres, boxes, parts = scene.spheres, scene.boxes, scene.parts
    frames, points = scene.scratch.frames, scene.scratch.points
    _frames_into(scene.joints, q, scene.scratch.turns, frames)
    best = np.inf
    for p in range(parts.shape[0]):
        _place(p, frames, parts, spheres, points)
        for b in range(boxes.shape[0]):
            if parts[p, 0] < boxes[b, 16]:
                continue
            for s in range(parts[p, 1], parts[p, 2]):
                x = points[s, 0] - boxes[b, 0]
                y = points[s, 1] - boxes[b, 1]
                z = points[s, 2] - boxes[b, 2]
                dx = abs(x * boxes[b, 6] + y * boxes[b, 7] + z * boxes[b, 8]) - boxes[b, 3]
                dy = abs(x * boxes[b, 9] + y * boxes[b, 10] + z * boxes[b, 11]) - boxes[b, 4]
                dz = abs(x * boxes[b, 12] + y * boxes[b, 13] + z * boxes[b, 14]) - boxes[b, 5]
                outside = np.sqrt(max(dx, 0.0) ** 2 + max(dy, 0.0) ** 2 + max(dz, 0.0) ** 2)
                best = min(best, outside + min(0.0, max(dx, dy, dz)) - boxes[b, 15] - spheres[s, 3])
    return best
