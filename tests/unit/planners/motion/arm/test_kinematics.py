"""Forward kinematics against plain matrix products."""

from __future__ import annotations

import numpy as np
import pytest

from planners.errors import PlanningError
from planners.motion.arm.kinematics import flange_from_tip, link_frames, pointing_down


def _turn(angle):  # type: ignore[no-untyped-def]
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def test_frames_are_products_of_joint_transforms(iiwa_joints):  # type: ignore[no-untyped-def]
    transforms, lower, upper = iiwa_joints
    q = np.random.default_rng(0).uniform(lower, upper)
    expected = np.eye(4)
    frames = link_frames(transforms, q)
    np.testing.assert_array_equal(frames[0], np.eye(4))
    for i, transform in enumerate(transforms):
        expected = expected @ transform @ _turn(q[i])
        np.testing.assert_allclose(frames[i + 1], expected, atol=1e-12)


def test_batch_equals_single(iiwa_joints):  # type: ignore[no-untyped-def]
    transforms, lower, upper = iiwa_joints
    q = np.random.default_rng(1).uniform(lower, upper, (5, 7))
    np.testing.assert_array_equal(link_frames(transforms, q)[3], link_frames(transforms, q[3]))


def test_upright_iiwa_height(iiwa_joints):  # type: ignore[no-untyped-def]
    # 0.36 + 0.42 + 0.40 + 0.081 m, the sum of the URDF's offsets
    np.testing.assert_allclose(link_frames(iiwa_joints[0], np.zeros(7))[-1][:3, 3], [0, 0, 1.261], atol=1e-9)


def test_a_tool_that_points_down_is_a_half_turn_about_a_level_axis():
    pose = pointing_down(0.3)
    np.testing.assert_allclose(pose[:3, 0], [np.cos(0.3), np.sin(0.3), 0.0])
    np.testing.assert_array_equal(pose[:, 2:], [[0, 0], [0, 0], [-1, 0], [0, 1]])
    np.testing.assert_allclose(pose @ pose, np.eye(4), atol=1e-15)
    assert np.linalg.det(pose) > 0


def test_flange_is_behind_the_tip():
    np.testing.assert_allclose(flange_from_tip(pointing_down(0.0), 0.2)[:3, 3], [0, 0, 0.2])


def test_wrong_shapes_are_named(iiwa_joints):  # type: ignore[no-untyped-def]
    with pytest.raises(PlanningError, match="one angle per joint"):
        link_frames(iiwa_joints[0], np.zeros(6))
    with pytest.raises(PlanningError, match="n_joints"):
        link_frames(np.eye(4), np.zeros(1))
