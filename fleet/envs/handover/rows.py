"""Rows: kernels that fill the observations of cars and arms (layout: see `fleet.envs.handover.env`)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.envs.handover.parcels import Int64Array, ParcelPlaces
from fleet.envs.warehouse.control.hands import HandModel
from fleet.envs.warehouse.rows import bounded
from planners.motion.arm.kinematics import link_frames_into

N_STATIONS, N_PER_STATION = 2, 17
"""Stations of each kind that a car is told about, and numbers of each."""
N_CARS_SEEN, N_PER_CAR = 3, 8
"""Other cars that a car is told about, and numbers of each."""
N_OWN = 6
"""Numbers that a car is told of itself."""
FIRST_CAR = N_OWN + 2 * N_STATIONS * N_PER_STATION
"""Entry of a car's row at which other cars begin."""
N_CAR_NUMBERS = FIRST_CAR + N_CARS_SEEN * N_PER_CAR
"""Numbers in a car's observation."""

N_ARM_OWN = 18
"""Numbers that an arm is told of itself."""
N_PARCELS, N_PER_PARCEL = 2, 9
"""Parcels that an arm is told about, and numbers of each."""
N_TRAYS, N_PER_TRAY = 2, 14
"""Cars that an arm is told about, and numbers of each."""
N_SLOTS, N_PER_SLOT = 2, 7
"""Free slots that an arm is told about, and numbers of each."""
FIRST_PARCEL = N_ARM_OWN
FIRST_TRAY = FIRST_PARCEL + N_PARCELS * N_PER_PARCEL
FIRST_SLOT = FIRST_TRAY + N_TRAYS * N_PER_TRAY
N_ARM_NUMBERS = FIRST_SLOT + N_SLOTS * N_PER_SLOT
"""Numbers in an arm's observation."""

WAY_M, POINT_M, STOP_M, TIP_M, NEAR_M = 20.0, 2.0, 1.0, 1.5, 4.0
"""Ranges of what a car is told: ways, points of ways, offsets to stops and to tools, other cars [m]."""
SIGHT_M, CLOSE_M, HEIGHT_M = 3.0, 0.1, 0.1
"""Ranges of what an arm is told: cars and offsets outwards, small offsets, heights of parcels [m]."""
REACH_M = 0.75
"""A tool that points down reaches trays and slots up to this from the base's axis [m]."""
MANY = 4.0
"""As many parcels, or free slots, as are told apart."""
MOST_RAD = 3.7
"""An arm turns up to this from straight behind its base: home is there, and joints end before the base [rad]."""
TURN_RAD = 2.0 * MOST_RAD
"""Range of turns around the base [rad]."""
_BEFORE_RAD = 2.6
"""Farther from straight behind the base than this a tip may have come by either side [rad]."""

Rows = npt.NDArray[np.float32]


class CarsSighted(NamedTuple):
    """What cars are doing; n cars."""

    poses: FloatArray
    """x, y, yaw, shape (n, 3)."""
    speeds: FloatArray
    """[m/s], shape (n,)."""
    steering: FloatArray
    """As a share of the limit, shape (n,)."""
    loads: Int64Array
    """Parcels in each tray, shape (n,)."""
    runs: BoolArray
    """Whether motors run, shape (n,)."""
    touches: BoolArray
    """Whether a contact began in this step, shape (n,)."""
    left_m: FloatArray
    """Ways to the stops of all arms [m], shape (n, m)."""
    points: FloatArray
    """Points of those ways, shape (n, m, 3, 2)."""
    stops: FloatArray
    """Poses of the stops, shape (m, 3)."""
    speed_mps: float
    """At full action."""


