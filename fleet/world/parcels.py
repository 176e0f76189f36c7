"""Parcels without physics: each rides on the floor, a pedestal, a car's tray or an arm's tool."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.errors import FleetError
from fleet.robots.angle import yaw_of
from fleet.robots.cars.models import CarModels
from fleet.world.protocol import ParcelBody
from fleet.world.scene import StaticBox

SUCTION_REACH_M = 0.02
"""An active tool takes the parcel whose top-face centre is this close to its tip [m]."""
SINK_M = 0.02
"""A parcel may be let go this deep inside what it comes to rest on [m]; a support higher than that is beside it."""


class ParcelError(FleetError):
    """A parcel is unknown, or known twice."""


class Support(IntEnum):
    """What a parcel rests on."""

    GROUND = 0
    """Something that never moves: the floor or a pedestal."""
    TRAY = 1
    TOOL = 2


_ON_TOOL = int(Support.TOOL)


@dataclass(frozen=True, kw_only=True)
class ParcelSnapshot:
    """State of `PlanarParcels` at one instant."""

    ids: IntArray
    size_m: FloatArray
    poses: FloatArray
    support: IntArray
    carrier: IntArray
    local: FloatArray
    held: IntArray


class PlanarParcels:
    """All parcels of a world and what carries them.

    A carried parcel keeps its pose relative to its carrier, rigidly. A parcel that is put into the world or let go
    drops straight down, within the tick, onto the highest support under its centre: floor, pedestal, tray floor or
    another parcel (it then rides with whatever carries that one), and comes to rest flat, keeping its yaw. Nothing
    slides, tips over or collides.

    Attributes:
        ids: Parcel ids, ascending, shape (p,).
        poses: World poses x, y, z, qx, qy, qz, qw of the box centres in the order of `ids`, shape (p, 7).
        held: Parcel id at each arm's tool, -1 for none, shape (n_arms,).

    Args:
        boxes: The scene's boxes; parcels rest on those of kind 'pedestal'.
        cars: Models of the cars whose trays carry parcels.
        n_arms: Number of tools.
    """

    def __init__(self, boxes: tuple[StaticBox, ...], cars: CarModels, n_arms: int) -> None:
        pedestals = [(*b.centre_m, *b.half_m) for b in boxes if b.kind == "pedestal"]
        self._pedestals = np.array(pedestals, dtype=np.float64).reshape(-1, 6)
        self._tray_x_m = cars.each("tray_x_m")
        self._tray_half_m = np.array([kind.tray_size_m[:2] for kind in cars.kinds])[cars.kind_of] / 2.0
        self._tray_floor_z_m = cars.each("tray_floor_z_m")
        self.ids = np.zeros(0, dtype=np.int64)
        self.poses = np.zeros((0, 7))
        self.held = np.full(n_arms, -1, dtype=np.int64)
        self._size_m = np.zeros((0, 3))
        self._support = np.zeros(0, dtype=np.int64)
        self._carrier = np.zeros(0, dtype=np.int64)
        self._local = np.zeros((0, 7))

    def add(self, body: ParcelBody, car_poses: FloatArray) -> None:
        """Put a parcel into the world; it drops from the pose it is given.

        Raises:
            ParcelError: The id is in use.
        """
        self._drop(self._insert(body), car_poses)

    def _insert(self, body: ParcelBody) -> int:
        """List a parcel at the pose it is given; returns its row."""
        row = int(np.searchsorted(self.ids, body.parcel))
        if row < len(self.ids) and self.ids[row] == body.parcel:
            raise ParcelError(f"parcel {body.parcel} is in the world already; valid: an id not in use")
        self.ids = np.insert(self.ids, row, body.parcel)
        self.poses = np.insert(self.poses, row, body.pose, axis=0)
        self._size_m = np.insert(self._size_m, row, body.size_m, axis=0)
        self._support = np.insert(self._support, row, Support.GROUND)
        self._carrier = np.insert(self._carrier, row, -1)
        self._local = np.insert(self._local, row, body.pose, axis=0)
        return row

    def load_on(self, body: ParcelBody, car: int, car_pose: FloatArray) -> None:
        """Put a parcel on a car's tray just as it lies there; it keeps its pose relative to the car.

        Args:
            body: The parcel, with its pose in the world.
            car: Index.
            car_pose: Of its rear axle x, y, yaw, shape (3,).

        Raises:
            ParcelError: The id is in use.
        """
        row = self._insert(body)
        self._support[row], self._carrier[row] = Support.TRAY, car
        back = Rotation.from_euler("z", -car_pose[2])
        self._local[row, :3] = back.apply(body.pose[:3] - (car_pose[0], car_pose[1], 0.0))
        self._local[row, 3:] = (back * Rotation.from_quat(body.pose[3:])).as_quat()

    def on_car(self, car: int) -> list[int]:
        """Ids of the parcels that ride on a car, ascending."""
        rides = (self._support == Support.TRAY) & (self._carrier == car)
        return [int(parcel) for parcel in self.ids[rides]]

    def pose(self, parcel: int) -> FloatArray:
        """World pose of a parcel, shape (7,)."""
        return self.poses[int(np.searchsorted(self.ids, parcel))]

    def remove(self, parcel: int) -> None:
        """Take a parcel out of the world, out of a grip too.

        Raises:
            ParcelError: No such parcel.
        """
        row = int(np.searchsorted(self.ids, parcel))
        if row == len(self.ids) or self.ids[row] != parcel:
            raise ParcelError(f"parcel {parcel} is not in the world; valid: {self.ids.tolist()}")
        self.held[self.held == parcel] = -1
        for name in ("ids", "poses", "_size_m", "_support", "_carrier", "_local"):
            setattr(self, name, np.delete(getattr(self, name), row, axis=0))

    def update(self, car_poses: FloatArray, tips: FloatArray, grip: BoolArray) -> None:
        """Carry parcels to where their carriers are now, then let go and take hold.

        An active tool that holds nothing takes a parcel in any tick, not only in the one in which it is switched on.

        Args:
            car_poses: Rear-axle poses x, y, yaw, shape (n_cars, 3).
            tips: World poses of the tool tips, shape (n_arms, 7).
            grip: True = hold, shape (n_arms,).
        """
        if len(self.ids) == 0:
            return
        if _carry(self._support, self._carrier, self._local, car_poses, tips, self.poses, self.held, grip):
            return
        holding = self.held >= 0
        for arm in np.nonzero(holding & ~grip)[0]:
            row = int(np.searchsorted(self.ids, self.held[arm]))
            self.held[arm] = -1
            self._drop(row, car_poses)
        for arm in np.nonzero(grip & ~holding)[0]:
            self._take(int(arm), tips[arm])

    def held_spheres(self) -> FloatArray:
        """Centre x, y, z and radius of a sphere round each tool's parcel, radius -1 for none, shape (n_arms, 4)."""
        spheres = np.empty((len(self.held), 4))
        _held_spheres(self.held, self.ids, self.poses, self._size_m, spheres)
        return spheres

    def save(self) -> ParcelSnapshot:
        """Copy of the state."""
        return ParcelSnapshot(
            ids=self.ids.copy(),
            size_m=self._size_m.copy(),
            poses=self.poses.copy(),
            support=self._support.copy(),
            carrier=self._carrier.copy(),
            local=self._local.copy(),
            held=self.held.copy(),
        )

    def load(self, snapshot: ParcelSnapshot) -> None:
        """Return to a saved state."""
        self.ids = snapshot.ids.copy()
        self._size_m = snapshot.size_m.copy()
        self.poses = snapshot.poses.copy()
        self._support = snapshot.support.copy()
        self._carrier = snapshot.carrier.copy()
        self._local = snapshot.local.copy()
        self.held = snapshot.held.copy()

    def _take(self, arm: int, tip: FloatArray) -> None:
        """Fix the parcel under the tool, if there is one that no other arm holds, to the tool."""
        row = _within_reach(tip, self.poses, self._size_m, self._support)
        if row < 0:
            return
        tip_from_world = Rotation.from_quat(tip[3:]).inv()
        self._local[row, :3] = tip_from_world.apply(self.poses[row, :3] - tip[:3])
        self._local[row, 3:] = (tip_from_world * Rotation.from_quat(self.poses[row, 3:])).as_quat()
        self._support[row], self._carrier[row] = Support.TOOL, arm
        self.held[arm] = self.ids[row]

    def _drop(self, row: int, car_poses: FloatArray) -> None:
        """Let a parcel fall onto the highest support under its centre."""
        x, y, z = self.poses[row, :3]
        half_z = self._size_m[row, 2] / 2.0
        reachable = z - half_z + SINK_M
        top, support, carrier = 0.0, Support.GROUND, -1

        pedestals = self._pedestals
        under = np.all(np.abs(pedestals[:, :2] - (x, y)) <= pedestals[:, 3:5], axis=1)
        tops = pedestals[under, 2] + pedestals[under, 5]
        top = max(top, float(tops[tops <= reachable].max(initial=0.0)))

        floors_z = self._tray_floor_z_m[: len(car_poses)]
        below = (top < floors_z) & (floors_z <= reachable)
        if below.any():
            dx, dy = x - car_poses[:, 0], y - car_poses[:, 1]
            cos, sin = np.cos(car_poses[:, 2]), np.sin(car_poses[:, 2])
            half = self._tray_half_m
            ahead, left = cos * dx + sin * dy - self._tray_x_m, cos * dy - sin * dx
            over = np.nonzero(below & (np.abs(ahead) <= half[:, 0]) & (np.abs(left) <= half[:, 1]))[0]
            if len(over):
                top, support, carrier = float(floors_z[over[0]]), Support.TRAY, int(over[0])

        # Whatever its centre could lie on is no farther away than its half diagonal.
        reach = np.hypot(self._size_m[:, 0], self._size_m[:, 1]) / 2.0
        near = (np.abs(self.poses[:, 0] - x) <= reach) & (np.abs(self.poses[:, 1] - y) <= reach)
        for other in near.nonzero()[0].tolist():
            if other == row or self._support[other] == Support.TOOL:
                continue
            other_top = float(self.poses[other, 2] + self._size_m[other, 2] / 2.0)
            offset = _turned(x - self.poses[other, 0], y - self.poses[other, 1], -yaw_of(self.poses[other]))
            inside = abs(offset[0]) <= self._size_m[other, 0] / 2.0 and abs(offset[1]) <= self._size_m[other, 1] / 2.0
            if inside and top < other_top <= reachable:
                top, support, carrier = other_top, Support(int(self._support[other])), int(self._carrier[other])

        yaw = yaw_of(self.poses[row])
        self.poses[row] = _flat(x, y, top + half_z, yaw)
        self._support[row], self._carrier[row] = support, carrier
        if support == Support.TRAY:
            car = car_poses[carrier]
            u, v = _turned(x - car[0], y - car[1], -car[2])
            self._local[row] = _flat(u, v, top + half_z, yaw - car[2])


