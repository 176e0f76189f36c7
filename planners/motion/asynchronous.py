"""Asynchronous motions: every joint goes from start to goal as fast as it can, without regard to the others.

The joints need different times. Where a synchronous motion slows all of them down to the slowest, here they may be done
early, or begin late. An arm that leaves a place which another waits for is out of the way sooner if all of its joints
begin at once; one that arrives there comes late with all of its joints, and both take no longer for it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.errors import PlanningError
from planners.motion.trajectory import Trajectory

FloatArray = npt.NDArray[np.float64]


def asynchronous(
    start: npt.ArrayLike,
    goal: npt.ArrayLike,
    max_velocity: npt.ArrayLike,
    max_acceleration: npt.ArrayLike,
    dt_s: float,
    *,
    late: bool = False,
    smoothing_s: float = 0.08,
) -> Trajectory:
    """Move every joint with a trapezoidal velocity of its own, from rest to rest.

    The motion leaves the straight line in joint space, but no joint leaves the interval from its start to its goal.
    Averaging over `smoothing_s` bounds the jerk to 2 * acceleration / smoothing_s, as in `retime`.

    Args:
        start: Joint angles [rad], shape (n,).
        goal: Joint angles [rad], shape (n,).
        max_velocity: Velocity limits [rad/s], shape (n,), > 0.
        max_acceleration: Acceleration limits [rad/s^2], shape (n,), > 0.
        dt_s: Sample period [s], > 0.
        late: Whether joints that need less time than the slowest begin late instead of being done early.
        smoothing_s: Length of the averaging window [s], > 0.

    Returns:
        Samples at multiples of `dt_s`; first and last are start and goal exactly, with zero velocity.

    Raises:
        PlanningError: Malformed input.

    Source: Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, sections 3.2
        (trapezoidal velocity) and 4.5 (smoothing by averaging).
    """
    rows = [np.array(row, dtype=np.float64) for row in (start, goal, max_velocity, max_acceleration)]
    if rows[0].ndim != 1 or len({row.shape for row in rows}) != 1:
        raise PlanningError(f"asynchronous: shapes {[row.shape for row in rows]}, expected (n,) four times")
    ends, limits = np.stack(rows[:2]), np.stack(rows[2:])
    if not np.all(np.isfinite(ends)) or not np.all(limits > 0):
        raise PlanningError(f"asynchronous: angles {ends}, limits {limits}; expected finite, and > 0")
    if not (dt_s > 0 and smoothing_s > 0):
        raise PlanningError(f"asynchronous: dt_s {dt_s}, smoothing_s {smoothing_s}; expected > 0")
    if np.array_equal(ends[0], ends[1]):
        return Trajectory(t=np.zeros(1), q=ends[:1], qd=np.zeros((1, ends.shape[1])))
    q, qd = _sampled(ends[0], ends[1], limits[0], limits[1], float(dt_s), float(smoothing_s), bool(late))
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
    first, second = np.array(q, dtype=np.float64), np.array(others, dtype=np.float64)
    limits = np.array([max_velocity, max_acceleration], dtype=np.float64)
    return _least_times(first, second, limits[0], limits[1])  # type: ignore[no-any-return]


@njit(cache=True)
def _ramp_and_whole(change, velocity, acceleration):  # type: ignore[no-untyped-def]
    """Time of speeding up, and of the whole motion, of one joint that turns by `change` > 0."""
    ramp = min(velocity / acceleration, np.sqrt(change / acceleration))
    return ramp, ramp + change / (acceleration * ramp)


@njit(cache=True)
def _least_times(q, others, velocity, acceleration):  # type: ignore[no-untyped-def]
    n = q.shape[1]
    out = np.full(q.shape[0], np.inf)
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
            for j in range(n):
                change = abs(q[i, j] - others[m, j])
                if change > 0.0:
                    out[i] = max(out[i], _ramp_and_whole(change, velocity[j], acceleration[j])[1])
            for j in range(n):
                ramp = min(0.5 * out[i], velocity[j] / acceleration[j])
                within[j] = acceleration[j] * ramp * (out[i] - ramp)
    return out


@njit(cache=True)
def _sampled(start, goal, velocity, acceleration, dt, window, late):  # type: ignore[no-untyped-def]
    """Positions and velocities, each (k, n).

    The acceleration is a sum of four steps, so the position averaged over the window is a sum of eight cubes.
    """
    n = start.shape[0]
    ramp = np.zeros(n)
    whole = np.zeros(n)
    for j in range(n):
        if goal[j] != start[j]:
            ramp[j], whole[j] = _ramp_and_whole(abs(goal[j] - start[j]), velocity[j], acceleration[j])
    k = int(np.ceil((whole.max() + window) / dt - 1e-9)) + 1
    q = np.empty((k, n))
    qd = np.zeros((k, n))
    for j in range(n):
        push = acceleration[j] if goal[j] > start[j] else -acceleration[j]
        first = (k - 1) * dt - whole[j] - window if late else 0.0
        for i in range(k):
            since = i * dt - first
            q[i, j] = start[j]
            if since >= whole[j] + window:
                q[i, j] = goal[j]
            elif since > 0.0:
                for step in range(4):
                    at = (0.0, ramp[j], whole[j] - ramp[j], whole[j])[step]
                    sign = (push, -push, -push, push)[step]
                    here = max(0.0, since - at)
                    before = max(0.0, since - at - window)
                    q[i, j] += sign * (here**3 - before**3) / (6.0 * window)
                    qd[i, j] += sign * (here**2 - before**2) / (2.0 * window)
    q[0] = start
    q[-1] = goal
    qd[0] = 0.0
    qd[-1] = 0.0
    return q, qd