class ArmsSighted(NamedTuple):
    """What arms are doing; m arms."""

    hand: HandModel
    base: FloatArray
    """Feet x, y, z, yaw, shape (m, 4)."""
    q: FloatArray
    """Joint positions [rad], shape (m, n_joints)."""
    held: IntArray
    """Parcel in each grip, -1 = none, shape (m,)."""
    closed: BoolArray
    opening: FloatArray
    """As `Latches` has them, shape (m,)."""
    tips: FloatArray
    """Where the tools are in the world, shape (m, 3)."""
    around: FloatArray
    """Direction of each tip from its base, from straight behind it, beyond the half turn where it came so [rad]."""
    tool_yaw: FloatArray
    """Direction of each tool in its base's frame [rad]."""
    waiting: Int64Array
    """Parcels at a pick arm, in its grip too, and free slots of a drop arm, shape (m,)."""


class ParcelsSighted(NamedTuple):
    """Parcels in the world; p parcels."""

    ids: IntArray
    poses: FloatArray
    """Shape (p, 7)."""
    sizes: FloatArray
    """Edges [m], shape (p, 3)."""
    place: Int64Array
    """Where each belongs, as `ParcelPlaces` counts them, shape (p,)."""


@njit(cache=True)
def find_tips(
    hand: HandModel, base: FloatArray, q: FloatArray, tips: FloatArray, around: FloatArray, tool_yaw: FloatArray
) -> None:  # pragma: no cover - compiled
    """Fill in `tips`, `around` and `tool_yaw` of `ArmsSighted`."""
    frames = np.empty((q.shape[1] + 1, 3, 4))
    for arm in range(len(q)):
        link_frames_into(hand.joints, q[arm], frames)
        flange = frames[q.shape[1]]
        x = flange[0, 3] + hand.tool_length_m * flange[0, 2]
        y = flange[1, 3] + hand.tool_length_m * flange[1, 2]
        z = flange[2, 3] + hand.tool_length_m * flange[2, 2]
        cos, sin = math.cos(base[arm, 3]), math.sin(base[arm, 3])
        tips[arm, 0] = base[arm, 0] + cos * x - sin * y
        tips[arm, 1] = base[arm, 1] + sin * x + cos * y
        tips[arm, 2] = base[arm, 2] + z
        tool_yaw[arm] = math.atan2(flange[1, 0], flange[0, 0])
        angle, side = math.atan2(-y, -x), q[arm, 0] + q[arm, 2]
        if abs(angle) > _BEFORE_RAD and angle * side < 0.0:
            angle += math.copysign(2.0 * math.pi, side)
        around[arm] = angle


@njit(cache=True)
def car_rows(
    rows: Rows, cars: CarsSighted, arms: ArmsSighted, places: ParcelPlaces, time_left: float
) -> None:  # pragma: no cover
    """Fill the rows of all cars, shape (n, N_CAR_NUMBERS)."""
    n_arms = len(arms.base)
    gaps, ways = np.empty(len(rows)), np.empty(n_arms)
    for car in range(len(rows)):
        row = rows[car]
        row[:] = 0.0
        x, y, yaw = cars.poses[car]
        row[0], row[1] = cars.speeds[car] / cars.speed_mps, cars.steering[car]
        row[2], row[3] = min(cars.loads[car], 1), cars.runs[car]
        row[4], row[5] = cars.touches[car], time_left
        for kind in range(2):
            for arm in range(n_arms):
                ways[arm] = cars.left_m[car, arm] if places.is_drop[arm] == (kind == 1) else math.inf
            for rank in range(N_STATIONS):
                arm = int(np.argmin(ways))
                if ways[arm] == math.inf:
                    break
                ways[arm] = math.inf
                at = N_OWN + (kind * N_STATIONS + rank) * N_PER_STATION
                _tell_station(cars, arms, places, car, arm, row[at : at + N_PER_STATION])
        for other in range(len(rows)):
            dx, dy = cars.poses[other, 0] - x, cars.poses[other, 1] - y
            gaps[other] = math.hypot(dx, dy) if other != car else math.inf
        for rank in range(N_CARS_SEEN):
            other = int(np.argmin(gaps))
            if gaps[other] > NEAR_M:
                break
            gaps[other] = math.inf
            at = FIRST_CAR + rank * N_PER_CAR
            ahead, left = _turned(cars.poses[other, 0] - x, cars.poses[other, 1] - y, yaw)
            turn = cars.poses[other, 2] - yaw
            row[at] = 1.0
            row[at + 1], row[at + 2] = ahead / NEAR_M, left / NEAR_M
            row[at + 3], row[at + 4] = math.cos(turn), math.sin(turn)
            row[at + 5], row[at + 6] = cars.speeds[other] / cars.speed_mps, min(cars.loads[other], 1)
            row[at + 7] = other < car
        bounded(row)


