"""Slip is measured from the tool, whatever the arm does meanwhile."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fleet.insight.slip import SlipMeter
from fleet.robots import ARMS, ArmTeam
from planners.motion.arm.kinematics import link_frames

SPEC = ARMS["iiwa"].spec()
BASE = np.array([[1.0, 2.0, 0.1, 0.7]])


def seen(q: np.ndarray, offset: tuple[float, float, float], turn_rad: float) -> np.ndarray:
    """World pose of a parcel at an offset from the last link, turned about its axis."""
    x, y, z, yaw = BASE[0]
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = Rotation.from_euler("z", yaw).as_matrix(), (x, y, z)
    parcel = np.eye(4)
    parcel[:3, :3], parcel[:3, 3] = Rotation.from_euler("z", turn_rad).as_matrix(), offset
    pose = base @ link_frames(SPEC.base_from_joint, q)[-1] @ parcel
    return np.array([*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()])


def test_a_carry_is_measured_from_grip_to_release():
    meter = SlipMeter(ArmTeam.alike(SPEC, len(BASE)), BASE)
    rng = np.random.default_rng(4)
    # Grip, give by 3 mm, come back to 2 mm with a turn of 0.1 rad, release; then the same without any slip.
    for parcel, offsets, turn in ((7, (0.0, 0.003, 0.002), 0.1), (8, (0.0, 0.0, 0.0), 0.0)):
        for k, offset in enumerate((*offsets, None)):
            q = rng.uniform(SPEC.lower_rad, SPEC.upper_rad)
            service = SimpleNamespace(arm=0, parcel=parcel, carries=offset is not None)
            pose = seen(q, (offset or 0.0, 0.0, 0.25), turn * (k == 2))
            world = SimpleNamespace(
                parcel_ids=lambda: np.array([3, parcel]),  # noqa: B023 - called within this turn of the loop
                parcel_poses=lambda: np.stack([np.zeros(7), pose]),  # noqa: B023
                arm_positions=lambda: q[None],  # noqa: B023
                held=lambda: np.array([parcel]),  # noqa: B023
            )
            meter.tick([service], world)
    slid, firm = meter.slips
    assert (slid.arm, slid.parcel, firm.parcel) == (0, 7, 8)
    assert (slid.slip_m, slid.most_m, slid.turn_rad) == pytest.approx((0.002, 0.003, 0.1))
    assert (firm.slip_m, firm.most_m, firm.turn_rad) == pytest.approx((0.0, 0.0, 0.0), abs=1e-7)
