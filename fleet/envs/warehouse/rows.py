"""Rows: kernels that fill the observations of all agents of a type (layout: see `fleet.envs.warehouse.env`).

What they are handed comes in named parts. Array by array a call would be 3 to 4 us shorter, of the 600 us that a
kinematic step of five agents takes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.envs.warehouse.run.agent_driver import AT_REST_RADPS
from fleet.robots.angle import yaw_of
from fleet.traffic.drivers import AT_REST_MPS
from planners.motion.arm.kinematics import link_frames_into

WAY_POINTS_M = (0.4, 0.8, 1.2, 2.0)
"""Distances ahead, along the route, at which a car is told where to go [m]."""
NEAR_M = 3.0
"""Range of the offsets to way-points and to other cars [m]."""
N_NEIGHBOURS = 3
"""Other cars that a car is told about, nearest first."""
REACH_M = 1.5
"""Range of the offsets in an arm's base frame [m]: an arm with its tool reaches 1.1 m."""
EDGE_M = 0.1
"""Greatest edge of a parcel [m]."""
MOST_ROUTE_POINTS = 512
"""Most points of a route: a dozen moves of up to 40."""
OTHERS_MPS = 2.0
"""Range of the speeds of other cars [m/s]."""
STOP_M = 1.0
"""Range of the offset to the pose at which a car is to stop [m]."""
CLOSE_M = 0.1
"""Range of an arm's offsets to what it is close to [m]."""
SERVICE_S, HELD_S = 30.0, 10.0
"""A transfer, and a parcel in the grip, are told how long they have lasted, up to this [s]."""
N_JOINTS = 7
"""Most joints of an arm that agents move; entries of joints that an arm does not have are zero."""
N_ARM_ENTRIES = N_JOINTS + 1
"""Most entries of an arm's action."""

_WAY_AT, NEIGHBOURS_AT = 19, 19 + 2 * len(WAY_POINTS_M)
N_PER_NEIGHBOUR = 8
STATION_AT = NEIGHBOURS_AT + N_PER_NEIGHBOUR * N_NEIGHBOURS
"""First entry of a car's station: whether there is one, and if its arm is at home, serves this car, and has another
car in its dock."""
STOP_AT = STATION_AT + 4
"""First entry of the offset to the stop pose."""
_DOING_AT = STOP_AT + 3
N_CAR_NUMBERS = _DOING_AT + 6
"""Numbers in a car's observation, without lidar."""
AROUND_AT = 37
"""First entry of an arm's offsets in cylinder coordinates: to the parcel, and from there to its place."""
CLOSE_AT = AROUND_AT + 6
"""First entry of the same offsets when they are small."""
YAW_AT = CLOSE_AT + 6
"""First entry of the yaws: of the parcel from the tool, and of its place from the parcel."""
GRIP_AT = YAW_AT + 4
"""First entry of what the grip does."""
N_ARM_NUMBERS = GRIP_AT + 6 + N_ARM_ENTRIES
"""Numbers in an arm's observation."""
_BEFORE_RAD = 2.6
"""Farther from straight behind the base than this something lies before it [rad]."""
_WAYS = np.array(WAY_POINTS_M)
_DOCK_M = 0.6
"""Nearer to the stop pose than this a car is in the dock [m]."""


Rows = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Int64Array = npt.NDArray[np.int64]


class CarGround(NamedTuple):
    """What never changes for cars."""

    limits: FloatArray
    """Greatest speed [m/s], and steering angle [rad] or yaw rate [rad/s], of each car, shape (n_cars, 2)."""
    steers: Bools
    """False for cars that are told a yaw rate, shape (n_cars,)."""
    size_m: FloatArray
    """Of the floor, shape (2,)."""
    state_pose: FloatArray
    """Poses of the lane graph's states, shape (n_states, 3)."""
    docks: FloatArray
    """Stop poses of each car in the stations' docks, shape (n_cars, n_stations, 3)."""
    mission_of: Int64Array
    """Which of the missions a phase is, -1 = none, shape (n_phases,)."""


class CarsNow(NamedTuple):
    """What cars are doing; one entry per car, agents' cars first."""

    poses: FloatArray
    """Where they are believed to be, x, y, yaw, shape (n_cars, 3)."""
    speeds: FloatArray
    steering: FloatArray
    """Or yaw rates, as each is told."""
    goals: npt.NDArray[np.int32]
    """Lane-graph state, negative = nowhere."""
    phases: Int64Array
    loaded: Int64Array
    place_of: npt.NDArray[np.integer]
    """The place that is booked, negative = none."""