@njit(cache=True)
def _tell_station(
    cars: CarsSighted, arms: ArmsSighted, places: ParcelPlaces, car: int, arm: int, out: Rows
) -> None:  # pragma: no cover - compiled
    """Write what a car is told of an arm, shape (N_PER_STATION,)."""
    x, y, yaw = cars.poses[car]
    sx, sy, turned = cars.stops[arm]
    out[0], out[1] = 1.0, cars.left_m[car, arm] / WAY_M
    for p in range(3):
        px, py = cars.points[car, arm, p, 0] - x, cars.points[car, arm, p, 1] - y
        ahead, left = _turned(px, py, yaw)
        out[2 + 2 * p], out[3 + 2 * p] = ahead / POINT_M, left / POINT_M
    ahead, left = _turned(sx - x, sy - y, turned)
    turn = turned - yaw
    out[8], out[9], out[10] = ahead / STOP_M, left / STOP_M, math.atan2(math.sin(turn), math.cos(turn))
    out[11], out[12] = arms.waiting[arm] / MANY, arms.held[arm] >= 0
    tray_x, tray_y = _tray(places, cars.poses[car])
    ahead, left = _turned(arms.tips[arm, 0] - tray_x, arms.tips[arm, 1] - tray_y, yaw)
    out[13], out[14] = ahead / TIP_M, left / TIP_M
    out[15] = (arms.tips[arm, 2] - places.tray[3]) / TIP_M
    for other in range(len(cars.poses)):
        if other != car and math.hypot(cars.poses[other, 0] - sx, cars.poses[other, 1] - sy) < 1.0:
            out[16] = 1.0


