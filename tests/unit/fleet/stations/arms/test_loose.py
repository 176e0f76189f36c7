"""Parcels that lie anywhere: which grips there are, and when there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fleet.robots.tools import TOOLS
from fleet.stations.arms.loose import UngrippableError, loose_grips

SIZE_M = (0.05, 0.06, 0.08)
GAP_M, LEAST_M = 0.003, 0.026


def lying(roll_deg: float, pitch_deg: float, yaw_deg: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", (roll_deg, pitch_deg, yaw_deg), degrees=True).as_matrix()
    pose[:3, 3] = 0.4, 0.1, 0.05
    return pose


@pytest.mark.parametrize("tool", ["suction", "friction"])
@pytest.mark.parametrize(
    ("angles", "up"), [((0, 0, 20), 2), ((90, 0, -70), 1), ((0, 90, 10), 0), ((180, 0, 5), 2), ((12, -9, 40), 2)]
)
def test_every_grip_is_square_to_the_uppermost_face(tool, angles, up):
    pose = lying(*angles)
    grips = loose_grips(pose, SIZE_M, TOOLS[tool], GAP_M, LEAST_M)
    turns = grips.tips[:, :3, :3]
    assert np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max() < 1e-9
    assert np.linalg.det(turns) == pytest.approx(np.ones(len(turns)))
    seen = np.linalg.inv(pose) @ grips.tips
    assert np.abs(seen[:, up, 2]) == pytest.approx(np.ones(len(seen)))  # along the parcel's own axis, from above
    assert (grips.tips[:, 2, 2] < -0.8).all()
    height = np.abs(seen[:, up, 3]) * np.sign(seen[:, up, 3] * -seen[:, up, 2]) + SIZE_M[up] / 2
    assert height == pytest.approx(np.full(len(seen), grips.height_m))
    expected = SIZE_M[up] + GAP_M if tool == "suction" else max(SIZE_M[up] / 2, LEAST_M)
    assert grips.height_m == pytest.approx(expected)
    if tool == "friction":
        assert len(seen) == 4
        assert np.abs(seen[:, :3, 0]).max(axis=1) == pytest.approx(np.ones(4))  # fingers flat on two sides


def test_what_leans_or_is_too_wide_is_not_gripped():
    with pytest.raises(UngrippableError, match="leans by 45 deg; valid: at most 30"):
        loose_grips(lying(45, 0, 0), SIZE_M, TOOLS["suction"], GAP_M, LEAST_M)
    with pytest.raises(UngrippableError, match=r"lies 0.120 m wide; valid: at most 0.100"):
        loose_grips(lying(0, 0, 0), (0.12, 0.13, 0.05), TOOLS["friction"], GAP_M, LEAST_M)
    assert len(loose_grips(lying(0, 0, 0), (0.12, 0.07, 0.05), TOOLS["friction"], GAP_M, LEAST_M).tips) == 2


@pytest.mark.parametrize("tool", ["suction", "friction"])
def test_what_lies_nowhere_or_has_no_size_is_refused(tool):
    for pose, size in ((lying(0, 0, 0) * np.nan, SIZE_M), (lying(0, 0, 0), (0.05, 0.0, 0.05))):
        with pytest.raises(UngrippableError, match="valid: finite, edges > 0"):
            loose_grips(pose, size, TOOLS[tool], GAP_M, LEAST_M)
