"""Reeds-Shepp: the shortest way of a car between two poses on an empty floor, for turning radius 1.

A word is a sequence of arcs and straight lines. Eight base words, mirrored, driven backwards and read from their end,
are all that can be shortest.

Source: J. A. Reeds and L. A. Shepp, "Optimal paths for a car that goes both forwards and backwards", Pacific Journal
of Mathematics 145(2), 1990, section 8; in 8.3 and 8.4 with the sign of u, in 8.7 and 8.8 with the quadrant of t, that
make the end pose come out right.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from planners.open_floor.arrays import FloatArray
from planners.open_floor.kernels.kernel import kernel

MOST_SEGMENTS = 5
"""Arcs and lines of a word."""
_N_WORDS = 8
_HALF_PI = 0.5 * math.pi
_EPS = 1e-9
"""A length that is negative only by rounding counts as 0."""
TABLE_RADII = 7.0
"""Up to so far away, along each axis, lengths are tabulated [turning radii]."""
_PER_RADIUS, _HEADINGS = 4, 32
"""Entries of the table for each turning radius and for each full turn."""


@kernel
def wrapped(angle: float) -> float:
    """An angle in (-pi, pi]."""
    angle = angle % (2.0 * math.pi)
    return angle - 2.0 * math.pi if angle > math.pi else angle


@functools.cache
def length_table() -> FloatArray:
    """Shortest lengths to poses ahead on the left; the others are mirror images, shape (n, n, headings)."""
    n = int(TABLE_RADII * _PER_RADIUS) + 1
    table = np.empty((n, n, _HEADINGS))
    _fill(table)
    table.setflags(write=False)
    return table


@kernel
def tabulated_length(table: FloatArray, x: float, y: float, yaw: float) -> float:
    """About the length of the shortest way to a pose that is no further off than the table has entries."""
    turn = -yaw if (x < 0.0) != (y < 0.0) else yaw
    heading = math.floor(turn * (_HEADINGS / (2.0 * math.pi)) + 0.5) % _HEADINGS
    length: float = table[int(abs(x) * _PER_RADIUS + 0.5), int(abs(y) * _PER_RADIUS + 0.5), heading]
    return length


@kernel
def _fill(table: FloatArray) -> None:
    for i in range(table.shape[0]):
        for j in range(table.shape[1]):
            for heading in range(table.shape[2]):
                yaw = wrapped(heading * (2.0 * math.pi / _HEADINGS))
                table[i, j, heading] = shortest_length(i / _PER_RADIUS, j / _PER_RADIUS, yaw)


@kernel
def shortest_length(x: float, y: float, yaw: float) -> float:
    """Length of the shortest way from the origin, facing along x, to a pose [turning radii]."""
    return _best(x, y, yaw)[0]


@kernel
def shortest_way(x: float, y: float, yaw: float, segments: FloatArray) -> int:
    """Find the shortest way from the origin, facing along x, to a pose.

    Args:
        x: Of the pose [turning radii].
        y: Of the pose [turning radii].
        yaw: Of the pose [rad].
        segments: Filled with length [turning radii], negative backwards, and curvature, 1 to the left, of each arc and
            line; shape (MOST_SEGMENTS, 2).

    Returns:
        Number of segments.
    """
    _, word, symmetry, t, u, v = _best(x, y, yaw)
    n = _spelled(word, t, u, v, segments)
    if symmetry & 4:
        for k in range(n // 2):
            for column in range(2):
                first, last = segments[k, column], segments[n - 1 - k, column]
                segments[k, column], segments[n - 1 - k, column] = last, first
    for k in range(n):
        if symmetry & 1:
            segments[k, 0] = -segments[k, 0]
        if symmetry & 2:
            segments[k, 1] = -segments[k, 1]
    return n


@kernel
def _best(x: float, y: float, yaw: float) -> tuple[float, int, int, float, float, float]:
    """Length, word and symmetry (1 backwards, 2 mirrored, 4 from the end) of the shortest way, and its t, u, v."""
    best, best_word, best_symmetry, best_t, best_u, best_v = math.inf, 0, 0, 0.0, 0.0, 0.0
    sin, cos = math.sin(yaw), math.cos(yaw)
    for symmetry in range(8):
        px, py, angle, s = x, y, yaw, sin
        if symmetry & 4:
            px, py = x * cos + y * sin, x * sin - y * cos
        if symmetry & 1:
            px, angle, s = -px, -angle, -s
        if symmetry & 2:
            py, angle, s = -py, -angle, -s
        for word in range(_N_WORDS):
            if symmetry & 4 and word not in (2, 5, 6):
                continue  # the others read the same from their end
            valid, t, u, v = _base_word(word, px, py, angle, s, cos)
            if not valid:
                continue
            length = abs(t) + abs(u) + abs(v)
            if word in (3, 4):
                length += abs(u)
            elif word in (5, 6):
                length += _HALF_PI
            elif word == 7:
                length += 2.0 * _HALF_PI
            if length < best:
                best, best_word, best_symmetry, best_t, best_u, best_v = length, word, symmetry, t, u, v
    return best, best_word, best_symmetry, best_t, best_u, best_v


@kernel
def _base_word(word: int, x: float, y: float, yaw: float, sin: float, cos: float) -> tuple[bool, float, float, float]:
    """Whether a base word reaches a pose, and its lengths t, u, v; L R- is an arc to the left, then one back."""
    if word in (0, 2, 5):  # the last arc is to the side of the first
        xi, eta = x - sin, y - 1.0 + cos
    else:
        xi, eta = x + sin, y - 1.0 - cos
    square = xi * xi + eta * eta
    t, u, v = 0.0, 0.0, 0.0
    valid = False
    if word == 0:  # L S L
        u, t = math.sqrt(square), math.atan2(eta, xi)
        v = wrapped(yaw - t)
        valid = t >= -_EPS and v >= -_EPS
    elif word == 2:  # L R- L
        if square <= 16.0:
            u = -2.0 * math.asin(0.25 * math.sqrt(square))
            t = wrapped(math.atan2(eta, xi) + 0.5 * u + math.pi)
            v = wrapped(yaw - t + u)
            valid = t >= -_EPS
    elif word in (3, 4):
        valid, t, u, v = _four_arcs(word, xi, eta, yaw)
    elif square >= 4.0:
        valid, t, u, v = _with_line(word, xi, eta, yaw)
    return valid, t, u, v


@kernel
def _with_line(word: int, xi: float, eta: float, yaw: float) -> tuple[bool, float, float, float]:
    """Words with a line between arcs to different sides, or behind a quarter circle."""
    square = xi * xi + eta * eta
    root = math.sqrt(square - 4.0)
    if word == 1:  # L S R
        u, t = root, wrapped(math.atan2(eta, xi) + math.atan2(2.0, root))
        v = wrapped(t - yaw)
        return t >= -_EPS and v >= -_EPS, t, u, v
    if word == 5:  # L R- S- L-
        u, t = 2.0 - root, wrapped(math.atan2(eta, xi) + math.atan2(root, -2.0))
        v = wrapped(yaw - _HALF_PI - t)
        return t >= -_EPS and u <= _EPS and v <= _EPS, t, u, v
    if word == 6:  # L R- S- R-
        u, t = 2.0 - math.sqrt(square), math.atan2(xi, -eta)
        v = wrapped(t + _HALF_PI - yaw)
        return t >= -_EPS and u <= _EPS and v <= _EPS, t, u, v
    u = 4.0 - root  # L R- S- L- R
    t = wrapped(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
    v = wrapped(t - yaw)
    return t >= -_EPS and u <= _EPS and v >= -_EPS, t, u, v


@kernel
def _four_arcs(word: int, xi: float, eta: float, yaw: float) -> tuple[bool, float, float, float]:
    """Words of four arcs, L R L- R- and L R- L- R, the two in the middle of one length."""
    square = xi * xi + eta * eta
    if word == 3:
        rho = 0.25 * (2.0 + math.sqrt(square))
        if rho > 1.0:
            return False, 0.0, 0.0, 0.0
        u = math.acos(rho)
        delta, second = 2.0 * u, -u
    else:
        rho = (20.0 - square) / 16.0
        if rho < 0.0 or rho > 1.0:
            return False, 0.0, 0.0, 0.0
        u = -math.acos(rho)
        delta, second = 0.0, u
    a, b = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    t = math.atan2(eta * a - xi * b, xi * a + eta * b)
    if 2.0 * (math.cos(delta) - math.cos(second) - math.cos(u)) + 3.0 < 0.0:
        t += math.pi
    t = wrapped(t)
    v = wrapped(t - u + second - yaw)
    return t >= -_EPS and (v <= _EPS if word == 3 else v >= -_EPS), t, u, v


@kernel
def _spelled(word: int, t: float, u: float, v: float, segments: FloatArray) -> int:
    """Write the segments of a base word; returns how many."""
    lengths, sides, n = (t, u, v, 0.0, 0.0), (1.0, 0.0, 1.0, 0.0, 0.0), 3
    if word == 1:
        sides = (1.0, 0.0, -1.0, 0.0, 0.0)
    elif word == 2:
        sides = (1.0, -1.0, 1.0, 0.0, 0.0)
    elif word in (3, 4):
        middle = -u if word == 3 else u
        lengths, sides, n = (t, u, middle, v, 0.0), (1.0, -1.0, 1.0, -1.0, 0.0), 4
    elif word in (5, 6):
        last = 1.0 if word == 5 else -1.0
        lengths, sides, n = (t, -_HALF_PI, u, v, 0.0), (1.0, -1.0, 0.0, last, 0.0), 4
    elif word == 7:
        lengths, sides, n = (t, -_HALF_PI, u, -_HALF_PI, v), (1.0, -1.0, 0.0, 1.0, -1.0), 5
    for k in range(n):
        segments[k, 0] = lengths[k]
        segments[k, 1] = sides[k]
    return n
