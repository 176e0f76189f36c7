"""Pursuit: granted paths as rolling polylines, and the controller that drives cars along them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, CellArray, FloatArray, IntArray, SignArray
from fleet.errors import FleetError
from fleet.robots.angle import wrapped

FIRST_CAPACITY = 192
"""Points a car's buffer starts with: about six moves of the lane graph; it doubles when a path needs more."""
JOIN_TOLERANCE_M = 0.10
"""A new piece of path begins at most this far from the end of the old one [m]."""
BEHIND_M = 0.3
"""Length of path kept behind a car [m]: the follower averages curvature around it."""
ANGLE_EPS_RAD = 1e-9
_FITS, _NOT_ASCENDING, _APART = 0, 1, 2


class PathError(FleetError):
    """A piece of path does not begin where the path ends, or its arc length does not grow."""


class CarNumbers(Protocol):
    """What the follower asks of the models of cars."""

    def __len__(self) -> int: ...

    def each(self, number: str) -> FloatArray:
        """A number of every car's model, shape (n_cars,)."""


class Segments(NamedTuple):
    """The segment that each car is on, copied out of its path: most cars stand, and points are far apart in memory."""

    loaded: BoolArray
    """False where the path has changed since, shape (n_cars,)."""
    start: FloatArray
    """x, y, yaw and arc length of its first point, shape (n_cars, 4)."""
    step: FloatArray
    """The same from there to its last point; 0 at the end of the path, shape (n_cars, 4)."""
    ahead: FloatArray
    """cos and sin of the first point's yaw, and the square of the segment's length, shape (n_cars, 3)."""
    sign: FloatArray
    """+1 forward, -1 reverse, shape (n_cars,)."""
    piece: IntArray
    """Point that ends the piece of path up to the next cusp, or to the end, shape (n_cars,)."""
    piece_s: FloatArray
    """Its arc length, shape (n_cars,)."""


class PathArrays(NamedTuple):
    """The arrays of a `PathBuffer`, as kernels take them."""

    points: FloatArray
    s: FloatArray
    direction: SignArray
    n_points: IntArray
    cursor: IntArray
    progress: FloatArray
    segments: Segments


class Pieces(NamedTuple):
    """Pieces of path that cars are sent along again and again; each is as `PathBuffer.append` takes it."""

    bounds: IntArray
    """Where the points of each piece begin, and the end, shape (n_pieces + 1,)."""
    points: FloatArray
    """Poses x, y, yaw, one piece after the other, shape (k, 3)."""
    s_m: FloatArray
    """Arc length from the first point of the piece [m], shape (k,)."""
    direction: SignArray
    """+1 forward, -1 reverse, shape (n_pieces,)."""


