"""SlipMeter: how far parcels move in the tools that carry them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.robots.angle import rotation_into
from fleet.robots.arms.team import ArmTeam
from fleet.stations.arms.arm_controller import ArmController
from fleet.world.protocol import World
from planners.motion.arm.kinematics import link_frames_into


@dataclass(frozen=True, kw_only=True)
class Slip:
    """What became of one parcel between grip and release, seen from the tool."""

    arm: int
    parcel: int
    slip_m: float
    """How far its centre lay at the end from where it was gripped."""
    most_m: float
    """The farthest it ever lay from there, dynamic give of the grip included."""
    turn_rad: float
    """Angle between its orientations at the end and when it was gripped."""


@dataclass(kw_only=True)
class _Carry:
    parcel: int
    gripped: FloatArray
    slip_m: float = 0.0
    most_m: float = 0.0
    turn_rad: float = 0.0
    seen: tuple[bytes, bytes] = (b"", b"")
    """Joint positions and pose of the parcel when it was measured last."""


class SlipMeter:
    """Measures every carry: the pose of the parcel in the frame of the arm's last link, which the tool is rigid in.

    A carry begins when the arm takes the parcel for held, before it moves, and ends when it is to let go, or has lost
    it. Both poses are measured, the link's by forward kinematics from measured joint positions.

    Args:
        team: Models of the arms.
        base: Their base poses x, y, z, yaw, shape (m, 4).
    """

    def __init__(self, team: ArmTeam, base: FloatArray) -> None:
        self.slips: list[Slip] = []
        """All carries so far."""
        self._joints = team.joints
        self._base = np.asarray(base, dtype=np.float64).reshape(-1, 4)
        self._frames = np.zeros((team.width + 1, 3, 4))
        self._now = np.zeros((3, 4))
        self._carries: dict[int, _Carry] = {}

    def tick(self, services: Sequence[ArmController], world: World) -> None:
        """Measure what is carried now; called after each step of the world."""
        carrying = [service for service in services if service.carries]
        for arm in [arm for arm in self._carries if not services[arm].carries]:
            self._end(arm)
        if not carrying:
            return
        ids, poses, q, held = world.parcel_ids(), world.parcel_poses(), world.arm_positions(), world.held()
        for service in carrying:
            arm, parcel = service.arm, service.parcel
            if held[arm] != parcel:
                continue  # lost in this very tick: the arm is about to notice
            pose = poses[int(np.searchsorted(ids, parcel))]
            carry = self._carries.get(arm)
            seen = (q[arm].tobytes(), pose.tobytes())
            if carry is not None and carry.seen == seen:
                continue  # where nothing moves, nothing slips
            _seen_from_link(self._joints[arm], q[arm], self._base[arm], pose, self._frames, self._now)
            if carry is None:
                carry = self._carries[arm] = _Carry(parcel=parcel, gripped=self._now.copy())
            carry.seen = seen
            carry.slip_m, carry.turn_rad = _moved(carry.gripped, self._now)
            carry.most_m = max(carry.most_m, carry.slip_m)

    def _end(self, arm: int) -> None:
        carry = self._carries.pop(arm)
        self.slips.append(
            Slip(arm=arm, parcel=carry.parcel, slip_m=carry.slip_m, most_m=carry.most_m, turn_rad=carry.turn_rad)
        )


@njit(cache=True)
def _moved(before: FloatArray, now: FloatArray) -> tuple[float, float]:
    """How far a frame of shape (3, 4) has come [m], and by which angle it has turned [rad]."""
    way = apart = 0.0
    for row in range(3):
        way += (now[row, 3] - before[row, 3]) ** 2
        for col in range(3):
            apart += (now[row, col] - before[row, col]) ** 2
    # Two rotations by an angle a apart differ by 2 sqrt(2) sin(a / 2) in the root of the sum of squares.
    return math.sqrt(way), 2.0 * math.asin(min(math.sqrt(apart / 8.0), 1.0))


@njit(cache=True)
def _seen_from_link(
    joints: FloatArray, q: FloatArray, base: FloatArray, pose: FloatArray, frames: FloatArray, seen: FloatArray
) -> None:
    """Fill in the frame of a parcel as seen from an arm's last link, shape (3, 4)."""
    link_frames_into(joints, q, frames)
    link = frames[-1]
    cos, sin = math.cos(base[3]), math.sin(base[3])
    world = np.empty((3, 4))
    rotation_into(pose[3:], world)
    for axis in range(3):
        world[axis, 3] = pose[axis] - base[axis]
    for col in range(4):
        # From the world's axes to those of the arm's base, then to those of the link.
        u, v = cos * world[0, col] + sin * world[1, col], cos * world[1, col] - sin * world[0, col]
        t = world[2, col]
        if col == 3:
            u, v, t = u - link[0, 3], v - link[1, 3], t - link[2, 3]
        for row in range(3):
            seen[row, col] = link[0, row] * u + link[1, row] * v + link[2, row] * t