def _flat(x: float, y: float, z: float, yaw: float) -> FloatArray:
    return np.array([x, y, z, 0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)])


def _turned(x: float, y: float, yaw: float) -> tuple[float, float]:
    cos, sin = math.cos(yaw), math.sin(yaw)
    return cos * x - sin * y, sin * x + cos * y


@njit(cache=True)
def _within_reach(tip: FloatArray, poses: FloatArray, size: FloatArray, support: IntArray) -> int:
    """The parcel nearest to a tool, of those that no tool holds; -1 if none is in its reach."""
    row, least = -1, math.inf
    for k in range(len(poses)):
        if support[k] == _ON_TOOL:
            continue
        # A cup stops at the top face, fingers close beside the middle: what counts is the way to the upright axis.
        ax, ay, az, aw = -poses[k, 3], -poses[k, 4], -poses[k, 5], poses[k, 6]
        x, y, z = tip[0] - poses[k, 0], tip[1] - poses[k, 1], tip[2] - poses[k, 2]
        tx, ty, tz = 2.0 * (ay * z - az * y), 2.0 * (az * x - ax * z), 2.0 * (ax * y - ay * x)
        beside_x, beside_y = x + aw * tx + ay * tz - az * ty, y + aw * ty + az * tx - ax * tz
        over = max(abs(z + aw * tz + ax * ty - ay * tx) - size[k, 2] / 2.0, 0.0)
        distance = math.sqrt(beside_x * beside_x + beside_y * beside_y + over * over)
        if distance < least:
            row, least = k, distance
    return row if least <= SUCTION_REACH_M else -1


