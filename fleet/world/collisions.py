"""Collisions: bodies of cars that overlap each other or a box are set apart and lose the speed into it.

A stand-in for contact where there is no physics. Bodies are rectangles in the plane, boxes are their footprints.
Two cars each give way by half, along the axis on which they overlap least (separating axes); beside a box the car
alone gives way. What is left is an overlap of `SLOP_M`, so that bodies which press on each other count as
touching. A car that drives into a body keeps of its speed only the part along that body's side, less Coulomb's
friction; one that drives away is free to, so nothing stays stuck that could drive off. If asked, friction also holds
the nose of a car that it brings to a stand: the car neither slides nor turns there.

Source: C. Ericson, "Real-Time Collision Detection", 2005, section 4.4.1 (separating axes); slop and corrected positions
as in E. Catto, "Iterative Dynamics with Temporal Coherence", GDC 2005.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.world.touches import BIN_M, BinnedBoxes, Body

SLOP_M = 0.001
"""Overlap that stays [m]."""
FRICTION = 0.5
"""Of bodies on each other: speed lost along a side, as a share of that lost into it."""
NOT_HELD: FloatArray = np.empty((0, 3))
"""Poses before a tick in which friction holds no nose."""
N_PASSES = 2
"""Passes over all pairs in a tick: one car may be pushed into the next."""
SHOVE_GAP_M = 0.02
"""What is left free when a car is pushed up to something: it has to get away without scraping along it [m]."""
N_SHOVES = 40
"""Steps in which a car is pushed: it stops before the one that would end in something."""


@njit(cache=True)
def set_apart(
    poses: FloatArray, speeds: FloatArray, bodies: Body, boxes: BinnedBoxes, before: FloatArray
) -> None:  # pragma: no cover - compiled
    """Set cars apart, in place, and slow down those that drive into something.

    Args:
        poses: Of the rear axles, x, y, yaw, shape (n, 3).
        speeds: Along the cars' headings [m/s], shape (n,).
        bodies: What cars look like.
        boxes: What stands on the floor.
        before: Poses at the beginning of the tick, for noses to be held, shape (n, 3); shape (0, 3) for none to be.
    """
    shift, length, width, _, circles, _ = bodies
    for _ in range(N_PASSES):
        for i in range(len(poses)):
            xi, yi, ci, si = _frame(poses, i, shift[i])
            for j in range(i + 1, len(poses)):
                near = circles[i] + circles[j]
                # Rear axles are further apart than middles by both shifts at most.
                if abs(poses[i, 0] - poses[j, 0]) > near + abs(shift[i]) + abs(shift[j]):
                    continue
                xj, yj, cj, sj = _frame(poses, j, shift[j])
                if (xi - xj) ** 2 + (yi - yj) ** 2 > near * near:
                    continue
                depth, nx, ny = _overlap((xi - xj, yi - yj, ci, si, cj, sj), length[i], width[i], length[j], width[j])
                if depth <= 0.0:
                    continue
                way = max(depth - SLOP_M, 0.0) / 2.0
                poses[i, 0] += way * nx
                poses[i, 1] += way * ny
                poses[j, 0] -= way * nx
                poses[j, 1] -= way * ny
                xi, yi = xi + way * nx, yi + way * ny
                _slow_down(poses, speeds, j, -cj * nx - sj * ny, (nx, ny), before)
                if _slow_down(poses, speeds, i, ci * nx + si * ny, (nx, ny), before):
                    xi, yi, ci, si = _frame(poses, i, shift[i])
        for i in range(len(poses)):
            _leave_boxes(poses, speeds, i, bodies, boxes, before)


@njit(cache=True)
def shove(
    poses: FloatArray, car: int, way: FloatArray, bodies: Body, boxes: FloatArray
) -> None:  # pragma: no cover - compiled
    """Push one car aside, in place, until it has come that far or something is in the way.

    Args:
        poses: Of the rear axles, x, y, yaw, shape (n, 3).
        car: Which one.
        way: How far along x and y, and about z, shape (3,) [m, m, rad].
        bodies: What cars look like.
        boxes: What stands on the floor, feet of arms included: middles x, y and half sizes, shape (k, 4).
    """
    bearable = max(_deepest(poses, car, bodies, boxes), -SHOVE_GAP_M)
    for _ in range(N_SHOVES):
        for axis in range(3):
            poses[car, axis] += way[axis] / N_SHOVES
        if _deepest(poses, car, bodies, boxes) > bearable:
            for axis in range(3):
                poses[car, axis] -= way[axis] / N_SHOVES
            return


@njit(cache=True)
def _deepest(poses: FloatArray, car: int, bodies: Body, boxes: FloatArray) -> float:  # pragma: no cover - compiled
    """How deep a car is in other cars or boxes, at most; negative if it touches nothing [m]."""
    shift, lengths, widths, _, _, _ = bodies
    length, width = lengths[car], widths[car]
    x, y, cos, sin = _frame(poses, car, shift[car])
    deepest = -math.inf
    for other in range(len(poses)):
        if other != car:
            ox, oy, oc, os = _frame(poses, other, shift[other])
            places = (x - ox, y - oy, cos, sin, oc, os)
            deepest = max(deepest, _overlap(places, length, width, lengths[other], widths[other])[0])
    for b in range(len(boxes)):
        places = (x - boxes[b, 0], y - boxes[b, 1], cos, sin, 1.0, 0.0)
        deepest = max(deepest, _overlap(places, length, width, boxes[b, 2], boxes[b, 3])[0])
    return deepest


@njit(cache=True)
def _frame(poses: FloatArray, car: int, shift: float) -> tuple[float, float, float, float]:  # pragma: no cover
    """Middle x, y of a car's body, and cos and sin of its yaw."""
    cos, sin = math.cos(poses[car, 2]), math.sin(poses[car, 2])
    return poses[car, 0] + shift * cos, poses[car, 1] + shift * sin, cos, sin


