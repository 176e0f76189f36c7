"""Convex hulls of an arm's rigid parts, and whether two of them keep apart during a step.

Two convex bodies keep their distance if some direction separates them by it. A direction that does so both at the
beginning and at the end of a step does so all along, as far as their points go straight in between: the corner that is
farthest along it is never farther than where the farthest corners of beginning and end lie on a straight line. So one
direction proves a step without covering it, and the best of them points from the origin to the nearest point of the
differences of both bodies' corners, taken at both ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from planners.errors import PlanningError
from planners.motion.arrays import FloatArray, Int, IntArray
from planners.motion.kernel import borrowing, inlined, inner_borrowing

_MOST_TURNS = 16  # new directions for one pair of bodies: what is not settled by then counts as too near
_FLAT = 1e-12  # corners whose volume is that small against their size are no simplex
SCRATCH = 11, 4
"""Shape of what `step_apart` writes into."""


class Hulls(NamedTuple):
    """Corners of convex bodies, and which of them are neighbours."""

    corner: FloatArray
    """In the frame of the body [m], shape (v, 3)."""
    ring: IntArray
    """First entry of each corner in `neighbour`, and the end, shape (v+1,)."""
    neighbour: IntArray
    """Corners beside each other, shape (e,)."""
    first: IntArray
    """Some corner of each body, -1 for none: such a body is known by its spheres only, shape (m,)."""


def convex_hulls(bodies: Sequence[npt.ArrayLike]) -> Hulls:
    """Find the hulls of bodies.

    Args:
        bodies: Points of each [m], shape (k, 3); without points there is no hull.

    Raises:
        PlanningError: A body's points have no volume.
    """
    corners, rings, neighbours, first = [np.empty((0, 3))], [np.zeros(1, dtype=np.int64)], [], []
    count = edges = 0
    for body, given in enumerate(bodies):
        points = np.reshape(np.asarray(given, dtype=np.float64), (-1, 3))
        first.append(count if len(points) else -1)
        if len(points) == 0:
            continue
        try:
            hull = ConvexHull(points)
        except QhullError as error:
            raise PlanningError(f"convex_hulls: body {body} has no volume") from error
        number = np.full(len(points), -1)
        number[hull.vertices] = np.arange(len(hull.vertices))
        sides = number[hull.simplices][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        both = np.unique(np.concatenate([sides, sides[:, ::-1]]), axis=0)  # by the first corner
        corners.append(points[hull.vertices])
        rings.append(edges + np.searchsorted(both[:, 0], np.arange(1, len(hull.vertices) + 1)))
        neighbours.append(count + both[:, 1])
        count += len(hull.vertices)
        edges += len(both)
    return Hulls(
        corner=np.concatenate(corners),
        ring=np.concatenate(rings),
        neighbour=np.concatenate([np.empty(0, dtype=np.int64), *neighbours]),
        first=np.array(first, dtype=np.int64),
    )


class Bodies(NamedTuple):
    """What an arm is made of, for kernels: hulls, and spheres where there are none, which have one corner each."""

    hulls: Hulls
    frame: IntArray
    """Link frame of each body, shape (b,)."""
    radius: FloatArray
    """By how much each is rounded [m], shape (b,): 0 for hulls."""
    ball: FloatArray
    """Centre and radius of a sphere around each, in its frame [m], shape (b, 4)."""


def bodies_of(hulls: Hulls | None, spheres: FloatArray, part: IntArray, frame: IntArray) -> Bodies:
    """Take the hull of each rigid part that has one, and the spheres of the others.

    Args:
        hulls: Of the parts 0, 1, ...; None for none.
        spheres: Centre and radius in the frames of their parts [m], shape (s, 4).
        part: Of each sphere, shape (s,).
        frame: Link frame of each sphere, shape (s,).
    """
    known = convex_hulls([]) if hulls is None else hulls
    solid_parts = np.flatnonzero(known.first >= 0)
    rounded = ~np.isin(part, solid_parts)
    rows, solid = np.unique(part[~rounded], return_index=True)
    count = len(known.corner)
    ends = np.append(known.first[solid_parts], count)
    balls = []
    for row in rows:
        begin = known.first[row]
        own = known.corner[begin : ends[ends > begin].min()]
        middle = 0.5 * (own.min(axis=0) + own.max(axis=0))
        balls.append([*middle, np.linalg.norm(own - middle, axis=1).max()])
    n = int(rounded.sum())
    return Bodies(
        hulls=Hulls(
            corner=np.concatenate([known.corner, spheres[rounded, :3]]),
            ring=np.concatenate([known.ring, np.full(n, known.ring[-1])]),
            neighbour=known.neighbour,
            first=np.concatenate([known.first[rows], count + np.arange(n)]),
        ),
        frame=np.concatenate([frame[~rounded][solid], frame[rounded]]),
        radius=np.concatenate([np.zeros(len(rows)), spheres[rounded, 3]]),
        ball=np.concatenate([np.reshape(balls, (-1, 4)), spheres[rounded]]),
    )


@inlined
def _farthest(hulls: Hulls, at: Int, frame: FloatArray, x: float, y: float, z: float) -> tuple[Int, float]:
    """The corner farthest along a direction of the world, climbing from corner `at`, and how far that is."""
    u = frame[0, 0] * x + frame[1, 0] * y + frame[2, 0] * z
    v = frame[0, 1] * x + frame[1, 1] * y + frame[2, 1] * z
    w = frame[0, 2] * x + frame[1, 2] * y + frame[2, 2] * z
    corner = hulls.corner
    most = corner[at, 0] * u + corner[at, 1] * v + corner[at, 2] * w
    here: Int = -1
    while here != at:
        here = at
        for k in range(hulls.ring[here], hulls.ring[here + 1]):
            c = hulls.neighbour[k]
            far = corner[c, 0] * u + corner[c, 1] * v + corner[c, 2] * w
            if far > most:
                most = far
                at = c
    return at, most + frame[0, 3] * x + frame[1, 3] * y + frame[2, 3] * z


class ArmStep(NamedTuple):
    """One body during a step."""

    hulls: Hulls
    body: Int
    """Row of a body that has corners."""
    begin: FloatArray
    """Its frame in the world at the beginning, shape (3, 4)."""
    end: FloatArray
    """The same at the end."""


@borrowing
def step_apart(
    one: ArmStep, other: ArmStep, distance: float, way: FloatArray, at: IntArray, scratch: FloatArray
) -> bool:
    """Whether one direction keeps two bodies apart at both ends of a step.

    Args:
        one: One body.
        other: The other.
        distance: To be kept [m], > 0.
        way: A direction to try first, of any length > 0, from one to the other; filled with the last tried.
        at: Corners to climb from, of one and of the other, shape (2,); filled with the last met. -1 if neither they nor
            `way` are known.
        scratch: Is overwritten, shape `SCRATCH`.

    Source: Gilbert, Johnson and Keerthi, A fast procedure for computing the distance between complex objects in
        three-dimensional space, IEEE J. Robotics and Automation 1988; the nearest point of a simplex as in Wolfe,
        Finding the nearest point in a polytope, Mathematical Programming 1976.
    """
    mine, begin, end = one.hulls, one.begin, one.end
    others, their_begin, their_end = other.hulls, other.begin, other.end
    if at[0] < 0:
        at[0] = mine.first[one.body]
        at[1] = others.first[other.body]
        _difference(mine, at[0], begin, others, at[1], their_begin, way)
    simplex, share, nearest = scratch[:4], scratch[4], scratch[5]
    count = 0
    for _ in range(_MOST_TURNS):
        length = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
        x, y, z = way[0] / length, way[1] / length, way[2] / length
        a, high = _farthest(mine, at[0], begin, x, y, z)
        b, low = _farthest(others, at[1], their_begin, -x, -y, -z)
        at[0], far = _farthest(mine, a, end, x, y, z)
        at[1], near = _farthest(others, b, their_end, -x, -y, -z)
        if min(-low - high, -near - far) >= distance:
            return True
        if count == 4:
            return False
        if -near - far <= -low - high:
            _difference(mine, at[0], end, others, at[1], their_end, simplex[count])
        else:
            _difference(mine, a, begin, others, b, their_begin, simplex[count])
        share[count] = 1.0 if count == 0 else 0.0
        count = _nearest(simplex, share, count + 1, nearest, scratch[6:10], scratch[10])
        if count == 0 or nearest[0] ** 2 + nearest[1] ** 2 + nearest[2] ** 2 < distance * distance:
            return False
        _copy(nearest, way)
    return False


@inlined
def _copy(point: FloatArray, out: FloatArray) -> None:
    for a in range(3):
        out[a] = point[a]


@inlined
def _difference(
    one: Hulls, a: Int, frame: FloatArray, other: Hulls, b: Int, theirs: FloatArray, out: FloatArray
) -> None:
    """From a corner of one to a corner of the other, in the world."""
    for k in range(3):
        out[k] = theirs[k, 3] - frame[k, 3]
        for c in range(3):
            out[k] += theirs[k, c] * other.corner[b, c] - frame[k, c] * one.corner[a, c]


@inner_borrowing
def _nearest(
    simplex: FloatArray, share: FloatArray, count: int, out: FloatArray, matrix: FloatArray, weight: FloatArray
) -> int:
    """Point of a simplex nearest to the origin; only the corners it needs are kept, whose number is returned.

    `share` (4,) are weights of a point of the simplex, replaced by those of the nearest; 0 if the corners are flat.
    `matrix` (4, 4) and `weight` (4,) are overwritten.
    """
    while True:
        # Nearest point of all of the space through the corners: (1 + corner . corner') weight = 1, up to scale.
        scale = 0.0
        for i in range(count):
            scale = max(scale, simplex[i, 0] ** 2 + simplex[i, 1] ** 2 + simplex[i, 2] ** 2)
        for i in range(count):
            weight[i] = 1.0
            for j in range(i + 1):
                matrix[i, j] = scale
                for a in range(3):
                    matrix[i, j] += simplex[i, a] * simplex[j, a]
        for i in range(count):  # by Cholesky's factors
            for j in range(i + 1):
                for k in range(j):
                    matrix[i, j] -= matrix[i, k] * matrix[j, k]
                if j < i:
                    matrix[i, j] /= matrix[j, j]
            if not matrix[i, i] > _FLAT * scale:
                return 0
            matrix[i, i] = np.sqrt(matrix[i, i])
            for k in range(i):
                weight[i] -= matrix[i, k] * weight[k]
            weight[i] /= matrix[i, i]
        total = 0.0
        for i in range(count - 1, -1, -1):
            for k in range(i + 1, count):
                weight[i] -= matrix[k, i] * weight[k]
            weight[i] /= matrix[i, i]
            total += weight[i]
        part = 1.0
        for i in range(count):
            weight[i] /= total
            if weight[i] <= 0.0 and share[i] > weight[i]:
                part = min(part, share[i] / (share[i] - weight[i]))
        kept = 0
        for i in range(count):
            share[kept] = share[i] + part * (weight[i] - share[i])
            if weight[i] > 0.0 or share[kept] > 1e-12:
                _copy(simplex[i], simplex[kept])
                kept += 1
        if kept == count:
            break
        count = kept
    for a in range(3):
        out[a] = 0.0
        for i in range(count):
            out[a] += share[i] * simplex[i, a]
    return count