@njit(cache=True)
def _held_spheres(held: IntArray, ids: IntArray, poses: FloatArray, size: FloatArray, spheres: FloatArray) -> None:
    """Fill centre and radius of a sphere round each tool's parcel; -1 throughout for none."""
    for arm in range(len(held)):
        spheres[arm] = -1.0
        if held[arm] >= 0:
            row = np.searchsorted(ids, held[arm])
            spheres[arm, :3] = poses[row, :3]
            square = size[row, 0] * size[row, 0] + size[row, 1] * size[row, 1] + size[row, 2] * size[row, 2]
            spheres[arm, 3] = math.sqrt(square) / 2.0


@njit(cache=True)
def _carry(
    support: IntArray,
    carrier: IntArray,
    local: FloatArray,
    car_poses: FloatArray,
    tips: FloatArray,
    poses: FloatArray,
    held: IntArray,
    grip: BoolArray,
) -> bool:
    """World poses of carried parcels: carrier pose times local pose, both as x, y, z, quat_xyzw.

    Returns:
        Whether exactly the tools that should hold something do.
    """
    base = np.zeros(7)
    for i in range(len(support)):
        if support[i] == 0:
            continue
        if support[i] == 1:
            half = car_poses[carrier[i], 2] / 2.0
            base[0], base[1], base[2] = car_poses[carrier[i], 0], car_poses[carrier[i], 1], 0.0
            base[3], base[4], base[5], base[6] = 0.0, 0.0, math.sin(half), math.cos(half)
        else:
            for axis in range(7):
                base[axis] = tips[carrier[i], axis]
        ax, ay, az, aw = base[3], base[4], base[5], base[6]
        px, py, pz = local[i, 0], local[i, 1], local[i, 2]
        bx, by, bz, bw = local[i, 3], local[i, 4], local[i, 5], local[i, 6]
        # v + 2 w (a x v) + 2 a x (a x v)
        tx, ty, tz = 2.0 * (ay * pz - az * py), 2.0 * (az * px - ax * pz), 2.0 * (ax * py - ay * px)
        poses[i, 0] = base[0] + px + aw * tx + ay * tz - az * ty
        poses[i, 1] = base[1] + py + aw * ty + az * tx - ax * tz
        poses[i, 2] = base[2] + pz + aw * tz + ax * ty - ay * tx
        poses[i, 3] = aw * bx + ax * bw + ay * bz - az * by
        poses[i, 4] = aw * by - ax * bz + ay * bw + az * bx
        poses[i, 5] = aw * bz + ax * by - ay * bx + az * bw
        poses[i, 6] = aw * bw - ax * bx - ay * by - az * bz
    for arm in range(len(held)):  # noqa: SIM110 - numba has no generators in all()
        if (held[arm] >= 0) != grip[arm]:
            return False
    return True