class PathBuffer:
    """The path ahead of every car: one rolling polyline per car, in arrays of common width.

    Arc length is absolute: 0 where the car started, growing for ever, in reverse too. `reset` continues at the
    progress made so far, so a stop distance never points into an older path.

    Attributes:
        points: Rear-axle poses x, y, yaw [m, m, rad] in the world, shape (n_cars, capacity, 3).
        s: Arc length of each point [m], ascending, shape (n_cars, capacity).
        direction: How the car reaches each point from the one before, +1 forward, -1 reverse, shape (n_cars, capacity).
        count: Points in use, shape (n_cars,).
        cursor: Point that begins the segment the car is on, shape (n_cars,); moved by the follower.
        progress: Arc length reached so far [m], shape (n_cars,); moved by the follower.

    Args:
        n_cars: Number of cars; every path starts as the single pose (0, 0, 0) until `reset`.
    """

    def __init__(self, n_cars: int) -> None:
        self.points = np.zeros((n_cars, FIRST_CAPACITY, 3))
        self.s = np.zeros((n_cars, FIRST_CAPACITY))
        self.direction = np.ones((n_cars, FIRST_CAPACITY), dtype=np.int8)
        self.count = np.ones(n_cars, dtype=np.int64)
        self.cursor = np.zeros(n_cars, dtype=np.int64)
        self.progress = np.zeros(n_cars)
        self._segments = Segments(
            loaded=np.zeros(n_cars, dtype=np.bool_),
            start=np.zeros((n_cars, 4)),
            step=np.zeros((n_cars, 4)),
            ahead=np.zeros((n_cars, 3)),
            sign=np.zeros(n_cars),
            piece=np.zeros(n_cars, dtype=np.int64),
            piece_s=np.zeros(n_cars),
        )

    def arrays(self) -> PathArrays:
        """All arrays as they are now; `append` may replace them."""
        return PathArrays(self.points, self.s, self.direction, self.count, self.cursor, self.progress, self._segments)

    def reset(self, car: int, pose: FloatArray) -> None:
        """Forget a car's path; the new one is the single pose x, y, yaw at the arc length reached so far."""
        self.points[car, 0] = pose
        self.s[car, 0] = self.progress[car]
        self.direction[car, 0] = 1
        self.count[car] = 1
        self.cursor[car] = 0
        self._segments.loaded[car] = False

    def append(self, car: int, points: FloatArray, s_m: FloatArray, direction: int = 1) -> None:
        """Extend a car's path.

        The first point stands for the present end of the path, which stays as it is.

        Args:
            car: Index of the car.
            points: Poses x, y, yaw, shape (k, 3); yaw is where the car's nose points, also in reverse.
            s_m: Arc length from the first point [m], strictly ascending from 0, shape (k,).
            direction: +1 forward, -1 reverse. A change of direction is a cusp: the car stands there for a moment.

        Raises:
            PathError: The piece begins more than `JOIN_TOLERANCE_M` from the end of the path, or `s_m` does not ascend
                from 0.
        """
        if self.points.shape[1] < self.count[car] + len(points) - 1:
            self.trim(car)
            self._reserve(int(self.count[car]) + len(points) - 1)
        verdict = _append(self.arrays(), car, points, s_m, direction)
        if verdict == _NOT_ASCENDING:
            raise PathError(f"path of car {car}: arc length of a new piece is {s_m.tolist()}; valid: ascending from 0")
        if verdict == _APART:
            end = self.points[car, self.count[car] - 1]
            gap = math.hypot(points[0, 0] - end[0], points[0, 1] - end[1])
            raise PathError(
                f"path of car {car} ends at ({end[0]:.3f}, {end[1]:.3f}) m but its next piece begins {gap:.3f} m away; "
                f"valid: at most {JOIN_TOLERANCE_M} m"
            )

    def append_all(self, cars: CellArray, pieces: Pieces, numbers: CellArray) -> FloatArray:
        """Extend paths by known pieces, each in turn, and drop what these cars have left well behind.

        Args:
            cars: Indices of the cars, shape (n,); one may stand there more than once.
            pieces: The known pieces.
            numbers: Which piece each of them gets, shape (n,).

        Returns:
            Arc length at the end of the path behind each new piece [m], shape (n,).

        Raises:
            PathError: As in `append`; the pieces before are appended.
        """
        ends = np.empty(len(cars))
        done = _append_all(self.arrays(), cars, pieces, numbers, 0, ends)
        while done < len(cars):
            # One that does not fit is appended by itself: that makes room, or says what is wrong.
            car, number = int(cars[done]), int(numbers[done])
            part = slice(pieces.bounds[number], pieces.bounds[number + 1])
            self.append(car, pieces.points[part], pieces.s_m[part], int(pieces.direction[number]))
            ends[done] = self.end_s(car)
            done = _append_all(self.arrays(), cars, pieces, numbers, done + 1, ends)
        return ends

    def trim(self, car: int) -> None:
        """Drop the points a car has left well behind; `append` does so by itself when it needs the room."""
        _trim(self.arrays(), car)

    def end_s(self, car: int) -> float:
        """Arc length at the end of a car's path [m]."""
        return float(self.s[car, self.count[car] - 1])

    def _reserve(self, n_points: int) -> None:
        capacity = self.points.shape[1]
        if n_points <= capacity:
            return
        extra = max(2 * capacity, n_points) - capacity
        self.points = np.pad(self.points, ((0, 0), (0, extra), (0, 0)))
        self.s = np.pad(self.s, ((0, 0), (0, extra)))
        self.direction = np.pad(self.direction, ((0, 0), (0, extra)), constant_values=1)


