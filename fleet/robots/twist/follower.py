"""TwistFollower: drives robots along paths by a speed and a yaw rate, turns on the spot included."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray, SignArray
from fleet.robots.angle import wrapped
from fleet.robots.differential import TwistFollowerConfig, TwistLimits
from fleet.robots.pursuit import PathBuffer

_SAME_PLACE_M2 = 1e-12
"""Points nearer than this, squared, are one place: the segment between them is a turn on the spot."""
_SPEED_SLACK_MPS = 0.3
"""Commands run at most this far ahead of the measured speed, so that a blocked robot does not wind up [m/s]."""


class _Gains(NamedTuple):
    tick_s: float
    limits: _Limits
    cross_per_m2: float
    heading_per_m: float
    lag_s: float
    brake_fraction: float
    approach_per_s: float
    creep_mps: float
    stop_tolerance_m: float
    slow_mps: float
    turn_tolerance_rad: float
    slow_radps: float
    hold_per_s: float
    hold_mps: float
    restart_m: float
    braked_restart_m: float


class _Limits(NamedTuple):
    speed: float
    yaw_rate: float
    accel: float
    brake: float
    yaw_accel: float
    rim: float
    lever: float
    lateral: float


class _State(NamedTuple):
    """What the follower keeps of every robot."""

    last: FloatArray
    """The last command: signed speed [m/s] and yaw rate [rad/s], shape (n, 2)."""
    cross_track: FloatArray
    heading_error: FloatArray
    standing: BoolArray
    braked: BoolArray


class _Paths(NamedTuple):
    points: FloatArray
    s: FloatArray
    direction: SignArray
    n_points: IntArray
    cursor: IntArray
    progress: FloatArray


class TwistFollower:
    """Drives all robots along their paths; see `fleet.robots.twist.path` for turns on the spot.

    On moves the yaw rate is the path's own, averaged over the way that the yaw acceleration needs for it, plus what
    Kanayama's law says against errors of place and heading. Speed obeys cap, limits, curves ahead, and braking to the
    nearest of `stop_s`, the end of the path, a cusp and a turn on the spot; where a yaw rate is too much beside the
    speed, both are less, so that the curve stays. Turns on the spot follow a profile of yaw rate to rest.

    Attributes:
        progress: Arc length reached [m]; never decreases, shape (n,).
        cross_track: Signed distance to the path, positive = robot left of it as its nose points [m], shape (n,); in
            turns on the spot that to the spot.
        heading_error: Yaw minus the path's yaw [rad] in [-pi, pi], shape (n,); 0 in turns on the spot.
        standing: True where the robot was told to stand at its stop, shape (n,).
        braked: True where a standing robot has its brake on: little that is measured wakes it, shape (n,).

    Args:
        limits: What the robots may be told.
        n_robots: Number of robots.
        tick_s: Control period [s].
        config: Gains.
        robots: Which of them are driven; None = all. Others' rows stay as they are.

    Source: Y. Kanayama, Y. Kimura, F. Miyazaki, T. Noguchi, "A stable tracking control method for an autonomous mobile
    robot", ICRA 1990, https://doi.org/10.1109/ROBOT.1990.126006, eq. (8), by arc length instead of time.
    """

    def __init__(
        self,
        limits: TwistLimits,
        n_robots: int,
        tick_s: float,
        config: TwistFollowerConfig | None = None,
        robots: IntArray | None = None,
    ) -> None:
        config = config or TwistFollowerConfig()
        self.progress = np.zeros(n_robots)
        self.cross_track = np.zeros(n_robots)
        self.heading_error = np.zeros(n_robots)
        self.standing = np.ones(n_robots, dtype=np.bool_)
        self.braked = np.zeros(n_robots, dtype=np.bool_)
        self._robots = np.arange(n_robots) if robots is None else robots
        self._state = _State(np.zeros((n_robots, 2)), self.cross_track, self.heading_error, self.standing, self.braked)
        self._gains = _Gains(tick_s, _limits_of(limits), **vars(config))

    def reset(self, robot: int) -> None:
        """Forget how a robot moved; call it together with `PathBuffer.reset`."""
        self.cross_track[robot] = 0.0
        self.heading_error[robot] = 0.0
        self.standing[robot] = False
        self._state.last[robot] = 0.0

    def brake(self, robot: int, on: bool) -> None:
        """Let a robot that stands at its stop have its brake on, or off again."""
        self.braked[robot] = on

    def commands(
        self, paths: PathBuffer, poses: FloatArray, speeds: FloatArray, stop_s: FloatArray, speed_cap: FloatArray
    ) -> FloatArray:
        """Say what every robot does this tick.

        Args:
            paths: Paths ahead; cursor and progress in it move on.
            poses: Estimated poses x, y, yaw, shape (n, 3).
            speeds: Measured signed forward speeds [m/s], shape (n,).
            stop_s: Arc length where each robot must stand [m], shape (n,).
            speed_cap: Greatest speed [m/s], >= 0, shape (n,).

        Returns:
            Signed speed [m/s] and yaw rate [rad/s], shape (n, 2).
        """
        arrays = _Paths(paths.points, paths.s, paths.direction, paths.count, paths.cursor, paths.progress)
        _follow_all(arrays, self._state, self._robots, poses, speeds, stop_s, speed_cap, self._gains)
        self.progress[:] = paths.progress
        return self._state.last.copy()


def _limits_of(limits: TwistLimits) -> _Limits:
    return _Limits(
        speed=limits.max_speed_mps,
        yaw_rate=limits.max_yaw_rate_radps,
        accel=limits.max_accel_mps2,
        brake=limits.max_brake_mps2,
        yaw_accel=limits.max_yaw_accel_radps2,
        rim=limits.max_rim_mps,
        lever=limits.lever_m,
        lateral=limits.max_lateral_mps2,
    )


@njit(cache=True)
def shared(speed: float, yaw_rate: float, max_yaw_rate: float, max_rim: float, lever: float) -> float:
    """The factor, at most 1, with which a speed and a yaw rate are within what yaw rate and rims allow together."""
    factor = 1.0
    if abs(yaw_rate) > max_yaw_rate:
        factor = max_yaw_rate / abs(yaw_rate)
    rim = factor * (abs(speed) + lever * abs(yaw_rate))
    return factor * max_rim / rim if rim > max_rim else factor


@njit(cache=True)
def _on_the_spot(points: FloatArray, k: int) -> bool:
    """Whether the segment behind point `k` is a turn on the spot."""
    return (points[k + 1, 0] - points[k, 0]) ** 2 + (points[k + 1, 1] - points[k, 1]) ** 2 < _SAME_PLACE_M2


@njit(cache=True)
def _piece_end(points: FloatArray, direction: SignArray, k: int, end: int) -> int:
    """The point where the piece that begins at `k` ends: at a cusp, where turns begin or end, or with the path."""
    spot = _on_the_spot(points, k)
    last = k + 1
    while last < end and _on_the_spot(points, last) == spot and (spot or direction[last + 1] == direction[k + 1]):
        last += 1
    return last


@njit(cache=True)
def _yaw_at(points: FloatArray, s: FloatArray, first: int, last: int, s_at: float) -> float:
    """Yaw of the path at an arc length, constant outside points `first` to `last`, without jumps of a full turn."""
    if s_at <= s[first]:
        return points[first, 2]
    k = first
    yaw = points[first, 2]
    while k < last:
        step = wrapped(points[k + 1, 2] - points[k, 2])
        if s_at <= s[k + 1]:
            return yaw + step * (s_at - s[k]) / (s[k + 1] - s[k])
        yaw += step
        k += 1
    return yaw


@njit(cache=True)
def _curve_speed(points: FloatArray, s: FloatArray, k: int, last: int, s_here: float, speed: float, g: _Gains) -> float:
    """Greatest speed now from which all curves up to point `last` can be driven."""
    limits = g.limits
    brake = g.brake_fraction * limits.brake
    horizon = s_here + speed * speed / (2.0 * brake) + 2.0 * speed * g.tick_s + 0.1
    for j in range(k, last):
        if s[j] > horizon:
            break
        curvature = abs(wrapped(points[j + 1, 2] - points[j, 2])) / (s[j + 1] - s[j])
        limit = limits.rim / (1.0 + limits.lever * curvature)
        if curvature > 1e-9:
            limit = min(limit, limits.yaw_rate / curvature, math.sqrt(limits.lateral / curvature))
        speed = min(speed, math.sqrt(limit * limit + 2.0 * brake * max(0.0, s[j] - s_here)))
    return speed


@njit(cache=True)
def _ramped(target: float, before: float, rise: float, fall: float) -> float:
    """The target as far as a tick lets the command come; away from zero by `rise`, towards it by `fall`."""
    if before >= 0.0:
        return min(max(target, before - fall), before + rise)
    return min(max(target, before - rise), before + fall)


@njit(cache=True)
def _follow_all(
    paths: _Paths,
    state: _State,
    robots: IntArray,
    poses: FloatArray,
    speeds: FloatArray,
    stop_s: FloatArray,
    speed_cap: FloatArray,
    g: _Gains,
) -> None:
    """Move cursors and progress of some robots on their paths, and fill in their commands."""
    for i in robots:
        _follow(paths, state, i, poses[i], speeds[i], stop_s[i], speed_cap[i], g)


@njit(cache=True)
def _follow(
    paths: _Paths,
    state: _State,
    i: int,
    pose: FloatArray,
    measured: float,
    stop_s: float,
    speed_cap: float,
    g: _Gains,
) -> None:
    """Move cursor and progress of a robot on its path, and fill in its command."""
    points, s, direction = paths.points[i], paths.s[i], paths.direction[i]
    k, end = paths.cursor[i], paths.n_points[i] - 1
    limits, last_command = g.limits, state.last[i]
    rise, fall, turn = limits.accel * g.tick_s, limits.brake * g.tick_s, limits.yaw_accel * g.tick_s
    if k >= end:  # nothing is ahead
        state.standing[i] = abs(measured) < g.slow_mps
        last_command[0] = _ramped(0.0, last_command[0], rise, fall)
        last_command[1] = _ramped(0.0, last_command[1], turn, turn)
        return
    last = _piece_end(points, direction, k, end)
    if _on_the_spot(points, k):
        _turn(paths, state, i, pose, stop_s, speed_cap, last, g)
        return
    x, y, yaw = pose[0], pose[1], pose[2]
    sign = float(direction[k + 1])

    # Where is the robot on its path? Segments are left only forwards, and never across the end of the piece.
    while True:
        dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        along = ((x - points[k, 0]) * dx + (y - points[k, 1]) * dy) / (dx * dx + dy * dy)
        if along <= 1.0 or k + 1 == last:
            break
        k += 1
    paths.cursor[i] = k
    s_here = s[k] + along * (s[k + 1] - s[k])
    t = min(max(along, 0.0), 1.0)
    path_yaw = points[k, 2] + t * wrapped(points[k + 1, 2] - points[k, 2])
    cos, sin = math.cos(path_yaw), math.sin(path_yaw)
    cross = -(x - points[k, 0] - t * dx) * sin + (y - points[k, 1] - t * dy) * cos
    error = wrapped(yaw - path_yaw)
    state.cross_track[i], state.heading_error[i] = cross, error
    paths.progress[i] = max(paths.progress[i], min(s_here, s[last]))
    stop = min(stop_s, s[last])
    left = stop - s_here
    speed = sign * measured

    if state.standing[i]:
        state.standing[i] = left < (g.braked_restart_m if state.braked[i] else g.restart_m)
    elif left <= g.stop_tolerance_m and abs(speed) < g.slow_mps:
        state.standing[i] = True
    if state.standing[i]:
        last_command[0] = _ramped(0.0, last_command[0], fall, fall)
        last_command[1] = _ramped(0.0, last_command[1], turn, turn)
        if last < end and stop_s > s[last] and last_command[0] == 0.0:
            paths.cursor[i], paths.progress[i] = last, s[last]
            state.standing[i] = False
        return

    # Speed along the path: the most that cap, curves and the stop allow.
    allowed = _curve_speed(points, s, k, last, s_here, min(speed_cap, limits.speed), g)
    brake = g.brake_fraction * limits.brake
    free = left - max(speed, 0.0) * (0.5 * g.tick_s + g.lag_s)
    allowed = min(allowed, max(math.sqrt(max(0.0, 2.0 * brake * free)), 0.0), max(g.approach_per_s * left, 0.0))
    allowed = max(allowed, min(g.creep_mps, speed_cap)) if left > g.stop_tolerance_m else 0.0
    before = max(sign * last_command[0], 0.0)
    target = max(min(allowed, before + rise, max(speed, 0.0) + _SPEED_SLACK_MPS), before - fall, 0.0)

    # Yaw rate: the path's own about where it will work, and the law against errors. Errors count by way, not by time,
    # and in reverse those of place turn the other way.
    half = max(0.5 * abs(speed) ** 2 * _jump(points, s, k, last) / limits.yaw_accel, 0.02)
    middle = s_here + abs(speed) * (g.lag_s + 0.5 * g.tick_s)
    first = k
    while first > 0 and s[first] > s_here - 2.0 * half - 0.02 and not _on_the_spot(points, first - 1):
        if direction[first] != direction[k + 1]:
            break
        first -= 1
    curvature = _yaw_at(points, s, first, last, middle + half) - _yaw_at(points, s, first, last, middle - half)
    rate = curvature / (2.0 * half) * target
    rate -= target * (sign * g.cross_per_m2 * cross + g.heading_per_m * math.sin(error))
    factor = shared(target, rate, limits.yaw_rate, limits.rim, limits.lever)
    target = max(factor * target, before - fall, 0.0)
    rate = _ramped(factor * rate, last_command[1], turn, turn)
    room = max(limits.rim - target, 0.0) / limits.lever
    last_command[0] = sign * target
    last_command[1] = min(max(rate, -room), room)


@njit(cache=True)
def _jump(points: FloatArray, s: FloatArray, k: int, last: int) -> float:
    """Greatest change of curvature from one of the next segments to the following [1/m]."""
    most, before = 0.0, 0.0
    for j in range(max(k - 1, 0), min(k + 12, last)):
        if _on_the_spot(points, j):
            continue
        curvature = wrapped(points[j + 1, 2] - points[j, 2]) / (s[j + 1] - s[j])
        if j > max(k - 1, 0):
            most = max(most, abs(curvature - before))
        before = curvature
    return most


@njit(cache=True)
def _turn(
    paths: _Paths, state: _State, i: int, pose: FloatArray, stop_s: float, speed_cap: float, last: int, g: _Gains
) -> None:
    """Turn on the spot, up to the end of the piece or to a stop in it, and come back to the spot meanwhile."""
    points, s = paths.points[i], paths.s[i]
    k, limits, last_command = paths.cursor[i], g.limits, state.last[i]
    angle = 0.0
    for j in range(k, last):
        angle += wrapped(points[j + 1, 2] - points[j, 2])
    sign = 1.0 if angle >= 0.0 else -1.0
    angle = abs(angle)
    # What is left is told by the yaw at the end; beyond half a turn, by the way round that the path takes.
    left = sign * wrapped(points[last, 2] - pose[2])
    if left < min(angle - 1.75 * math.pi, -0.25 * math.pi):
        left += 2.0 * math.pi
    per_rad = (s[last] - s[k]) / angle
    done = min(max(1.0 - left / angle, 0.0), 1.0)
    state.cross_track[i] = math.hypot(pose[0] - points[k, 0], pose[1] - points[k, 1])
    state.heading_error[i] = 0.0  # all headings are on the way of a turn
    paths.progress[i] = max(paths.progress[i], s[k] + done * (s[last] - s[k]))
    rise, fall, turn = limits.accel * g.tick_s, limits.brake * g.tick_s, limits.yaw_accel * g.tick_s
    ends = stop_s >= s[last]
    if not ends:
        left -= (s[last] - max(stop_s, s[k])) / per_rad
    if left <= g.turn_tolerance_rad:
        last_command[0] = _ramped(0.0, last_command[0], rise, fall)
        last_command[1] = _ramped(0.0, last_command[1], turn, turn)
        if last_command[1] == 0.0 and last_command[0] == 0.0:
            state.standing[i] = not ends
            if ends:
                paths.cursor[i], paths.progress[i] = last, s[last]
        return
    state.standing[i] = False
    ahead = (points[k, 0] - pose[0]) * math.cos(pose[2]) + (points[k, 1] - pose[1]) * math.sin(pose[2])
    most_back = min(g.hold_mps, speed_cap)
    back = min(max(g.hold_per_s * ahead, -most_back), most_back)
    last_command[0] = _ramped(back, last_command[0], rise, fall)
    brake = g.brake_fraction * limits.yaw_accel
    rim = max(min(limits.rim, speed_cap) - abs(last_command[0]), 0.0)
    most = min(limits.yaw_rate, rim / limits.lever)
    free = left - sign * last_command[1] * (g.lag_s + 0.5 * g.tick_s)
    rate = min(most, math.sqrt(max(0.0, 2.0 * brake * free)), max(g.approach_per_s * left, 0.0))
    if left > g.turn_tolerance_rad:
        rate = max(rate, min(g.slow_radps, most))
    last_command[1] = _ramped(sign * rate, last_command[1], turn, turn)
    room = min(limits.yaw_rate, max(limits.rim - abs(last_command[0]), 0.0) / limits.lever)
    last_command[1] = min(max(last_command[1], -room), room)