@njit(cache=True)
def arm_rows(
    rows: Rows,
    targets: FloatArray,
    arms: ArmsSighted,
    cars: CarsSighted,
    parcels: ParcelsSighted,
    places: ParcelPlaces,
    time_left: float,
) -> None:  # pragma: no cover - compiled
    """Fill the rows of all arms, shape (m, N_ARM_NUMBERS), and what they are about.

    What an empty arm is about is the nearest parcel; with a parcel it is the nearest place for it, an empty tray at a
    pick arm, a free slot at a drop arm. Only what it can reach counts.

    Args:
        rows: Filled in.
        targets: Filled in with a number that tells targets apart, -1 = none, and the way there [m], shape (m, 2).
        arms: What arms are doing.
        cars: What cars are doing.
        parcels: Parcels in the world.
        places: Where parcels may lie.
        time_left: Share of the episode that is left.
    """
    n_joints = arms.q.shape[1]
    first_tray, n_cars = len(places.slots), len(cars.poses)
    for arm in range(len(rows)):
        row, is_drop, holds = rows[arm], places.is_drop[arm], arms.held[arm] >= 0
        row[:] = 0.0
        targets[arm, 0], targets[arm, 1] = -1.0, 0.0
        for j in range(n_joints):
            row[j] = arms.q[arm, j] / arms.hand.half[j]
        dx, dy = arms.tips[arm, 0] - arms.base[arm, 0], arms.tips[arm, 1] - arms.base[arm, 1]
        row[7], row[8] = math.hypot(dx, dy) / TIP_M, arms.around[arm] / MOST_RAD
        row[9] = (arms.tips[arm, 2] - arms.base[arm, 2]) / TIP_M
        row[10], row[11] = math.cos(arms.tool_yaw[arm]), math.sin(arms.tool_yaw[arm])
        row[12], row[14], row[15] = holds, arms.closed[arm], arms.opening[arm]
        row[16], row[17] = (-1.0 if is_drop else 1.0), time_left
        below = 0.0
        for k in range(len(parcels.ids)):
            if holds and parcels.ids[k] == arms.held[arm]:
                below = arms.tips[arm, 2] - (parcels.poses[k, 2] - parcels.sizes[k, 2] / 2.0)
        row[13] = below / HEIGHT_M

        gaps = np.full(len(parcels.ids), np.inf)
        for k in range(len(parcels.ids)):
            place = parcels.place[k]
            on_slot = 0 <= place < first_tray and places.arm_of[place] == arm and not is_drop
            on_tray = first_tray <= place < first_tray + n_cars and is_drop
            if (on_slot or on_tray) and _from_base(arms, arm, parcels.poses[k]) < SIGHT_M:
                gaps[k] = _gap(arms.tips[arm], parcels.poses[k])
        for rank in range(min(N_PARCELS, len(gaps))):
            k = int(np.argmin(gaps))
            if gaps[k] == math.inf:
                break
            gaps[k] = math.inf
            at = FIRST_PARCEL + rank * N_PER_PARCEL
            x, y, top = parcels.poses[k, 0], parcels.poses[k, 1], parcels.poses[k, 2] + parcels.sizes[k, 2] / 2.0
            row[at] = 1.0
            way_m = _tell_offset(arms, arm, x, y, top, row[at + 1 : at + 7])
            if parcels.place[k] >= first_tray:
                _tell_motion(arms, arm, cars, parcels.place[k] - first_tray, x, y, row[at + 7 : at + 9])
            if not holds and targets[arm, 0] < 0.0 and _from_base(arms, arm, parcels.poses[k]) < REACH_M:
                targets[arm, 0], targets[arm, 1] = parcels.ids[k], way_m

        gaps = np.full(n_cars, np.inf)
        for car in range(n_cars):
            x, y = _tray(places, cars.poses[car])
            from_base = math.hypot(x - arms.base[arm, 0], y - arms.base[arm, 1])
            if from_base < SIGHT_M:
                gaps[car] = from_base
        for rank in range(min(N_TRAYS, n_cars)):
            car = int(np.argmin(gaps))
            if gaps[car] == math.inf:
                break
            in_reach = gaps[car] < REACH_M
            gaps[car] = math.inf
            at = FIRST_TRAY + rank * N_PER_TRAY
            x, y = _tray(places, cars.poses[car])
            row[at] = 1.0
            way_m = _tell_offset(arms, arm, x, y, places.tray[3] + below, row[at + 1 : at + 7])
            _tell_motion(arms, arm, cars, car, x, y, row[at + 7 : at + 9])
            turn = cars.poses[car, 2] - arms.base[arm, 3]
            row[at + 9], row[at + 10] = math.cos(turn), math.sin(turn)
            row[at + 11], row[at + 12] = min(cars.loads[car], 1), in_reach
            row[at + 13] = cars.speeds[car] / cars.speed_mps
            if holds and not is_drop and in_reach and cars.loads[car] == 0 and targets[arm, 0] < 0.0:
                targets[arm, 0], targets[arm, 1] = 1e6 * (1 + arms.held[arm]) + car, way_m

        gaps = np.full(len(places.slots), np.inf)
        for slot in range(len(places.slots)):
            if places.arm_of[slot] == arm and _is_free(places.slots[slot], parcels, arms.held[arm]):
                gaps[slot] = _gap(arms.tips[arm], places.slots[slot])
        for rank in range(min(N_SLOTS, len(gaps))):
            slot = int(np.argmin(gaps))
            if gaps[slot] == math.inf:
                break
            gaps[slot] = math.inf
            at = FIRST_SLOT + rank * N_PER_SLOT
            x, y, top = places.slots[slot]
            row[at] = 1.0
            way_m = _tell_offset(arms, arm, x, y, top + below, row[at + 1 : at + 7])
            if holds and is_drop and targets[arm, 0] < 0.0:
                targets[arm, 0], targets[arm, 1] = 1e6 * (1 + arms.held[arm]) + slot, way_m
        bounded(row)


