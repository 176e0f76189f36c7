"""SlipMeter: how far parcels move in the tools that carry them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from fleet.arrays import FloatArray
from fleet.robots.spec import ArmSpec
from fleet.stations.arms.arm_controller import ArmController
from fleet.world.protocol import World
from planners.motion.arm.kinematics import link_frames


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
    gripped: tuple[FloatArray, Rotation]
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
        spec: The arms.
        base: Their base poses x, y, z, yaw, shape (m, 4).
    """

    def __init__(self, spec: ArmSpec, base: FloatArray) -> None:
        self.slips: list[Slip] = []
        """All carries so far."""
        self._spec = spec
        self._base = [(pose[:3], Rotation.from_euler("z", pose[3])) for pose in np.asarray(base).reshape(-1, 4)]
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
            place, turn = self._seen(arm, q[arm], pose)
            if carry is None:
                carry = self._carries[arm] = _Carry(parcel=parcel, gripped=(place, turn))
            carry.seen = seen
            carry.slip_m = float(np.linalg.norm(place - carry.gripped[0]))
            carry.most_m = max(carry.most_m, carry.slip_m)
            carry.turn_rad = float((turn * carry.gripped[1].inv()).magnitude())

    def _seen(self, arm: int, q: FloatArray, pose: FloatArray) -> tuple[FloatArray, Rotation]:
        """Place and orientation of a parcel in the frame of an arm's last link."""
        flange = link_frames(self._spec.base_from_joint, q)[-1]
        origin, base = self._base[arm]
        link = Rotation.from_matrix(flange[:3, :3])
        place = (base * link).inv().apply(pose[:3] - origin - base.apply(flange[:3, 3]))
        return place, (base * link).inv() * Rotation.from_quat(pose[3:])

    def _end(self, arm: int) -> None:
        carry = self._carries.pop(arm)
        self.slips.append(
            Slip(arm=arm, parcel=carry.parcel, slip_m=carry.slip_m, most_m=carry.most_m, turn_rad=carry.turn_rad)
        )
