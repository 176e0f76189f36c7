"""Straight tool lines: on the line, inside limits, without jumps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from planners.errors import PlanningError
from planners.motion.arm.kinematics import flange_from_tip
from planners.motion.path.cartesian import cartesian_line, turned

TOOL = 0.185


def _down(x, y, z, roll):  # type: ignore[no-untyped-def]
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("ZX", [roll, np.pi]).as_matrix()
    pose[:3, 3] = x, y, z
    return pose


@pytest.mark.parametrize("place", [(0.6, 0.0), (-0.19, 0.41), (-0.41, -0.19)])
def test_every_nearby_solution_descends_straight(srs, place):  # type: ignore[no-untyped-def]
    above, below = _down(*place, 0.47, 0.5), _down(*place, 0.30, 0.5)
    starts = srs.ik_all(flange_from_tip(above, TOOL), 8)
    found = 0
    for start in starts:
        path = cartesian_line(srs, start, below, 10, tool_length_m=TOOL)
        if path is None:
            continue
        found += 1
        flanges = np.array([srs.flange(q) for q in path])
        tips = flanges[:, :3, 3] + TOOL * flanges[:, :3, 2]
        expected = above[:3, 3] + np.linspace(0, 1, 11)[:, None] * (below[:3, 3] - above[:3, 3])
        np.testing.assert_allclose(tips, expected, atol=1e-7)
        np.testing.assert_allclose(flanges[:, :3, :3], np.tile(above[:3, :3], (11, 1, 1)), atol=1e-6)
        assert np.abs(np.diff(path, axis=0)).max() <= 0.25
        assert np.all((path >= srs.lower) & (path <= srs.upper))
        assert {srs.arm_angle_and_branch(q)[1] for q in path} == {srs.arm_angle_and_branch(start)[1]}
    assert found >= 0.8 * len(starts) > 0


def test_rotation_turns_about_the_tip(srs):  # type: ignore[no-untyped-def]
    solutions = srs.ik_all(flange_from_tip(_down(0.5, 0.1, 0.4, 0.0), TOOL), 8)
    start = solutions[np.argmin(np.abs(solutions / srs.upper).max(1))]  # far from the limits
    goal = _down(0.5, 0.1, 0.4, 0.0)
    goal[:3, :3] = goal[:3, :3] @ Rotation.from_euler("x", 0.3).as_matrix()
    path = cartesian_line(srs, start, goal, 8, tool_length_m=TOOL)
    assert path is not None
    flanges = np.array([srs.flange(q) for q in path])
    np.testing.assert_allclose(flanges[:, :3, 3] + TOOL * flanges[:, :3, 2], np.tile(goal[:3, 3], (9, 1)), atol=1e-7)
    np.testing.assert_allclose(flanges[-1][:3, :3], goal[:3, :3], atol=1e-6)


def test_out_of_reach_and_jumps_are_none(srs):  # type: ignore[no-untyped-def]
    start = srs.ik_all(flange_from_tip(_down(0.5, 0.0, 0.4, 0.0), TOOL), 8)[0]
    assert cartesian_line(srs, start, _down(1.5, 0.0, 0.4, 0.0), 20, tool_length_m=TOOL) is None
    assert cartesian_line(srs, start, _down(0.5, 0.0, 0.2, 0.0), 1, tool_length_m=TOOL, max_joint_step_rad=0.01) is None
    assert cartesian_line(srs, np.full(7, 3.0), _down(0.5, 0.0, 0.2, 0.0), 5) is None


def test_malformed_input_is_named(srs):  # type: ignore[no-untyped-def]
    with pytest.raises(PlanningError, match="n_steps 0"):
        cartesian_line(srs, np.zeros(7), np.eye(4), 0)


def test_turns_have_a_constant_rate_and_reach_their_end():  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(0)
    parts = np.linspace(0.0, 1.0, 5)
    rotation_vectors = [*rng.normal(size=(20, 3)), np.zeros(3), *(np.pi * np.eye(3)), 1e-9 * np.eye(3)[0]]
    for first, relative in zip(Rotation.random(25, random_state=1), rotation_vectors, strict=True):
        last = first * Rotation.from_rotvec(relative)
        on_the_way = Rotation.from_matrix(turned(first.as_matrix(), last.as_matrix(), parts))
        np.testing.assert_allclose(on_the_way[0].as_matrix(), first.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(on_the_way[-1].as_matrix(), last.as_matrix(), atol=1e-12)
        angles = (on_the_way[0].inv() * on_the_way).magnitude()
        np.testing.assert_allclose(angles, parts * _angle_between(first, last), atol=1e-9)


def _angle_between(first: Rotation, last: Rotation) -> float:
    return float((first.inv() * last).magnitude())