@dataclass(frozen=True, kw_only=True)
class FollowerConfig:
    """Gains of the path follower."""

    lookahead_min_m: float = 0.22
    lookahead_base_m: float = 0.1
    lookahead_per_speed_s: float = 0.25
    """Look-ahead is max(lookahead_min_m, lookahead_base_m + lookahead_per_speed_s * speed): measured on the physical
    car to follow arcs of 0.4 m radius within 1.5 cm at 1 m/s, noise of the estimate included."""
    feedforward_lag_s: float = 0.03
    """Delay between a steering command and the front wheels, by which the path's own curvature is taken ahead [s]:
    measured on the physical car, where 0 and 0.06 s track half as well."""
    jump_window_m: float = 0.1
    """Way over which a car may spread what its steering is too slow for where curvature jumps [m]."""
    max_lateral_mps2: float = 2.6
    """Sideways acceleration in curves [m/s^2]: 1.02 m/s on an arc of 0.4 m radius."""
    brake_fraction: float = 0.6
    """Share of the car's braking that planned stops use; the rest corrects what went wrong."""
    actuator_lag_s: float = 0.02
    """Delay assumed between a speed command and the wheels [s]."""
    approach_per_s: float = 4.0
    """Speed per metre left before a stop, which replaces hard braking in the last centimetres [1/s]."""
    creep_mps: float = 0.02
    """Least speed until the stop is reached [m/s]."""
    stop_tolerance_m: float = 0.0015
    """A car this close to its stop, or past it, stands."""
    restart_m: float = 0.02
    """A standing car ignores a stop nearer than this [m], so that noise does not wake it."""
    braked_restart_m: float = 0.2
    """One that has its brake on ignores a stop nearer than this [m]: a burst of noise does not wake it either, and a
    push that is more than that takes it off its lane."""


class _Limits(NamedTuple):
    """What one car can do."""

    wheelbase_m: float
    max_speed_mps: float
    max_accel_mps2: float
    max_brake_mps2: float
    max_steering_rad: float
    max_steering_rate_radps: float
    steering_ramp_s: float
    """From straight ahead to the lock."""


class _Gains(NamedTuple):
    tick_s: float
    lookahead_min_m: float
    lookahead_base_m: float
    lookahead_per_speed_s: float
    feedforward_lag_s: float
    jump_window_m: float
    max_lateral_mps2: float
    brake_fraction: float
    actuator_lag_s: float
    approach_per_s: float
    creep_mps: float
    stop_tolerance_m: float
    restart_m: float
    braked_restart_m: float


class _Following(NamedTuple):
    """What the follower keeps of every car."""

    last: FloatArray
    """The last command: steering [rad] and signed speed [m/s], shape (n_cars, 2)."""
    cross_track: FloatArray
    heading_error: FloatArray
    standing: BoolArray
    braked: BoolArray


SPEED_SLACK_MPS = 0.3
"""Commands run at most this far ahead of the measured speed, so that a blocked car does not wind up [m/s]."""
SLOW_MPS = 0.06
"""Below this speed a car may be told to stand at its stop [m/s]."""