@njit(cache=True)
def _along(speed: float, into: float) -> float:  # pragma: no cover - compiled
    """Speed that is left beside a body; `into` is the cosine between the heading and the way out of it."""
    if speed * into >= 0.0:
        return speed
    beside = math.sqrt(max(1.0 - into * into, 0.0))
    return speed * beside * max(beside - FRICTION * abs(into), 0.0)


@njit(cache=True)
def _slow_down(
    poses: FloatArray, speeds: FloatArray, car: int, into: float, out: tuple[float, float], before: FloatArray
) -> bool:  # pragma: no cover - compiled
    """Take a car's speed into a body, and put it back to where friction holds its nose; returns whether that does.

    Args:
        into: Cosine between the car's heading and the way out of the body.
        out: The way out of the body, x, y.
        before: See `set_apart`.
    """
    speed = _along(speeds[car], into)
    is_held = len(before) > 0 and speed == 0.0 and speeds[car] != 0.0
    if is_held:
        x, y = poses[car, 0] - before[car, 0], poses[car, 1] - before[car, 1]
        nearer = x * out[0] + y * out[1]
        poses[car, 0], poses[car, 1] = before[car, 0] + nearer * out[0], before[car, 1] + nearer * out[1]
        poses[car, 2] = before[car, 2]
    speeds[car] = speed
    return is_held


@njit(cache=True)
def _overlap(
    places: tuple[float, float, float, float, float, float], al: float, aw: float, bl: float, bw: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Least overlap of two rectangles and the way out of it for the first; negative if an axis parts them.

    Args:
        places: Middle of the first as seen from that of the second, x, y, and cos and sin of both yaws.
        al: Half length of the first; aw its half width, bl and bw those of the second.
    """
    dx, dy, ca, sa, cb, sb = places
    depth, nx, ny = math.inf, 0.0, 0.0
    for axis in range(4):
        ux, uy = (ca, sa) if axis == 0 else (-sa, ca) if axis == 1 else (cb, sb) if axis == 2 else (-sb, cb)
        gap = ux * dx + uy * dy
        reach = (
            al * abs(ux * ca + uy * sa)
            + aw * abs(uy * ca - ux * sa)
            + bl * abs(ux * cb + uy * sb)
            + bw * abs(uy * cb - ux * sb)
        )
        if reach - abs(gap) < depth:
            depth = reach - abs(gap)
            sign = 1.0 if gap >= 0.0 else -1.0
            nx, ny = sign * ux, sign * uy
    return depth, nx, ny


@njit(cache=True)
def _leave_boxes(
    poses: FloatArray, speeds: FloatArray, car: int, bodies: Body, bins: BinnedBoxes, before: FloatArray
) -> None:  # pragma: no cover - compiled
    """Push one car out of the boxes in its bins."""
    boxes, _, bin_ptr, bin_box, n_x, n_y = bins
    length, width, circle = bodies.length[car], bodies.width[car], bodies.circle[car]
    x, y, cos, sin = _frame(poses, car, bodies.shift[car])
    x0, x1 = max(int((x - circle) / BIN_M), 0), min(int((x + circle) / BIN_M), n_x - 1)
    y0, y1 = max(int((y - circle) / BIN_M), 0), min(int((y + circle) / BIN_M), n_y - 1)
    for iy in range(y0, y1 + 1):
        for ix in range(x0, x1 + 1):
            for entry in range(bin_ptr[iy * n_x + ix], bin_ptr[iy * n_x + ix + 1]):
                b = bin_box[entry]
                dx, dy = x - boxes[b, 0], y - boxes[b, 1]
                if abs(dx) > circle + boxes[b, 2] or abs(dy) > circle + boxes[b, 3]:
                    continue
                depth, nx, ny = _overlap((dx, dy, cos, sin, 1.0, 0.0), length, width, boxes[b, 2], boxes[b, 3])
                if depth <= 0.0:
                    continue
                way = max(depth - SLOP_M, 0.0)
                poses[car, 0] += way * nx
                poses[car, 1] += way * ny
                x, y = x + way * nx, y + way * ny
                if _slow_down(poses, speeds, car, cos * nx + sin * ny, (nx, ny), before):
                    x, y, cos, sin = _frame(poses, car, bodies.shift[car])
