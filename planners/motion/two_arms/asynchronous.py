"""Asynchronous motions: every joint goes from start to goal as fast as it can, without regard to the others.

The joints need different times. Where a synchronous motion slows all of them down to the slowest, here they may be done
early, or begin late. An arm that leaves a place which another waits for is out of the way sooner if all of its joints
begin at once; one that arrives there comes late with all of its joints, and both take no longer for it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planners.errors import PlanningError
from planners.motion import checks
from planners.motion.arrays import FloatArray, IntArray
from planners.motion.kernel import kernel
from planners.motion.path.trajectory import MOST_SAMPLES, Trajectory

SMOOTHING_S = 0.08
"""Window over which motions are averaged unless said otherwise [s]."""


def asynchronous(
    start: npt.ArrayLike,
    goal: npt.ArrayLike,
    max_velocity: npt.ArrayLike,
    max_acceleration: npt.ArrayLike,
    dt_s: float,
    *,
    late: bool = False,
    push: npt.ArrayLike | None = None,
    push_s: float = 0.0,
    smoothing_s: float = SMOOTHING_S,
) -> Trajectory:
    """Move every joint with a trapezoidal velocity of its own, from rest to rest.

    The motion leaves the straight line in joint space. Without a push, no joint leaves the interval from its start to
    its goal. Averaging over `smoothing_s` bounds the jerk to 2 * acceleration / smoothing_s, as in `retime`.

    Args:
        start: Joint angles [rad], shape (n,).
        goal: Joint angles [rad], shape (n,).
        max_velocity: Velocity limits [rad/s], shape (n,), > 0.
        max_acceleration: Acceleration limits [rad/s^2], shape (n,), > 0.
        dt_s: Sample period [s], > 0.
        late: Whether joints that need less time than the slowest begin late instead of being done early; the motion is
            then that from goal to start, backwards, with its push before the end.
        push: To which side each joint is accelerated first, wherever its goal is: -1, 1, or 0 for the way it goes
            anyway, shape (n,); None for none.
        push_s: How long, at most: a joint at its speed limit turns to its goal [s], >= 0.
        smoothing_s: Length of the averaging window [s], > 0.

    Returns:
        Samples at multiples of `dt_s`; first and last are start and goal exactly, with zero velocity.

    Raises:
        PlanningError: Malformed input.

    Source: Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, sections 3.2
        (trapezoidal velocity) and 4.5 (smoothing by averaging).
    """
    sides = np.zeros(np.shape(start)) if push is None else push
    rows = [
        checks.floats(f"asynchronous: {name}", row)
        for name, row in (
            ("start", start),
            ("goal", goal),
            ("max_velocity", max_velocity),
            ("max_acceleration", max_acceleration),
            ("push", sides),
        )
    ]
    if rows[0].ndim != 1 or len({row.shape for row in rows}) != 1:
        raise PlanningError(f"asynchronous: shapes {[row.shape for row in rows]}; valid: (n,) for all")
    ends, limits = np.stack(rows[:2]), np.stack(rows[2:4])
    if not np.all(np.isfinite(ends)) or not np.all(limits > 0):
        raise PlanningError(f"asynchronous: angles {ends}, limits {limits}; valid: finite, and > 0")
    if not (dt_s > 0 and smoothing_s > 0 and push_s >= 0) or not np.all(np.isin(rows[4], (-1.0, 0.0, 1.0))):
        raise PlanningError(
            f"asynchronous: dt_s {dt_s}, smoothing_s {smoothing_s}, push {rows[4]}, push_s {push_s}; valid: > 0, > 0,"
            " -1, 0 or 1, and >= 0"
        )
    if not np.isfinite((dt_s, smoothing_s, push_s)).all() or not np.isfinite(limits).all():
        raise PlanningError(
            f"asynchronous: limits {limits}, dt_s {dt_s}, smoothing_s {smoothing_s}, push_s {push_s}; valid: finite"
        )
    if np.array_equal(ends[0], ends[1]):
        return Trajectory(t=np.zeros(1), q=ends[:1], qd=np.zeros((1, ends.shape[1])))
    first, last = (1, 0) if late else (0, 1)
    q, qd = _sampled(ends[first], ends[last], limits[0], limits[1], rows[4], push_s, float(dt_s), float(smoothing_s))
    if len(q) == 0:
        raise PlanningError(
            f"asynchronous: limits {limits} with samples of {dt_s} s; valid: at most {MOST_SAMPLES} samples"
        )
    if late:
        q, qd = np.ascontiguousarray(q[::-1]), np.ascontiguousarray(-qd[::-1])
    return Trajectory(t=np.arange(len(q), dtype=np.float64) * float(dt_s), q=q, qd=qd)


def least_times_s(
    q: npt.ArrayLike, others: npt.ArrayLike, max_velocity: npt.ArrayLike, max_acceleration: npt.ArrayLike
) -> FloatArray:
    """Least time from each configuration to the nearest of others, within joint limits but through any obstacle.

    Args:
        q: Configurations [rad], shape (k, n).
        others: Configurations [rad], shape (m, n), m >= 1.
        max_velocity: Velocity limits [rad/s], shape (n,), > 0.
        max_acceleration: Acceleration limits [rad/s^2], shape (n,), > 0.

    Returns:
        Times [s], shape (k,).
    """
    return soonest(q, others, max_velocity, max_acceleration)[0]


def soonest(
    q: npt.ArrayLike, others: npt.ArrayLike, max_velocity: npt.ArrayLike, max_acceleration: npt.ArrayLike
) -> tuple[FloatArray, IntArray]:
    """Which of others is the nearest in time to each configuration; arguments as for `least_times_s`.

    Returns:
        Times [s] and rows of `others`, shapes (k,).

    Raises:
        PlanningError: Malformed input.
    """
    second = checks.floats("soonest: others", others)
    n = second.shape[1] if second.ndim == 2 else 0
    first, second = checks.rows("soonest: q", q, n, least=0), checks.rows("soonest: others", second, n)
    limits = np.array([checks.vector("soonest: limits", row, n) for row in (max_velocity, max_acceleration)])
    if not np.all(limits > 0):
        raise PlanningError(f"soonest: limits {limits}; valid: > 0")
    return _least_times(first, second, limits[0], limits[1])


@kernel
def _ramp_and_whole(change: float, velocity: float, acceleration: float) -> tuple[float, float]:
    """Time of speeding up, and of the whole motion, of one joint that turns by `change` > 0."""
    ramp = min(velocity / acceleration, np.sqrt(change / acceleration))
    return ramp, ramp + change / (acceleration * ramp)


@kernel
def _least_times(
    q: FloatArray, others: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, IntArray]:
    n = q.shape[1]
    out = np.full(q.shape[0], np.inf)
    row = np.zeros(q.shape[0], dtype=np.int64)
    within = np.empty(n)  # how far the joints come in less than the best time: spares the roots of most others
    for i in range(q.shape[0]):
        within[:] = np.inf
        for m in range(others.shape[0]):
            nearer = True
            for j in range(n):
                if abs(q[i, j] - others[m, j]) >= within[j]:
                    nearer = False
                    break
            if not nearer:
                continue
            out[i] = 0.0
            row[i] = m
            for j in range(n):
                change = abs(q[i, j] - others[m, j])
                if change > 0.0:
                    out[i] = max(out[i], _ramp_and_whole(change, velocity[j], acceleration[j])[1])
            for j in range(n):
                ramp = min(0.5 * out[i], velocity[j] / acceleration[j])
                within[j] = acceleration[j] * ramp * (out[i] - ramp)
    return out, row


@kernel
def steps_into(
    change: float, velocity: float, acceleration: float, side: float, push: float, at: FloatArray, height: FloatArray
) -> float:
    """Fill the acceleration of one joint that turns by `change`: at times (5,) it rises by heights (5,).

    The joint is accelerated to `side` for `push` first, then takes the fastest way to its goal from where that leaves
    it. Returns the time of the whole motion.
    """
    begin = min(push, velocity / acceleration) if side != 0.0 else 0.0
    left = change - 0.5 * side * acceleration * begin * begin
    speed = side * acceleration * begin
    # Where the joint would come to rest if it braked now tells to which side the goal is.
    way = 1.0 if left > 0.5 * speed * abs(speed) / acceleration else -1.0
    top = min(velocity, np.sqrt(max(0.0, way * left * acceleration + 0.5 * speed * speed)))
    coast = (way * left - (top * top - 0.5 * speed * speed) / acceleration) / top if top > 0.0 else 0.0
    at[0] = 0.0
    at[1] = begin
    at[2] = begin + (top - way * speed) / acceleration
    at[3] = at[2] + max(0.0, coast)
    at[4] = at[3] + top / acceleration
    height[0] = side * acceleration
    height[1] = (way - side) * acceleration
    height[2] = -way * acceleration
    height[3] = -way * acceleration
    height[4] = way * acceleration
    return float(at[4])


@kernel
def smoothed(since: float, at: FloatArray, height: FloatArray, window: float) -> tuple[float, float]:
    """Way and speed of a joint with that acceleration, averaged over the window: each step adds a cube."""
    way = 0.0
    speed = 0.0
    for step in range(5):
        here = max(0.0, since - at[step])
        before = max(0.0, here - window)
        way += height[step] * (here * here * here - before * before * before)
        speed += height[step] * (here * here - before * before)
    return way / (6.0 * window), speed / (2.0 * window)


@kernel
def _sampled(
    start: FloatArray,
    goal: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    sides: FloatArray,
    push: float,
    dt: float,
    window: float,
) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities, each (k, n), none if they are too many."""
    n = start.shape[0]
    at = np.empty((n, 5))
    height = np.empty((n, 5))
    longest = 0.0
    for j in range(n):
        whole = steps_into(goal[j] - start[j], velocity[j], acceleration[j], sides[j], push, at[j], height[j])
        longest = max(longest, whole)
    if not (longest + window) / dt < MOST_SAMPLES:
        return np.empty((0, n)), np.empty((0, n))
    k = int(np.ceil((longest + window) / dt - 1e-9)) + 1
    q = np.empty((k, n))
    qd = np.zeros((k, n))
    for j in range(n):
        for i in range(k):
            if i * dt >= at[j, 4] + window:
                q[i, j] = goal[j]
            else:
                way, qd[i, j] = smoothed(i * dt, at[j], height[j], window)
                q[i, j] = start[j] + way
    q[0] = start
    q[-1] = goal
    qd[0] = 0.0
    qd[-1] = 0.0
    return q, qd
