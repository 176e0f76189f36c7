"""Time stamps for a joint path: smooth, rest to rest, inside velocity and acceleration limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arrays import FloatArray, IntArray
from planners.motion.kernel import kernel

_SAME_RAD = 1e-9
_UNEQUAL = 1e-3
_LONGEST_RAD = 1e4
MOST_SAMPLES = 10_000_000
"""Samples of the longest motion that is made: gigabytes."""
_FINE_DT_S = 0.004  # the average is taken over steps no longer than this
_CELL_RAD = 0.02
_LINE_CELLS = 4
_BLEND_CELLS = 8
_BISECTIONS = 24  # speed bounds to 1e-7 of the largest
_OVER = 1.001  # times a velocity limit that samples may reach
_MOST_BISECTIONS = 100  # where the bound is smaller than that, as on a piece of 1e-8 rad: not zero, or it never ends


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Samples of a joint motion over time."""

    t: FloatArray
    """Times [s], shape (k,), from 0 in equal steps."""
    q: FloatArray
    """Joint angles [rad], shape (k, n)."""
    qd: FloatArray
    """Joint velocities [rad/s], shape (k, n)."""

    def __post_init__(self) -> None:
        for name in ("t", "q", "qd"):
            checks.is_array(f"Trajectory.{name}", getattr(self, name))
        k = len(self.t) if self.t.ndim == 1 else 0
        if k == 0 or self.q.ndim != 2 or len(self.q) != k or self.qd.shape != self.q.shape:
            raise PlanningError(
                f"Trajectory: t {self.t.shape}, q {self.q.shape}, qd {self.qd.shape}; valid: (k,) and twice (k, n)"
            )
        # Samples are found by their number, so that other times would lead beyond the arrays.
        if self.t[0] != 0.0 or not _are_equal_steps(np.ascontiguousarray(self.t, dtype=np.float64)):
            raise PlanningError(f"Trajectory: t {self.t}; valid: times from 0 in equal steps")

    @cached_property
    def duration_s(self) -> float:
        """Time of the last sample [s]."""
        return float(self.t[-1])

    def sample(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """State at a time, by cubic interpolation; before the start and after the end the arm rests.

        Args:
            time_s: Time since the start [s].

        Returns:
            Joint angles [rad] and velocities [rad/s], each shape (n,).

        Raises:
            PlanningError: The time is no number.
        """
        if math.isnan(time_s):
            raise PlanningError(f"time_s {time_s!r}; valid: a number of seconds")
        if len(self.t) == 1 or time_s <= self.t[0]:
            return self.q[0].copy(), self.qd[0].copy()
        if time_s >= self.t[-1]:
            return self.q[-1].copy(), self.qd[-1].copy()
        state = np.empty((2, self.q.shape[1]))
        interpolate(self.t, self.q, self.qd, time_s, state)
        return state[0], state[1]


@kernel
def _are_equal_steps(t: FloatArray) -> bool:
    """Whether times ascend in steps that are all but equal."""
    least, most = np.inf, 0.0
    for i in range(1, len(t)):
        step = t[i] - t[i - 1]
        if not step > 0.0:
            return False
        least, most = min(least, step), max(most, step)
    return bool(len(t) == 1 or most - least < _UNEQUAL * most)


@kernel
def interpolate(t: FloatArray, q: FloatArray, qd: FloatArray, time: float, state: FloatArray) -> None:
    """Fill `state` (2, n) with joint angles and velocities at a time between the first sample and the last."""
    dt = t[1] - t[0]
    i = min(int(time / dt), len(t) - 2)
    u = (time - t[i]) / dt
    for j in range(q.shape[1]):
        rise, m0, m1 = q[i + 1, j] - q[i, j], dt * qd[i, j], dt * qd[i + 1, j]
        # Hermite cubic in the powers of u
        c2, c3 = 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise
        state[0, j] = q[i, j] + u * (m0 + u * (c2 + u * c3))
        state[1, j] = (m0 + u * (2.0 * c2 + 3.0 * u * c3)) / dt


@kernel
def _cells(path: FloatArray, deviation: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Cut the rounded path into cells of constant curvature.

    Corners become quadratic Bezier arcs, parameterized so that dq/ds is continuous and d2q/ds2 constant on each arc.
    Returns the cells' parameter lengths (m,), start points (m, n), start tangents (m, n) and curvatures (m, n).
    """
    k, n = len(path) - 1, path.shape[1]
    unit, length = path[1:] - path[:-1], np.empty(k)
    for i in range(k):
        length[i] = _norm(unit[i])
        unit[i] /= length[i]
    # Half-length of the arc at each corner: it passes the corner at a distance of cut * bend / 4.
    cut = np.zeros(k + 1)
    for i in range(1, k):
        bend = _norm(unit[i] - unit[i - 1])
        cut[i] = min(0.5 * min(length[i - 1], length[i]), 4.0 * deviation / max(bend, 1e-9))
    straight, lines = np.empty(k), np.zeros(k, dtype=np.int64)
    for i in range(k):
        straight[i] = length[i] - cut[i] - cut[i + 1]
        if straight[i] > _SAME_RAD:
            lines[i] = max(_LINE_CELLS, int(np.ceil(straight[i] / _CELL_RAD)))
    m = lines.sum() + _BLEND_CELLS * (k - 1)
    size, point, tangent, curve = np.empty(m), np.empty((m, n)), np.empty((m, n)), np.empty((m, n))
    _fill_cells(path, unit, cut, straight, lines, size, point, tangent, curve)
    return size, point, tangent, curve


@kernel
def _merged(path: FloatArray) -> FloatArray:
    """The corners of a path without those that equal the one before, (m, n)."""
    kept = np.empty_like(path)
    kept[0] = path[0]
    m = 1
    for i in range(1, len(path)):
        if _norm(path[i] - path[i - 1]) > _SAME_RAD:
            kept[m] = path[i]
            m += 1
    return kept[:m].copy()


@kernel
def _bound_speeds(path: FloatArray, max_velocity: FloatArray, max_acceleration: FloatArray) -> float:
    """Lower the limits that no joint can reach on a path; returns the longest way of a joint [rad].

    From rest to rest no joint gets a tenth as fast; the kernels are as exact as the largest speed is small.
    """
    longest = 0.0
    for j in range(path.shape[1]):
        way = 0.0
        for i in range(1, len(path)):
            way += abs(path[i, j] - path[i - 1, j])
        longest = max(longest, way)
        max_velocity[j] = min(max_velocity[j], 10.0 * np.sqrt(max_acceleration[j] * max(way, 1.0)))
    return longest


@kernel
def _norm(values: FloatArray) -> float:
    square = 0.0
    for value in values:
        square += value * value
    return float(np.sqrt(square))


@kernel
def _fill_cells(
    path: FloatArray,
    unit: FloatArray,
    cut: FloatArray,
    straight: FloatArray,
    lines: IntArray,
    size: FloatArray,
    point: FloatArray,
    tangent: FloatArray,
    curve: FloatArray,
) -> None:
    """Fill the cells of each straight piece and of the arc behind it."""
    at = 0
    for i in range(len(lines)):
        for k in range(lines[i]):
            size[at] = straight[i] / lines[i]
            ahead = cut[i] + k * (straight[i] / lines[i])
            for j in range(path.shape[1]):
                point[at, j] = path[i, j] + unit[i, j] * ahead
                tangent[at, j] = unit[i, j]
                curve[at, j] = 0.0
            at += 1
        if i + 1 == len(lines):
            break
        for k in range(_BLEND_CELLS):
            size[at] = 2.0 * cut[i + 1] / _BLEND_CELLS
            s = k * (2.0 * cut[i + 1] / _BLEND_CELLS)
            for j in range(path.shape[1]):
                bent = (unit[i + 1, j] - unit[i, j]) / (2.0 * cut[i + 1])
                point[at, j] = path[i + 1, j] - unit[i, j] * (cut[i + 1] - s) + 0.5 * bent * s * s
                tangent[at, j] = unit[i, j] + bent * s
                curve[at, j] = bent
            at += 1


@kernel
def _most_push(x: float, size: float, tangent: float, curve: float, limit: float) -> float:
    """Largest path acceleration u with which one joint keeps its velocity limit inside a cell.

    Its velocity at s is t sqrt(x + 2 u s) with the tangent t = tangent + curve s. Squared speeds x + 2 u s are a line,
    the bound limit^2 / t^2 is convex where t does not change its sign, so the steepest line below it touches it at a
    root of x t^3 - 3 limit^2 t + 2 limit^2 tangent = 0 (Viete's), or meets it at the end of the cell, where it is
    bounded already. There is one root while |t| falls and one while it grows.
    """
    first, rise = (tangent, curve) if curve > 0.0 else (-tangent, -curve)
    last = first + rise * size
    shift = min(1.0, max(-1.0, first * np.sqrt(x) / limit))
    most = np.inf
    if first < 0.0:
        touch = -first * 2.0 / 3.0  # where it begins at rest
        if shift < -1e-6:
            touch = 2.0 * limit / np.sqrt(x) * np.cos((np.arccos(shift) - 2.0 * np.pi) / 3.0)
        if -touch < last:
            most = rise * limit**2 / touch**3
    if last > 0.0 and x > 0.0:
        touch = 2.0 * limit / np.sqrt(x) * np.cos(np.arccos(-shift) / 3.0)
        if touch < last:
            most = min(most, -rise * limit**2 / touch**3)
    return most


@kernel
def _push_range(
    x: float,
    size: float,
    tangent: FloatArray,
    curve: FloatArray,
    limit: FloatArray,
    within: FloatArray,
    x_next_max: float,
) -> tuple[float, float]:
    """Range of the path acceleration u over a cell entered with squared path speed x; empty if low > high."""
    low = -x / (2.0 * size)
    high = (x_next_max - x) / (2.0 * size)
    for j in range(tangent.shape[0]):
        for end in range(2):
            # At the cell's end the tangent is larger by curve * size and the squared speed by 2 * size * u.
            slope = tangent[j] + (3.0 * curve[j] * size if end else 0.0)
            rest = curve[j] * x
            if abs(slope) > 1e-12:
                a = (-limit[j] - rest) / slope
                b = (limit[j] - rest) / slope
                low = max(low, min(a, b))
                high = min(high, max(a, b))
            elif abs(rest) > limit[j]:
                return 1.0, 0.0
    for j in range(tangent.shape[0]):
        if low > high:
            break
        steepest = max(abs(tangent[j]), abs(tangent[j] + curve[j] * size))
        if steepest**2 * max(x, x + 2.0 * size * high) > within[j] ** 2 and abs(curve[j]) > 1e-9:
            high = min(high, _most_push(x, size, tangent[j], curve[j], within[j]))
    return low, high


@kernel
def _speeds(
    size: FloatArray,
    tangent: FloatArray,
    curve: FloatArray,
    max_velocity: FloatArray,
    max_acceleration: FloatArray,
    within: FloatArray,
) -> FloatArray:
    """Time-optimal squared path speeds at the cell borders (m+1,), zero at both ends.

    Velocities are limited by `max_velocity` at the borders and by `within` between them.
    """
    m, n = tangent.shape
    top = np.full(m + 1, np.inf)
    for c in range(m):
        for j in range(n):
            t = tangent[c, j]
            if abs(t) > 1e-9:
                top[c] = min(top[c], (max_velocity[j] / t) ** 2)
            t += curve[c, j] * size[c]
            if abs(t) > 1e-9:
                top[c + 1] = min(top[c + 1], (max_velocity[j] / t) ** 2)
            if abs(curve[c, j]) > 1e-9:  # far above what is reachable: only there for a tangent that vanishes
                top[c] = min(top[c], 1e3 * max_acceleration[j] / abs(curve[c, j]))
    top[m] = 0.0
    for c in range(m - 1, -1, -1):  # backward: largest speeds from which the end can still be met
        low, high = _push_range(top[c], size[c], tangent[c], curve[c], max_acceleration, within, top[c + 1])
        if low <= high:
            continue
        inside = 0.0
        outside = top[c]
        for k in range(_MOST_BISECTIONS):
            if k >= _BISECTIONS and inside > 0.0:
                break
            x = 0.5 * (inside + outside)
            low, high = _push_range(x, size[c], tangent[c], curve[c], max_acceleration, within, top[c + 1])
            if low <= high:
                inside = x
            else:
                outside = x
        top[c] = inside
    speed = np.zeros(m + 1)
    for c in range(m):  # forward: as fast as those allow
        low, high = _push_range(speed[c], size[c], tangent[c], curve[c], max_acceleration, within, top[c + 1])
        speed[c + 1] = min(top[c + 1], max(0.0, speed[c] + 2.0 * size[c] * max(low, high)))
    speed[m] = 0.0
    return speed


@kernel
def _sampled(
    path: FloatArray,
    size: FloatArray,
    point: FloatArray,
    tangent: FloatArray,
    curve: FloatArray,
    speed: FloatArray,
    fine_dt: float,
    per_sample: int,
    width: int,
) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities every `per_sample` fine steps, averages over `width` of them; each (k, n), or (0, n)."""
    m, n = tangent.shape
    pace = np.sqrt(speed)
    time = np.zeros(m + 1)
    for c in range(m):
        if pace[c] + pace[c + 1] > 0.0:
            time[c + 1] = time[c] + 2.0 * size[c] / (pace[c] + pace[c + 1])
        else:
            time[c + 1] = np.inf
    if not time[m] / fine_dt + width + per_sample < MOST_SAMPLES:
        return np.empty((0, n)), np.empty((0, n))
    # Slow down a little, so that the end falls on a sample.
    total = int(np.ceil(time[m] / fine_dt - 1e-9)) + width - 1
    total += -total % per_sample
    moving = total - width + 1
    stretch = moving * fine_dt / time[m]
    # Sums of the fine samples, with rest before and behind. Relative to the start, they stay small and their rounding
    # far below the limits.
    sums = np.zeros((total + width + 2, 2, n))
    c = 0
    for row in range(total + width + 1):
        fine = row - width
        if 0 < fine < moving:
            at = min(fine * (fine_dt / stretch), time[m])
            while c < m - 1 and time[c + 1] <= at:
                c += 1
            since = at - time[c]
            push = (speed[c + 1] - speed[c]) / (2.0 * size[c])
            s = min(max(since * (pace[c] + 0.5 * push * since), 0.0), size[c])
            rate = max(0.0, pace[c] + push * since) / stretch
        for j in range(n):
            q = qd = 0.0
            if 0 < fine < moving:
                q = point[c, j] + s * (tangent[c, j] + 0.5 * curve[c, j] * s) - path[0, j]
                qd = (tangent[c, j] + curve[c, j] * s) * rate
            elif fine >= moving:
                q = path[-1, j] - path[0, j]
            sums[row + 1, 0, j] = sums[row, 0, j] + q
            sums[row + 1, 1, j] = sums[row, 1, j] + qd
    k = total // per_sample + 1
    means = np.zeros((2, k, n))
    for sample in range(k):
        end = width + 1 + sample * per_sample
        for j in range(n):
            means[0, sample, j] = path[0, j] + (sums[end, 0, j] - sums[end - width, 0, j]) / width
            means[1, sample, j] = (sums[end, 1, j] - sums[end - width, 1, j]) / width
    means[0, 0], means[0, k - 1], means[1, 0], means[1, k - 1] = path[0], path[-1], 0.0, 0.0
    return means[0], means[1]


@kernel
def _timed(
    path: FloatArray,
    deviation: float,
    max_velocity: FloatArray,
    max_acceleration: FloatArray,
    fine_dt: float,
    per_sample: int,
    width: int,
) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities of the fastest motion along a path, as `_sampled` gives them.

    Between the borders of cells velocities are looked at only where it turns out that they have to be, as with joints
    that are slow but strong.
    """
    size, point, tangent, curve = _cells(path, deviation)
    within = np.full(len(max_velocity), np.inf)
    for _ in range(2):
        speed = _speeds(size, tangent, curve, max_velocity, max_acceleration, within)
        q, qd = _sampled(path, size, point, tangent, curve, speed, fine_dt, per_sample, width)
        if _keeps(q, qd, max_velocity, fine_dt * per_sample):
            break
        within = max_velocity
    return q, qd


@kernel
def _keeps(q: FloatArray, qd: FloatArray, max_velocity: FloatArray, dt: float) -> bool:
    """Whether velocities and differences of samples respect the limits."""
    for i in range(len(q)):
        for j in range(len(max_velocity)):
            most = _OVER * max_velocity[j]
            if abs(qd[i, j]) > most or (i and abs(q[i, j] - q[i - 1, j]) > most * dt):
                return False
    return True


def retime(
    path: npt.ArrayLike,
    max_velocity: npt.ArrayLike,
    max_acceleration: npt.ArrayLike,
    dt_s: float,
    *,
    max_deviation_rad: float = 0.05,
    smoothing_s: float = 0.08,
) -> Trajectory:
    """Give a joint path the fastest smooth motion inside the limits, from rest to rest.

    The arm does not stop at corners: it cuts them by arcs that stay within `max_deviation_rad` (joint-space distance)
    of the path. Averaging over `smoothing_s` then bounds the jerk to 2 * acceleration / smoothing_s; it adds at most
    max_acceleration * smoothing_s^2 / 24 per joint to the deviation (0.0013 rad at 5 rad/s^2 and 0.08 s). A
    caller to whom this matters checks `Trajectory.q` against the obstacles again.

    Args:
        path: Corners [rad], shape (k, n), k >= 1; equal neighbours are merged.
        max_velocity: Velocity limits [rad/s], shape (n,), > 0; infinite for none.
        max_acceleration: Acceleration limits [rad/s^2], shape (n,), > 0.
        dt_s: Sample period [s], > 0.
        max_deviation_rad: How far corners may be cut [rad], > 0.
        smoothing_s: Length of the averaging window [s], >= 0.

    Returns:
        Samples at multiples of `dt_s`; first and last are the path's ends exactly, with zero velocity. Differences of
        samples respect the limits within 0.1 % (velocity) and 1 % (acceleration).

    Raises:
        PlanningError: Malformed input, or a motion that takes more than a day or ten million samples.

    Source: Time-optimal path parameterization by reachability (Pham and Pham, TOPP-RA, IEEE T-RO 2018) on cells of
        constant curvature; corner arcs in the spirit of Kunz and Stilman, RSS 2012.
    """
    corners = checks.floats("retime: path", path)
    if corners.ndim != 2 or len(corners) == 0 or not np.isfinite(corners).all():
        raise PlanningError(f"retime: path of shape {corners.shape}; valid: finite values (k, n) with k >= 1")
    n = corners.shape[1]
    velocity = checks.floats("retime: max_velocity", max_velocity)
    acceleration = checks.floats("retime: max_acceleration", max_acceleration)
    for name, limit in (("max_velocity", velocity), ("max_acceleration", acceleration)):
        if limit.shape != (n,) or not (limit > 0).all():
            raise PlanningError(f"retime: {name} {limit}; valid: {n} values > 0")
    if not np.isfinite(acceleration).all():
        raise PlanningError(f"retime: max_acceleration {acceleration}; valid: finite values")
    dt_s = checks.positive("retime: dt_s", dt_s)
    checks.positive("retime: max_deviation_rad", max_deviation_rad)
    checks.positive("retime: smoothing_s", smoothing_s, zero=True)
    corners = _merged(corners)
    if len(corners) == 1:
        return Trajectory(t=np.zeros(1), q=corners, qd=np.zeros((1, n)))
    velocity = velocity.copy()
    turned = _bound_speeds(corners, velocity, acceleration)
    if turned > _LONGEST_RAD:
        raise PlanningError(f"retime: a path of {turned} rad in one joint; valid: at most {_LONGEST_RAD}")
    per_sample = max(1, int(np.ceil(dt_s / _FINE_DT_S)))
    fine_dt = dt_s / per_sample
    width = max(1, round(smoothing_s / fine_dt))
    q, qd = _timed(corners, max_deviation_rad, velocity, acceleration, fine_dt, per_sample, width)
    if len(q) == 0:
        raise PlanningError(
            f"retime: limits {velocity} and {acceleration} with samples of {dt_s} s and {smoothing_s} s of smoothing; "
            f"valid: a motion of at most {MOST_SAMPLES} samples"
        )
    return Trajectory(t=np.arange(len(q), dtype=np.float64) * float(dt_s), q=q, qd=qd)
