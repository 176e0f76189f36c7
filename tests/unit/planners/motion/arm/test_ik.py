"""Closed-form inverse kinematics: exact, complete on its grid, inverse of itself."""

from __future__ import annotations

import numpy as np
import pytest

from planners.errors import PlanningError
from planners.motion.arm.ik import SrsGeometry
from planners.motion.arm.kinematics import link_frames


def test_all_solutions_reach_the_pose_inside_the_limits(srs):  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(0)
    for q in rng.uniform(srs.lower, srs.upper, (50, 7)):
        pose = srs.flange(q)
        solutions = srs.ik_all(pose)
        assert len(solutions) > 0
        assert np.all((solutions >= srs.lower) & (solutions <= srs.upper))
        np.testing.assert_allclose(
            link_frames(srs.base_from_joint, solutions)[:, -1], np.tile(pose, (len(solutions), 1, 1)), atol=1e-8
        )


def test_arm_angle_and_branch_invert_ik_branch(srs):  # type: ignore[no-untyped-def]
    for q in np.random.default_rng(1).uniform(srs.lower, srs.upper, (300, 7)):
        angle, branch = srs.arm_angle_and_branch(q)
        np.testing.assert_allclose(srs.ik_branch(srs.flange(q), angle, branch), q, atol=1e-5)


def test_branches_bend_to_their_side(srs):  # type: ignore[no-untyped-def]
    pose = srs.flange([0.3, 0.6, 0.2, -1.2, 0.1, 0.9, 0.0])
    for branch in range(8):
        q = srs.ik_branch(pose, 0.4, branch)
        assert (q[3] > 0, q[1] > 0, q[5] > 0) == (bool(branch & 1), bool(branch & 2), bool(branch & 4))


def test_out_of_reach_is_none(srs):  # type: ignore[no-untyped-def]
    pose = np.eye(4)
    pose[:3, 3] = [2.0, 0, 0]
    assert srs.ik_branch(pose, 0.0, 0) is None
    assert srs.ik_all(pose).shape == (0, 7)


def test_moved_base_and_turned_flange(iiwa_joints):  # type: ignore[no-untyped-def]
    # The geometry is read, not assumed: another base pose and a flipped joint axis give an arm of the same kind.
    transforms, lower, upper = iiwa_joints
    base = np.eye(4)
    base[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    base[:3, 3] = [0.1, -0.2, 0.3]
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    moved = transforms.copy()
    moved[0] = base @ moved[0]
    moved[4] = moved[4] @ flip
    moved[5] = flip @ moved[5]
    srs = SrsGeometry.from_joints(moved, lower, upper)
    for q in np.random.default_rng(2).uniform(-1.5, 1.5, (20, 7)):
        pose = srs.flange(q)
        np.testing.assert_allclose(srs.flange(srs.ik_all(pose)[0]), pose, atol=1e-8)


def test_other_arms_are_refused(iiwa_joints):  # type: ignore[no-untyped-def]
    transforms, lower, upper = iiwa_joints
    bent = transforms.copy()
    bent[3, 0, 3] += 0.08  # an elbow offset, as on the Panda
    with pytest.raises(PlanningError, match="spherical"):
        SrsGeometry.from_joints(bent, lower, upper)
    with pytest.raises(PlanningError, match="6 joints"):
        SrsGeometry.from_joints(transforms[:6], lower[:6], upper[:6])
    with pytest.raises(PlanningError, match="branch 8"):
        SrsGeometry.from_joints(transforms, lower, upper).ik_branch(np.eye(4), 0.0, 8)