@njit(cache=True)
def _tell_offset(
    arms: ArmsSighted, arm: int, x: float, y: float, z: float, out: Rows
) -> float:  # pragma: no cover - compiled
    """Write how far out, around the base and up it is from a tip to a point, coarse and fine; returns the way [m]."""
    base, tip = arms.base[arm], arms.tips[arm]
    px, py = _turned(x - base[0], y - base[1], base[3])
    radius, own = math.hypot(px, py), math.hypot(tip[0] - base[0], tip[1] - base[1])
    angle = math.atan2(-py, -px)
    turn = angle - arms.around[arm]
    # What lies before the base is reached by either side; the nearer one, if the joints go so far.
    for other in (angle - 2.0 * math.pi, angle + 2.0 * math.pi):
        if abs(other) < MOST_RAD and abs(other - arms.around[arm]) < abs(turn):
            turn = other - arms.around[arm]
    away, arc, up = radius - own, 0.5 * (radius + own) * turn, z - tip[2]
    out[0], out[1], out[2] = away / SIGHT_M, turn / TURN_RAD, up
    out[3], out[4], out[5] = away / CLOSE_M, arc / CLOSE_M, up / CLOSE_M
    return math.sqrt(away * away + arc * arc + up * up)


@njit(cache=True)
def _tell_motion(
    arms: ArmsSighted, arm: int, cars: CarsSighted, car: int, x: float, y: float, out: Rows
) -> None:  # pragma: no cover - compiled
    """Write a car's velocity, outwards from an arm's base and around it [m/s], at a point on the car."""
    dx, dy = x - arms.base[arm, 0], y - arms.base[arm, 1]
    radius = max(math.hypot(dx, dy), 1e-6)
    yaw, speed = cars.poses[car, 2], cars.speeds[car]
    vx, vy = speed * math.cos(yaw), speed * math.sin(yaw)
    out[0], out[1] = (dx * vx + dy * vy) / radius, (dx * vy - dy * vx) / radius


@njit(cache=True)
def _is_free(slot: FloatArray, parcels: ParcelsSighted, held: int) -> bool:  # pragma: no cover - compiled
    """Whether no parcel lies on or above a slot, but for the one that an arm holds."""
    for k in range(len(parcels.ids)):
        gap = math.hypot(parcels.poses[k, 0] - slot[0], parcels.poses[k, 1] - slot[1])
        if parcels.ids[k] != held and gap < 0.1:
            return False
    return True


@njit(cache=True)
def _from_base(arms: ArmsSighted, arm: int, pose: FloatArray) -> float:  # pragma: no cover - compiled
    return math.hypot(pose[0] - arms.base[arm, 0], pose[1] - arms.base[arm, 1])


@njit(cache=True)
def _gap(a: FloatArray, b: FloatArray) -> float:  # pragma: no cover - compiled
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@njit(cache=True)
def _tray(places: ParcelPlaces, pose: FloatArray) -> tuple[float, float]:  # pragma: no cover - compiled
    """Middle of a car's tray, x, y [m]."""
    return pose[0] + places.tray[0] * math.cos(pose[2]), pose[1] + places.tray[0] * math.sin(pose[2])


@njit(cache=True)
def _turned(dx: float, dy: float, yaw: float) -> tuple[float, float]:  # pragma: no cover - compiled
    """A vector in a frame that is turned by `yaw`."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return cos * dx + sin * dy, cos * dy - sin * dx