class Follower:
    """Drives all cars along their paths: pure pursuit for steering, a braking-distance profile for speed.

    Pursuit alone cuts every corner by the look-ahead (4 cm at 1 m/s on a 0.4 m radius). So it only corrects here: a
    car that is on its path steers by the path's curvature, taken ahead by what the steering needs to answer.

    Speed obeys, at every point ahead, the cap, the sideways acceleration on the path's curvature, the steering rate
    where curvature changes, and braking to the nearest of `stop_s`, the end of the path and the next cusp. At its
    stop a car gets exactly 0 m/s until the stop moves on.

    Attributes:
        progress: Arc length reached [m]; never decreases, shape (n_cars,).
        cross_track: Signed distance to the path, positive = car left of it as the nose points [m], shape (n_cars,).
        heading_error: Estimated yaw minus the path's yaw [rad] in [-pi, pi], shape (n_cars,).
        standing: True where the car was told to stand at its stop, shape (n_cars,).
        braked: True where a standing car has its brake on: little that is measured wakes it, shape (n_cars,).

    Args:
        models: Models of the cars.
        tick_s: Control period [s].
        config: Gains.
        cars: Which of them are driven; None = all. Others' rows stay as they are.

    Source: R. C. Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992.
    """

    def __init__(
        self, models: CarNumbers, tick_s: float, config: FollowerConfig | None = None, cars: IntArray | None = None
    ) -> None:
        config, n_cars = config or FollowerConfig(), len(models)
        self._cars = np.arange(n_cars) if cars is None else cars
        self.progress = np.zeros(n_cars)
        self.cross_track = np.zeros(n_cars)
        self.heading_error = np.zeros(n_cars)
        self.standing = np.ones(n_cars, dtype=np.bool_)
        self._last = np.zeros((n_cars, 2))
        self.braked = np.zeros(n_cars, dtype=np.bool_)
        self._following = _Following(self._last, self.cross_track, self.heading_error, self.standing, self.braked)
        self._gains = _Gains(
            tick_s=tick_s,
            lookahead_min_m=config.lookahead_min_m,
            lookahead_base_m=config.lookahead_base_m,
            lookahead_per_speed_s=config.lookahead_per_speed_s,
            feedforward_lag_s=config.feedforward_lag_s,
            jump_window_m=config.jump_window_m,
            max_lateral_mps2=config.max_lateral_mps2,
            brake_fraction=config.brake_fraction,
            actuator_lag_s=config.actuator_lag_s,
            approach_per_s=config.approach_per_s,
            creep_mps=config.creep_mps,
            stop_tolerance_m=config.stop_tolerance_m,
            restart_m=config.restart_m,
            braked_restart_m=config.braked_restart_m,
        )
        limits = [models.each(name) for name in _Limits._fields[:-1]]
        ramp_s, own = np.zeros(n_cars), self._cars
        ramp_s[own] = models.each("max_steering_rad")[own] / models.each("max_steering_rate_radps")[own]
        self._limits = np.stack((*limits, ramp_s), axis=1)

    def brake(self, car: int, on: bool) -> None:
        """Let a car that stands at its stop have its brake on, or off again."""
        self.braked[car] = on

    def reset(self, car: int) -> None:
        """Forget how a car moved; call it together with `PathBuffer.reset`."""
        self.cross_track[car] = 0.0
        self.heading_error[car] = 0.0
        self.standing[car] = False
        self._last[car, 1] = 0.0

    def commands(
        self, paths: PathBuffer, poses: FloatArray, speeds: FloatArray, stop_s: FloatArray, speed_cap: FloatArray
    ) -> FloatArray:
        """Say what every car does this tick.

        Args:
            paths: Paths ahead; cursor and progress in it move on.
            poses: Estimated rear-axle poses x, y, yaw, shape (n_cars, 3).
            speeds: Measured signed forward speeds [m/s], shape (n_cars,).
            stop_s: Arc length where each car must stand [m], shape (n_cars,).
            speed_cap: Greatest speed [m/s], >= 0, shape (n_cars,).

        Returns:
            Steering [rad] and signed speed [m/s], shape (n_cars, 2).
        """
        state = paths.arrays(), self._following
        _follow(*state, self._cars, poses, speeds, stop_s, speed_cap, self._limits, self._gains)
        self.progress[:] = paths.progress
        return self._last.copy()


@njit(cache=True)
def any_beyond(first: FloatArray, first_limit: float, second: FloatArray, second_limit: float) -> bool:
    """Whether an entry of one of two arrays of one length is beyond its limit, on either side."""
    for k in range(len(first)):  # noqa: SIM110 - numba has no generators in any()
        if abs(first[k]) > first_limit or abs(second[k]) > second_limit:
            return True
    return False