class CarsDoing(NamedTuple):
    """What agents' cars were told last, and how long they have been at it."""

    actions: FloatArray
    """Shape (n_agent_cars, 2)."""
    service_s: FloatArray
    """How long each has been served [s], shape (n_agent_cars,)."""
    in_order: Bools
    """False for a car that does not do what it is told, shape (n_agent_cars,)."""
    time_left: float
    """Share of the episode's steps that is left."""
    sight_m: float
    """Other cars are seen up to this distance [m]."""


class Routes(NamedTuple):
    """Where agents' cars are to drive."""

    points: FloatArray
    """x, y and distance along the route [m], shape (n_agent_cars, MOST_ROUTE_POINTS, 3)."""
    counts: Int64Array
    """Points in use, shape (n_agent_cars,)."""
    granted_m: FloatArray
    """How much of the route is granted [m], shape (n_agent_cars,)."""


class ArmsAtWork(NamedTuple):
    """What arms do at their stations; one entry per station."""

    idle: Bools
    served: Int64Array
    """Car that an arm works for, -1 = none."""


class ArmGround(NamedTuple):
    """What never changes for arms."""

    n_joints: Int64Array
    """Of each arm, shape (n_arms,); other arrays are as wide as the most joints."""
    lower: FloatArray
    upper: FloatArray
    max_velocity: FloatArray
    """Limits of the joints, shape (n_arms, width)."""
    joints: FloatArray
    """The arms' joints as `link_frames_into` takes them, shape (n_arms, width, 3, 4)."""
    turning: FloatArray
    """1 for joints that turn the arm about its base, else 0, shape (n_arms, width)."""
    is_ahead: Bools
    """Whether the arm faces ahead where these are zero, so that it goes around by there, shape (n_arms,)."""
    tool_length_m: FloatArray
    """Shape (n_arms,)."""
    base: FloatArray
    """Feet of the arms, x, y, z, yaw, shape (n_arms, 4)."""


class ArmsNow(NamedTuple):
    """What agents' arms are doing."""

    q: FloatArray
    qd: FloatArray
    """Joint positions [rad] and velocities [rad/s], shape (n_agent_arms, width)."""
    held: npt.NDArray[np.integer]
    """Parcel in each grip, -1 = none."""
    transfers: FloatArray
    """Parcel or -1, x, y, z and yaw of its place, and direction, shape (n_agent_arms, 6)."""


class ArmsDoing(NamedTuple):
    """What agents' arms were told last, and how long they have been at it."""

    actions: FloatArray
    """Shape (n_agent_arms, n_entries)."""
    closed: Bools
    """Whether each grip holds what it gets hold of, shape (n_agent_arms,)."""
    opening: FloatArray
    """How much of the time has passed for which a grip has to be told to open, shape (n_agent_arms,)."""
    held_s: FloatArray
    """How long each has had its parcel in the grip [s], shape (n_agent_arms,)."""
    service_s: FloatArray
    """How long its transfer has gone on [s], shape (n_agent_arms,)."""
    time_left: float
    """Share of the episode's steps that is left."""
    sight_m: float
    """Cars and parcels are seen up to this distance [m]."""


class ParcelsNow(NamedTuple):
    """Parcels in the world."""

    ids: npt.NDArray[np.integer]
    poses: FloatArray
    """Shape (n_parcels, 7)."""
    sizes: FloatArray
    """Edges [m], shape (n_parcels, 3)."""


@njit(cache=True)
def bounded(row: Rows) -> None:  # pragma: no cover - compiled
    """Cut a row to [-1, 1]."""
    for k in range(len(row)):
        row[k] = min(max(row[k], np.float32(-1.0)), np.float32(1.0))


