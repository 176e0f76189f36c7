"""Kernels of collision checks: an arm's spheres against rounded boxes and against each other, at states and on edges.

A scene is one flat array, scratch memory included: a call from Python costs 0.2 us per argument, and these are asked
hundreds of thousands of times. `pack_scene` documents what it holds, `_open` gives the views.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.motion.collision.obstacles import ROW

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

COLLISION = -1.0
"""What `_state` gives for a configuration that is not free."""
_QUEUE = 8192  # waiting sub-intervals of one edge; 20 rad at the finest step has 4096
_LONGEST_RAD = 40.0  # what that queue has room for
_LARGEST = 1e6
_FINEST_RAD = 0.01  # intervals shorter than this are not split again
_HEADER = 10
_SPHERE = 4  # centre, radius
_PART = 5  # frame, first and end sphere, first and end box
MAX_PARTS = 50
"""Parts of one arm with what it holds; the kernels keep a bit for each, in what may be a float."""
_LAST_BIT = 50  # groups beyond it share a bit


def pack_scene(
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
) -> FloatArray:
    """Lay a scene out for the kernels.

    Args:
        joints: Joint transforms, shape (n, 3, 4).
        spheres: Centre and radius in the frame of the part [m], part by part, shape (k, 4).
        hulls: One sphere around each part, shape (m, 4).
        parts: Frame, first and end sphere of each part, shape (m, 3).
        near_boxes: Rows of the boxes that each part can reach.
        groups: Two parts tested against each other, the one with the lower frame first, and their first and end run,
            shape (g, 4).
        runs: A sphere of the first part, and its first and end partner of the second, shape (r, 3).
        partners: Spheres, shape (p,).
        boxes: Of `rounded_boxes`, shape (b, 17).
        lever: Largest distance from each joint's axis to a part's spheres [m], shape (m, n).
        margin: Distance kept from boxes [m].

    Returns:
        The scene, with room for scratch memory.
    """
    n, k, m, b = len(joints), len(spheres), len(hulls), len(boxes)
    ends = np.cumsum([0] + [len(rows) for rows in near_boxes])
    table = np.column_stack([parts, ends[:-1], ends[1:]])
    ints = [table, groups, runs, partners, *near_boxes]
    floats: list[npt.ArrayLike] = [[margin], joints, spheres, hulls, boxes, lever]
    whole = np.concatenate([np.ravel(a) for a in ints]).astype(np.uint64)
    real = np.concatenate([np.ravel(a) for a in floats]).astype(np.float64)
    header = np.array([n, k, m, b, len(groups), len(runs), len(partners), len(whole), len(real), 0], dtype=np.uint64)
    scratch = np.zeros(14 * n + 12 + 3 * (k + m) + 2 * m * (n + 1) + n + 2 + 4 * _QUEUE)
    return np.concatenate([header.view(np.float64), whole.view(np.float64), real, scratch])


@njit(cache=True, inline="always")
def _open(scene):  # type: ignore[no-untyped-def]
    """Views: joints, spheres, hulls, boxes, lever, parts, groups, runs, partners, near (unsigned: no wrapped index)."""
    header = scene[:_HEADER].view(np.int64)
    n, k, m, b, g, r, p = header[0], header[1], header[2], header[3], header[4], header[5], header[6]
    ints = scene[_HEADER : _HEADER + header[7]].view(np.uint64)
    parts = ints[: _PART * m].reshape((m, _PART))
    at = _PART * m
    groups = ints[at : at + 4 * g].reshape((g, 4))
    at += 4 * g
    runs = ints[at : at + 3 * r].reshape((r, 3))
    at += 3 * r
    partners = ints[at : at + p]
    near = ints[at + p :]
    at = _HEADER + header[7] + 1  # behind the margin
    joints = scene[at : at + 12 * n].reshape((n, 3, 4))
    at += 12 * n
    spheres = scene[at : at + _SPHERE * k].reshape((k, _SPHERE))
    at += _SPHERE * k
    hulls = scene[at : at + _SPHERE * m].reshape((m, _SPHERE))
    at += _SPHERE * m
    boxes = scene[at : at + ROW * b].reshape((b, ROW))
    at += ROW * b
    lever = scene[at : at + m * n].reshape((m, n))
    return joints, spheres, hulls, boxes, lever, parts, groups, runs, partners, near


@njit(cache=True, inline="always")
def _margin(scene):  # type: ignore[no-untyped-def]
    return scene[_HEADER + scene[7:8].view(np.int64)[0]]


@njit(cache=True, inline="always")
def _open_scratch(scene):  # type: ignore[no-untyped-def]
    """Views: frames, points, tops, turns, reach, total, q, queue (from, to, parts, groups), todo."""
    header = scene[:_HEADER].view(np.int64)
    n, k, m = header[0], header[1], header[2]
    at = _HEADER + header[7] + header[8]
    frames = scene[at : at + 12 * (n + 1)].reshape((n + 1, 3, 4))
    at += 12 * (n + 1)
    points = scene[at : at + 3 * k].reshape((k, 3))
    at += 3 * k
    tops = scene[at : at + 3 * m].reshape((m, 3))
    at += 3 * m
    turns = scene[at : at + 2 * n].reshape((2, n))
    at += 2 * n
    reach = scene[at : at + m * (n + 1)].reshape((m, n + 1))
    at += m * (n + 1)
    total = scene[at : at + m * (n + 1)].reshape((m, n + 1))
    at += m * (n + 1)
    q = scene[at : at + n]
    at += n
    todo = scene[at : at + 2].view(np.int64)
    at += 2
    queue = scene[at : at + 4 * _QUEUE].reshape((_QUEUE, 4))
    return frames, points, tops, turns, reach, total, q, queue, todo


@njit(cache=True)
def _sines_into(q, turns):  # type: ignore[no-untyped-def]
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


@njit(cache=True)
def _frames_into(joints, q, turns, frames):  # type: ignore[no-untyped-def]
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


@njit(cache=True, inline="always")
def _put(frames, f, spheres, s, points, to):  # type: ignore[no-untyped-def]
    x, y, z = spheres[s, 0], spheres[s, 1], spheres[s, 2]
    for a in range(3):
        points[to, a] = frames[f, a, 0] * x + frames[f, a, 1] * y + frames[f, a, 2] * z + frames[f, a, 3]


@njit(cache=True)
def _place(p, frames, parts, spheres, points):  # type: ignore[no-untyped-def]
    """Sphere centres of one part in the base frame."""
    for s in range(parts[p, 1], parts[p, 2]):
        _put(frames, parts[p, 0], spheres, s, points, s)


@njit(cache=True, inline="always")
def _box_gap(x, y, z, wide, boxes, b):  # type: ignore[no-untyped-def]
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
    return dx * dx + dy * dy + dz * dz


@njit(cache=True)
def _state(  # type: ignore[no-untyped-def]  # noqa: PLR0912 - one pass over parts and groups
    q,
    moving,
    margin,
    joints,
    spheres,
    hulls,
    boxes,
    parts,
    groups,
    runs,
    partners,
    near,
    frames,
    points,
    tops,
    turns,
    reach,
    todo,
):
    """COLLISION, or the share of the motion within `reach` that is free for sure; without `moving`, reach is zero.

    `reach` (m, n+1): bound on how far a sphere of part p moves while joints f..n-1 make their allowed motion. Only when
    the sphere around a part is near does the test look at the part's own spheres. `todo` (2,): parts and groups that
    are tested at all, a bit each; those that are not clear for all of the motion stay set.
    """
    todo_parts = todo[0] if moving else -1
    todo_groups = todo[1] if moving else -1
    left_parts = 0
    left_groups = 0
    share = 1.0
    _frames_into(joints, q, turns, frames)
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


@njit(cache=True, inline="always")
def _usable(q):  # type: ignore[no-untyped-def]
    """Whether all numbers are finite, and small enough for a sine: nothing touches a NaN, so it would count as free."""
    for i in range(q.shape[0]):  # noqa: SIM110 - compiled
        if not abs(q[i]) < _LARGEST:
            return False
    return True


@njit(cache=True)
def state_free(q, scene):  # type: ignore[no-untyped-def]
    """Whether one configuration is free, with the margin; one that is not finite is not."""
    if not _usable(q):
        return False
    joints, spheres, hulls, boxes, _, parts, groups, runs, partners, near = _open(scene)
    frames, points, tops, turns, reach, _, _, _, todo = _open_scratch(scene)
    state = _state(q, False, _margin(scene), joints, spheres, hulls, boxes, parts, groups, runs, partners, near, frames, points, tops, turns, reach, todo)  # noqa: E501  # fmt: skip
    return state != COLLISION


@njit(cache=True)
def states_free(q, out, scene):  # type: ignore[no-untyped-def]
    """`state_free` for many configurations (m, n)."""
    joints, spheres, hulls, boxes, _, parts, groups, runs, partners, near = _open(scene)
    frames, points, tops, turns, reach, _, _, _, todo = _open_scratch(scene)
    for i in range(q.shape[0]):
        if not _usable(q[i]):
            out[i] = False
            continue
        state = _state(q[i], False, _margin(scene), joints, spheres, hulls, boxes, parts, groups, runs, partners, near, frames, points, tops, turns, reach, todo)  # noqa: E501  # fmt: skip
        out[i] = state != COLLISION


@njit(cache=True)
def edge_free(a, b, scene):  # type: ignore[no-untyped-def]
    """Whether the straight joint-space motion from a to b is free; a is taken as free, and edges beyond 40 rad are not.

    Breadth first: the middle of an interval is tested, motion bounds prove a part around it free, and the rest on both
    sides waits in a queue. What is clear for a whole interval is not tested again inside. `scene` is
    `CollisionChecker.scene`.
    """
    joints, spheres, hulls, boxes, lever, parts, groups, runs, partners, near = _open(scene)
    frames, points, tops, turns, reach, total, q, queue, todo = _open_scratch(scene)
    margin = _margin(scene)
    n = q.shape[0]
    if not (_usable(a) and _usable(b)):
        return False
    if _state(b, False, margin, joints, spheres, hulls, boxes, parts, groups, runs, partners, near, frames, points, tops, turns, reach, todo) == COLLISION:  # noqa: E501  # fmt: skip
        return False
    length = 0.0
    for i in range(n):
        length += (b[i] - a[i]) ** 2
    length = np.sqrt(length)
    if length > _LONGEST_RAD:
        return False
    for p in range(parts.shape[0]):
        bound = 0.0
        total[p, n] = 0.0
        for i in range(n - 1, -1, -1):
            bound += lever[p, i] * abs(b[i] - a[i])
            total[p, i] = bound
    queue[0, 0] = 0.0
    queue[0, 1] = 1.0
    queue[0, 2] = -1.0
    queue[0, 3] = -1.0
    head = 0
    tail = 1
    while head < tail:
        lo = queue[head % _QUEUE, 0]
        hi = queue[head % _QUEUE, 1]
        todo[0] = int(queue[head % _QUEUE, 2])
        todo[1] = int(queue[head % _QUEUE, 3])
        head += 1
        middle = 0.5 * (lo + hi)
        half = 0.5 * (hi - lo)
        for i in range(n):
            q[i] = a[i] + (b[i] - a[i]) * middle
        for p in range(parts.shape[0]):
            for i in range(n + 1):
                reach[p, i] = half * total[p, i]
        share = _state(q, True, margin, joints, spheres, hulls, boxes, parts, groups, runs, partners, near, frames, points, tops, turns, reach, todo)  # noqa: E501  # fmt: skip
        if share == COLLISION:
            return False
        if share < 1.0 and 2.0 * half * length > _FINEST_RAD:
            for side in range(2):
                slot = tail % _QUEUE
                queue[slot, 0] = middle + share * half if side else lo
                queue[slot, 1] = hi if side else middle - share * half
                queue[slot, 2] = todo[0]
                queue[slot, 3] = todo[1]
                tail += 1
    return True


@njit(cache=True)
def path_free(path, scene):  # type: ignore[no-untyped-def]
    """Whether a piecewise straight path (m, n), m >= 1, is free, its first configuration included."""
    if not state_free(path[0], scene):
        return False
    for i in range(path.shape[0] - 1):  # noqa: SIM110 - compiled
        if not edge_free(path[i], path[i + 1], scene):
            return False
    return True


@njit(cache=True)
def _inside(q, lower, upper):  # type: ignore[no-untyped-def]
    for i in range(q.shape[0]):  # noqa: SIM110 - compiled
        if not lower[i] <= q[i] <= upper[i]:
            return False
    return True


@njit(cache=True)
def straight_goal(start, goals, lower, upper, scene, order, distance):  # type: ignore[no-untyped-def]
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


@njit(cache=True)
def spheres_at(q, scene, out):  # type: ignore[no-untyped-def]
    """Sphere centres in the base frame (k, 3)."""
    joints, spheres, _, _, _, parts, _, _, _, _ = _open(scene)
    frames, _, _, turns, _, _, _, _, _ = _open_scratch(scene)
    _frames_into(joints, q, turns, frames)
    for p in range(parts.shape[0]):
        _place(p, frames, parts, spheres, out)


@njit(cache=True)
def clearance(q, scene):  # type: ignore[no-untyped-def]
    """Smallest distance from a sphere to an obstacle; negative when they overlap."""
    joints, spheres, _, boxes, _, parts, _, _, _, _ = _open(scene)
    frames, points, _, turns, _, _, _, _, _ = _open_scratch(scene)
    _frames_into(joints, q, turns, frames)
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