@njit(cache=True)
def _append(path: PathArrays, car: int, new_points: FloatArray, new_s: FloatArray, new_direction: int) -> int:
    """Write a piece behind a car's path, which has room for it; a piece that does not fit changes nothing."""
    points, s, direction, count, _, _, segments = path
    last = count[car] - 1
    if new_s[0] != 0.0:
        return _NOT_ASCENDING
    for k in range(1, len(new_s)):
        if not new_s[k] - new_s[k - 1] > 0.0:
            return _NOT_ASCENDING
    gap = math.hypot(new_points[0, 0] - points[car, last, 0], new_points[0, 1] - points[car, last, 1])
    if gap > JOIN_TOLERANCE_M:
        return _APART
    for k in range(1, len(new_points)):
        for axis in range(3):
            points[car, last + k, axis] = new_points[k, axis]
        s[car, last + k] = s[car, last] + new_s[k]
        direction[car, last + k] = new_direction
    count[car] = last + len(new_points)
    segments.loaded[car] = False
    return _FITS


@njit(cache=True)
def _append_all(
    path: PathArrays, cars: CellArray, pieces: Pieces, numbers: CellArray, begin: int, ends: FloatArray
) -> int:
    """Trim and extend paths from entry `begin` on, and fill in where they end; returns the first that does not fit."""
    for k in range(begin, len(cars)):
        car, number = cars[k], numbers[k]
        first, end = pieces.bounds[number], pieces.bounds[number + 1]
        _trim(path, car)
        if path.n_points[car] + end - first - 1 > path.s.shape[1]:
            return k
        if _append(path, car, pieces.points[first:end], pieces.s_m[first:end], pieces.direction[number]) != _FITS:
            return k
        ends[k] = path.s[car, path.n_points[car] - 1]
    return len(cars)


@njit(cache=True)
def _trim(path: PathArrays, car: int) -> None:
    """Move a car's points to the front of its buffer, without those it has left well behind."""
    points, s, direction, count, cursor, progress, segments = path
    first = 0
    while first < cursor[car] and s[car, first + 1] <= progress[car] - BEHIND_M:
        first += 1
    if first == 0:
        return
    for k in range(first, count[car]):
        for axis in range(3):
            points[car, k - first, axis] = points[car, k, axis]
        s[car, k - first] = s[car, k]
        direction[car, k - first] = direction[car, k]
    count[car] -= first
    cursor[car] -= first
    segments.loaded[car] = False


@njit(cache=True)
def _load_segment(path: PathArrays, car: int) -> None:
    """Copy the segment that a car is on out of its path."""
    points, s, direction, count, cursor, _, segments = path
    start, step, ahead = segments.start, segments.step, segments.ahead
    k = cursor[car]
    to = min(k + 1, count[car] - 1)
    for axis in range(3):
        start[car, axis] = points[car, k, axis]
        step[car, axis] = points[car, to, axis] - points[car, k, axis]
    start[car, 3] = s[car, k]
    step[car, 2] = wrapped(step[car, 2])
    step[car, 3] = s[car, to] - s[car, k]
    ahead[car, 0], ahead[car, 1] = math.cos(start[car, 2]), math.sin(start[car, 2])
    ahead[car, 2] = max(step[car, 0] * step[car, 0] + step[car, 1] * step[car, 1], 1e-12)
    segments.sign[car] = direction[car, to]


@njit(cache=True)
def _load_piece(path: PathArrays, car: int) -> None:
    """Find where the piece of path ends that a car is on, and copy its segment."""
    _, s, direction, count, cursor, _, segments = path
    end = count[car] - 1
    piece = min(cursor[car] + 1, end)
    while piece < end and direction[car, piece + 1] == direction[car, piece]:
        piece += 1
    segments.piece[car], segments.piece_s[car] = piece, s[car, piece]
    _load_segment(path, car)
    segments.loaded[car] = True


@njit(cache=True)
def _aim(points: FloatArray, s: FloatArray, direction: float, last: int, k: int, s_aim: float) -> tuple[float, float]:
    """Point of the path at arc length `s_aim` from segment `k` on; beyond `last` straight on along its yaw."""
    while k + 1 < last and s[k + 1] < s_aim:
        k += 1
    if k + 1 > last or s[last] < s_aim:
        ahead = direction * (s_aim - s[last])
        return points[last, 0] + ahead * math.cos(points[last, 2]), points[last, 1] + ahead * math.sin(points[last, 2])
    t = (s_aim - s[k]) / (s[k + 1] - s[k])
    return points[k, 0] + t * (points[k + 1, 0] - points[k, 0]), points[k, 1] + t * (points[k + 1, 1] - points[k, 1])