@njit(cache=True)
def _on_route(
    line: FloatArray, n: int, x: float, y: float, granted: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Distance along a route of the point nearest to (x, y), and the offset to its left there and its direction.

    Only what is granted is looked at. Before the beginning and beyond the end the route goes on straight.
    """
    best, at, left, yaw = math.inf, 0.0, 0.0, 0.0
    for k in range(n - 1):
        dx, dy = line[k + 1, 0] - line[k, 0], line[k + 1, 1] - line[k, 1]
        length = math.hypot(dx, dy)
        if length < 1e-9:
            continue
        last = line[k + 1, 2] >= granted - 1e-9
        cos, sin = dx / length, dy / length
        along = cos * (x - line[k, 0]) + sin * (y - line[k, 1])
        across = cos * (y - line[k, 1]) - sin * (x - line[k, 0])
        low = -math.inf if k == 0 else 0.0
        high = math.inf if last else length
        stays = min(max(along, low), high)
        gap = math.hypot(along - stays, across)
        if gap < best:
            best, at, left, yaw = gap, line[k, 2] + stays, across, math.atan2(sin, cos)
        if last:
            break
    return at, left, yaw


@njit(cache=True)
def _point_at(line: FloatArray, n: int, s: float, k: int) -> tuple[float, float, int]:  # pragma: no cover - compiled
    """Point of a route at a distance along it, at most its end; `k` is where the search begins, and is returned."""
    while k < n - 2 and line[k + 1, 2] < s:
        k += 1
    span = line[k + 1, 2] - line[k, 2]
    t = min(max((s - line[k, 2]) / span, 0.0), 1.0) if span > 0.0 else 1.0
    return line[k, 0] + t * (line[k + 1, 0] - line[k, 0]), line[k, 1] + t * (line[k + 1, 1] - line[k, 1]), k


@njit(cache=True)
def car_rows(
    rows: Rows, ground: CarGround, cars: CarsNow, routes: Routes, arms: ArmsAtWork, doing: CarsDoing
) -> None:  # pragma: no cover - compiled
    """Fill the first N_CAR_NUMBERS entries of the rows of the first `len(rows)` cars."""
    poses, limits, size, docks = cars.poses, ground.limits, ground.size_m, ground.docks
    diagonal = math.hypot(size[0], size[1])
    gaps = np.empty(len(poses))
    for car in range(len(rows)):
        row = rows[car, :N_CAR_NUMBERS]
        row[:] = 0.0
        x, y, yaw = poses[car]
        cos, sin = math.cos(yaw), math.sin(yaw)
        row[0], row[1] = 2.0 * x / size[0] - 1.0, 2.0 * y / size[1] - 1.0
        row[2], row[3] = cos, sin
        row[4], row[5] = cars.speeds[car] / limits[car, 0], cars.steering[car] / limits[car, 1]
        row[8] = 1.0
        if cars.goals[car] >= 0:
            goal = ground.state_pose[cars.goals[car]]
            dx, dy, turn = goal[0] - x, goal[1] - y, goal[2] - yaw
            row[6], row[7] = (cos * dx + sin * dy) / diagonal, (cos * dy - sin * dx) / diagonal
            row[8], row[9] = math.cos(turn), math.sin(turn)
            cos_g, sin_g = math.cos(goal[2]), math.sin(goal[2])
            row[STOP_AT] = (cos_g * dx + sin_g * dy) / STOP_M
            row[STOP_AT + 1] = (cos_g * dy - sin_g * dx) / STOP_M
            row[STOP_AT + 2] = math.atan2(math.sin(turn), math.cos(turn))
        mission = ground.mission_of[cars.phases[car]]
        if mission >= 0:
            row[10 + mission] = 1.0
        row[14] = cars.loaded[car]

        line, n, granted = routes.points[car], routes.counts[car], routes.granted_m[car]
        at, left, way = _on_route(line, n, x, y, granted)
        row[15] = (granted - at) / NEAR_M
        row[16] = left
        row[17], row[18] = math.cos(way - yaw), math.sin(way - yaw)
        k = 0
        for p in range(len(_WAYS)):
            px, py, k = _point_at(line, n, max(at, 0.0) + _WAYS[p], k)
            dx, dy = px - x, py - y
            row[_WAY_AT + 2 * p] = (cos * dx + sin * dy) / NEAR_M
            row[_WAY_AT + 2 * p + 1] = (cos * dy - sin * dx) / NEAR_M

        for other in range(len(poses)):
            gaps[other] = math.hypot(poses[other, 0] - x, poses[other, 1] - y) if other != car else math.inf
        for place in range(N_NEIGHBOURS):
            other = int(np.argmin(gaps))
            if gaps[other] >= min(NEAR_M, doing.sight_m):
                break
            gaps[other] = math.inf
            dx, dy, turn = poses[other, 0] - x, poses[other, 1] - y, poses[other, 2] - yaw
            first = NEIGHBOURS_AT + N_PER_NEIGHBOUR * place
            row[first] = 1.0
            row[first + 1], row[first + 2] = (cos * dx + sin * dy) / NEAR_M, (cos * dy - sin * dx) / NEAR_M
            row[first + 3], row[first + 4] = math.cos(turn), math.sin(turn)
            row[first + 5] = cars.speeds[other] / OTHERS_MPS
            if cars.goals[other] >= 0:
                goal = ground.state_pose[cars.goals[other]]
                dx, dy = goal[0] - x, goal[1] - y
                row[first + 6], row[first + 7] = (cos * dx + sin * dy) / NEAR_M, (cos * dy - sin * dx) / NEAR_M

        station = cars.place_of[car]
        if 0 <= station < docks.shape[1]:
            row[STATION_AT] = 1.0
            row[STATION_AT + 1] = arms.idle[station]
            row[STATION_AT + 2] = arms.served[station] == car
            for other in range(len(poses)):
                dock = docks[other, station]
                gap = math.hypot(poses[other, 0] - dock[0], poses[other, 1] - dock[1])
                if other != car and gap < _DOCK_M:
                    row[STATION_AT + 3] = 1.0
        turns = not ground.steers[car] and abs(cars.steering[car]) >= AT_REST_RADPS
        row[_DOING_AT] = abs(cars.speeds[car]) < AT_REST_MPS and not turns
        row[_DOING_AT + 1] = doing.service_s[car] / SERVICE_S
        row[_DOING_AT + 2] = doing.time_left
        row[_DOING_AT + 3], row[_DOING_AT + 4] = doing.actions[car]
        row[_DOING_AT + 5] = doing.in_order[car]
        bounded(row)


@njit(cache=True)
def arm_rows(
    rows: Rows,
    ways: FloatArray,
    ground: ArmGround,
    arms: ArmsNow,
    parcels: ParcelsNow,
    cars: FloatArray,
    doing: ArmsDoing,
) -> None:  # pragma: no cover - compiled
    """Fill the rows of the first `len(rows)` arms, and their ways."""
    q, lower, upper, base = arms.q, ground.lower, ground.upper, ground.base
    transfers, held, poses, sizes = arms.transfers, arms.held, parcels.poses, parcels.sizes
    width = q.shape[1]
    frames = np.empty((width + 1, 3, 4))
    tip = np.empty(3)
    for arm in range(len(rows)):
        row = rows[arm]
        row[:] = 0.0
        for j in range(ground.n_joints[arm]):
            low, high = lower[arm, j], upper[arm, j]
            row[j] = (2.0 * q[arm, j] - high - low) / (high - low)
            row[N_JOINTS + j] = arms.qd[arm, j] / ground.max_velocity[arm, j]
        link_frames_into(ground.joints[arm], q[arm], frames)
        flange = frames[width]
        for a in range(3):
            tip[a] = flange[a, 3] + ground.tool_length_m[arm] * flange[a, 2]
            row[14 + a] = tip[a] / REACH_M
            row[17 + a] = flange[a, 2]
        x0, y0, z0 = base[arm, 0], base[arm, 1], base[arm, 2]
        cos, sin = math.cos(base[arm, 3]), math.sin(base[arm, 3])

        wanted = int(transfers[arm, 0])
        chosen = wanted if wanted >= 0 else held[arm]
        parcel, nearest = -1, doing.sight_m
        for k in range(len(parcels.ids)):
            gap = math.hypot(poses[k, 0] - x0, poses[k, 1] - y0)
            if gap < doing.sight_m and parcels.ids[k] == chosen:
                parcel = k
            elif chosen < 0 and gap < nearest:
                parcel, nearest = k, gap
        ways[arm] = 0.0
        if parcel >= 0:
            dx, dy = poses[parcel, 0] - x0, poses[parcel, 1] - y0
            px, py, pz = cos * dx + sin * dy, cos * dy - sin * dx, poses[parcel, 2] - z0
            top = pz + sizes[parcel, 2] / 2.0
            row[20], row[21], row[22] = (px - tip[0]) / REACH_M, (py - tip[1]) / REACH_M, (top - tip[2]) / REACH_M
            # Home is behind the base, and joints end there and back: what lies before it is reached by either side, and
            # left by the same.
            turned, is_ahead = 0.0, ground.is_ahead[arm]
            for j in range(width):
                turned += ground.turning[arm, j] * q[arm, j]
            at_tip = around(tip[0], tip[1], turned, is_ahead)
            at_parcel = around(px, py, 0.0, is_ahead)
            yaw = yaw_of(poses[parcel]) - base[arm, 3]
            turn = yaw - math.atan2(flange[1, 0], flange[0, 0])
            row[YAW_AT], row[YAW_AT + 1] = math.cos(turn), math.sin(turn)
            if wanted >= 0:
                dx, dy = transfers[arm, 1] - x0, transfers[arm, 2] - y0
                wx, wy = cos * dx + sin * dy, cos * dy - sin * dx
                wz = transfers[arm, 3] - z0 - pz
                row[23], row[24], row[25] = (wx - px) / REACH_M, (wy - py) / REACH_M, wz / REACH_M
                at_place = around(wx, wy, 0.0, is_ahead)
                by_arm = held[arm] == wanted or abs(at_place) > _BEFORE_RAD
                at_parcel = around(px, py, at_tip if by_arm else at_place, is_ahead)
                at_place = around(wx, wy, at_parcel, is_ahead)
                ways[arm] = _fill_offset(
                    row,
                    AROUND_AT + 3,
                    CLOSE_AT + 3,
                    (math.hypot(px, py), at_parcel),
                    (math.hypot(wx, wy), at_place),
                    wz,
                )
                turn = transfers[arm, 4] - base[arm, 3] - yaw
                row[YAW_AT + 2], row[YAW_AT + 3] = math.cos(turn), math.sin(turn)
            ways[arm] += _fill_offset(
                row,
                AROUND_AT,
                CLOSE_AT,
                (math.hypot(tip[0], tip[1]), at_tip),
                (math.hypot(px, py), at_parcel),
                top - tip[2],
            )
            for a in range(3):
                row[26 + a] = sizes[parcel, a] / EDGE_M
        row[29] = transfers[arm, 5]
        row[30] = held[arm] >= 0
        row[31] = parcel >= 0
        row[GRIP_AT] = doing.closed[arm]
        row[GRIP_AT + 1] = doing.opening[arm]
        row[GRIP_AT + 2] = doing.held_s[arm] / HELD_S
        row[GRIP_AT + 3] = wanted >= 0
        row[GRIP_AT + 4] = doing.service_s[arm] / SERVICE_S
        row[GRIP_AT + 5] = doing.time_left
        for k in range(doing.actions.shape[1]):
            row[GRIP_AT + 6 + k] = doing.actions[arm, k]

        nearest, car = doing.sight_m, -1
        for k in range(len(cars)):
            gap = math.hypot(cars[k, 0] - x0, cars[k, 1] - y0)
            if gap < nearest:
                nearest, car = gap, k
        if car >= 0:
            dx, dy, turn = cars[car, 0] - x0, cars[car, 1] - y0, cars[car, 2] - base[arm, 3]
            row[32] = 1.0
            row[33], row[34] = (cos * dx + sin * dy) / REACH_M, (cos * dy - sin * dx) / REACH_M
            row[35], row[36] = math.cos(turn), math.sin(turn)
        bounded(row)


@njit(cache=True)
def _fill_offset(
    row: Rows, at: int, close_at: int, here: tuple[float, float], there: tuple[float, float], up: float
) -> float:  # pragma: no cover - compiled
    """Fill in how far out, around the base and up it is from here to there; returns the length of that way [m]."""
    out, turn = there[0] - here[0], there[1] - here[1]
    around = 0.5 * (here[0] + there[0]) * turn
    row[at], row[at + 1], row[at + 2] = out, turn / math.pi, up
    row[close_at], row[close_at + 1], row[close_at + 2] = out / CLOSE_M, around / CLOSE_M, up / CLOSE_M
    return math.sqrt(out * out + around * around + up * up)


@njit(cache=True)
def around(x: float, y: float, side: float, is_ahead: bool) -> float:  # pragma: no cover - compiled
    """Angle of a point around the base, from straight behind it [rad]; if it lies before it, by the side of `side`. Of
    an arm that goes around by there it is that from straight ahead, and of what lies behind by the side."""
    angle = math.atan2(y, x) if is_ahead else math.atan2(-y, -x)
    if abs(angle) > _BEFORE_RAD and angle * side < 0.0:
        angle += 2.0 * math.pi if side > 0.0 else -2.0 * math.pi
    return angle