@njit(cache=True)
def _yaw_at(points: FloatArray, s: FloatArray, first: int, last: int, k: int, s_at: float) -> float:
    """Yaw of the path at arc length `s_at`, searched from segment `k`, constant outside points `first` to `last`."""
    if s_at <= s[first]:
        return points[first, 2]
    if s_at >= s[last]:
        return points[last, 2]
    while s[k] > s_at:
        k -= 1
    while s[k + 1] < s_at:
        k += 1
    return points[k, 2] + (s_at - s[k]) / (s[k + 1] - s[k]) * wrapped(points[k + 1, 2] - points[k, 2])


@njit(cache=True)
def _pursuit(x: float, y: float, yaw: float, aim_x: float, aim_y: float) -> float:
    """Curvature of the circle through (x, y), tangent to `yaw`, that hits the aim; the same in reverse."""
    left = -(aim_x - x) * math.sin(yaw) + (aim_y - y) * math.cos(yaw)
    return 2.0 * left / max((aim_x - x) ** 2 + (aim_y - y) ** 2, 1e-6)


@njit(cache=True)
def _curve_speed(
    points: FloatArray,
    s: FloatArray,
    last: int,
    k: int,
    s_here: float,
    speed: float,
    brake: float,
    car: _Limits,
    g: _Gains,
) -> float:
    """Greatest speed now from which all curvature limits ahead, up to point `last`, can be met."""
    horizon = s_here + speed * speed / (2.0 * brake) + 2.0 * speed * g.tick_s + 0.1
    steering = 0.0
    for j in range(k, last):
        if s[j] > horizon:
            break
        curvature = wrapped(points[j + 1, 2] - points[j, 2]) / (s[j + 1] - s[j])
        limit = car.max_speed_mps
        if abs(curvature) > ANGLE_EPS_RAD:
            limit = math.sqrt(g.max_lateral_mps2 / abs(curvature))
        previous, steering = steering, math.atan(car.wheelbase_m * curvature)
        jump = abs(steering - previous)
        if j > k and jump > ANGLE_EPS_RAD:
            slow_s = jump / car.max_steering_rate_radps - car.steering_ramp_s
            if slow_s > 0.0:
                limit = min(limit, g.jump_window_m / slow_s)
        speed = min(speed, math.sqrt(limit * limit + 2.0 * brake * max(0.0, s[j] - s_here)))
    return speed


@njit(cache=True)
def _follow(
    path: PathArrays,
    following: _Following,
    cars: IntArray,
    poses: FloatArray,
    speeds: FloatArray,
    stop_s: FloatArray,
    speed_cap: FloatArray,
    limits: FloatArray,
    g: _Gains,
) -> None:
    """Move cursor and progress of every car on its path, and fill in its command."""
    points, s, direction, count, cursor, progress, segments = path
    start, step, ahead = segments.start, segments.step, segments.ahead
    last_command, cross_track, heading_error, standing, braked = following
    for i in cars:
        if not segments.loaded[i]:
            _load_piece(path, i)
        x, y, yaw = poses[i, 0], poses[i, 1], poses[i, 2]
        sign, piece, piece_s = segments.sign[i], segments.piece[i], segments.piece_s[i]

        # Where is the car on its path? Segments are left only forwards, and never across a cusp.
        along = 0.0
        while cursor[i] < piece:
            along = ((x - start[i, 0]) * step[i, 0] + (y - start[i, 1]) * step[i, 1]) / ahead[i, 2]
            if along <= 1.0 or cursor[i] + 1 == piece:
                break
            cursor[i] += 1
            _load_segment(path, i)
        k = cursor[i]
        path_x, path_y, path_yaw, cos, sin = start[i, 0], start[i, 1], start[i, 2], ahead[i, 0], ahead[i, 1]
        if k < piece:
            s_here = start[i, 3] + along * step[i, 3]
            t = min(max(along, 0.0), 1.0)
            path_x += t * step[i, 0]
            path_y += t * step[i, 1]
            if step[i, 2] != 0.0:
                path_yaw += t * step[i, 2]
                cos, sin = math.cos(path_yaw), math.sin(path_yaw)
        else:
            s_here = start[i, 3] + sign * ((x - path_x) * cos + (y - path_y) * sin)
        cross_track[i] = -(x - path_x) * sin + (y - path_y) * cos
        heading_error[i] = wrapped(yaw - path_yaw)

        progress[i] = max(progress[i], min(s_here, piece_s))
        stop = min(stop_s[i], piece_s)
        left = stop - s_here
        speed = sign * speeds[i]

        # Standing: the true car must be slow, and only a stop that is farther on ends it.
        if standing[i]:
            standing[i] = left < (g.braked_restart_m if braked[i] else g.restart_m)
        elif left <= g.stop_tolerance_m and abs(speed) < SLOW_MPS:
            standing[i] = True
        if standing[i] and piece < count[i] - 1 and stop_s[i] > piece_s and left <= g.restart_m:
            cursor[i] = piece
            progress[i] = piece_s
            segments.loaded[i] = False
            standing[i] = False
            last_command[i, 1] = 0.0
            continue
        if standing[i]:
            last_command[i, 1] = 0.0
            continue

        car = _Limits(limits[i, 0], limits[i, 1], limits[i, 2], limits[i, 3], limits[i, 4], limits[i, 5], limits[i, 6])
        # Speed along the path: the most that cap, curves, the stop and the drive allow.
        line, line_s = points[i], s[i]
        brake = g.brake_fraction * car.max_brake_mps2
        allowed = _curve_speed(line, line_s, piece, k, s_here, min(speed_cap[i], car.max_speed_mps), brake, car, g)
        # Distance still free when this command has worked for a tick: v^2 / 2b + (v + now) tick / 2 = left.
        free = left - max(speed, 0.0) * (0.5 * g.tick_s + g.actuator_lag_s)
        reserve = 0.5 * brake * g.tick_s
        braking = math.sqrt(max(0.0, reserve * reserve + 2.0 * brake * free)) - reserve
        stopping = min(braking, g.approach_per_s * left)
        allowed = min(allowed, max(stopping, min(g.creep_mps, left / g.tick_s)))
        if left <= g.stop_tolerance_m:
            allowed = 0.0
        before = min(max(sign * last_command[i, 1], speed - SPEED_SLACK_MPS), speed + SPEED_SLACK_MPS)
        target = min(allowed, before + car.max_accel_mps2 * g.tick_s)
        target = max(target, before - car.max_brake_mps2 * g.tick_s, 0.0)
        last_command[i, 1] = sign * target

        # Steering: the path's own curvature about where the wheels will answer, spread over the time they need from
        # straight to full lock, plus what pursuit from here adds to pursuit from the path.
        first = k
        while first > 0 and direction[i, first] == direction[i, k + 1] and s[i, first] > s_here - BEHIND_M:
            first -= 1
        half = max(0.5 * car.steering_ramp_s * abs(speed), 0.02)
        middle = s_here + abs(speed) * (g.feedforward_lag_s + 0.5 * g.tick_s)
        curvature = _yaw_at(line, line_s, first, piece, k, middle + half)
        curvature = wrapped(curvature - _yaw_at(line, line_s, first, piece, k, middle - half)) / (2.0 * half * sign)
        reach = max(g.lookahead_min_m, g.lookahead_base_m + g.lookahead_per_speed_s * abs(speed))
        aim_x, aim_y = _aim(line, line_s, sign, piece, k, s_here + reach)
        curvature += _pursuit(x, y, yaw, aim_x, aim_y) - _pursuit(path_x, path_y, path_yaw, aim_x, aim_y)
        steering = math.atan(car.wheelbase_m * curvature)
        steering = min(max(steering, -car.max_steering_rad), car.max_steering_rad)
        turn = car.max_steering_rate_radps * g.tick_s
        last_command[i, 0] = min(max(steering, last_command[i, 0] - turn), last_command[i, 0] + turn)
