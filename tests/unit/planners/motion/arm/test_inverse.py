"""Inverse kinematics of other arms: the Panda in closed form, any arm by descent, and who gets which."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from planners.errors import PlanningError
from planners.motion.arm.ik import SrsGeometry
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.arm.ik_offset import OffsetGeometry
from planners.motion.arm.inverse import inverse_kinematics
from planners.motion.arm.kinematics import jacobian, link_frames

FloatArray = npt.NDArray[np.float64]


def turned_about_x(quarters: int, *offset: float) -> FloatArray:
    """A joint transform: a turn about x by quarters of a circle and an offset [m]."""
    cos, sin = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][quarters % 4]
    pose = np.eye(4)
    pose[:3, :3] = [[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]]
    pose[:3, 3] = offset
    return pose


PANDA = np.stack(
    [
        turned_about_x(0, 0, 0, 0.333),
        turned_about_x(-1, 0, 0, 0),
        turned_about_x(1, 0, -0.316, 0),
        turned_about_x(1, 0.0825, 0, 0),
        turned_about_x(-1, -0.0825, 0.384, 0),
        turned_about_x(1, 0, 0, 0),
        turned_about_x(1, 0.088, 0, 0),
    ]
)
"""Franka Emika, Robot and interface specifications: Denavit-Hartenberg parameters."""
LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])


@pytest.fixture(scope="module")
def panda() -> OffsetGeometry:
    return OffsetGeometry.from_joints(PANDA, LOWER, UPPER)


def check(found: FloatArray, pose: FloatArray, atol: float) -> None:
    assert len(found) > 0
    assert np.all((found >= LOWER) & (found <= UPPER))
    np.testing.assert_allclose(link_frames(PANDA, found)[:, -1], np.tile(pose, (len(found), 1, 1)), atol=atol)


def test_panda_solutions_reach_the_pose_inside_the_limits(panda: OffsetGeometry) -> None:
    for q in np.random.default_rng(0).uniform(LOWER, UPPER, (100, 7)):
        check(panda.ik_all(panda.flange(q)), panda.flange(q), 1e-8)


def test_panda_finds_the_configuration_it_came_from(panda: OffsetGeometry) -> None:
    for q in np.random.default_rng(1).uniform(LOWER, UPPER, (200, 7)):
        found = panda.at_last_joint(panda.flange(q), q[-1])
        assert np.abs(found - q).max(axis=1).min() < 1e-5


def test_panda_out_of_reach(panda: OffsetGeometry) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 2.0, 0.0, 0.0
    assert panda.ik_all(pose).shape == (0, 7)
    assert panda.at_last_joint(pose, 0.0).shape == (0, 7)


def test_descent_solves_the_panda_and_repeats(panda: OffsetGeometry) -> None:
    numeric = NumericInverse.from_joints(PANDA, LOWER, UPPER)
    for q in np.random.default_rng(2).uniform(LOWER, UPPER, (100, 7)):
        found = numeric.ik_all(panda.flange(q), n_wanted=4)
        check(found, panda.flange(q), 1e-4)
        assert found.tobytes() == numeric.ik_all(panda.flange(q), n_wanted=4).tobytes()
        near = numeric.ik_near(panda.flange(q), q + 0.01)
        assert near is None or np.abs(near - q).max() < 0.1


def test_descent_gives_up(panda: OffsetGeometry) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 2.0, 0.0, 0.0
    numeric = NumericInverse.from_joints(PANDA, LOWER, UPPER)
    assert numeric.ik_all(pose).shape == (0, 7)
    assert numeric.ik_near(pose, np.zeros(7)) is None


def test_jacobian_is_the_derivative() -> None:
    q = np.random.default_rng(3).uniform(LOWER, UPPER)
    slope = jacobian(PANDA, q)
    for i in range(7):
        step = np.zeros(7)
        step[i] = 1e-6
        before, after = (link_frames(PANDA, q + sign * step)[-1] for sign in (-1.0, 1.0))
        np.testing.assert_allclose((after - before)[:3, 3] / 2e-6, slope[:3, i], atol=1e-7)
        spin = (after - before)[:3, :3] @ link_frames(PANDA, q)[-1][:3, :3].T / 2e-6
        np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], slope[3:, i], atol=1e-7)
    with pytest.raises(PlanningError, match=r"valid: \(7,\)"):
        jacobian(PANDA, np.zeros(6))


def test_the_best_solver_is_chosen(iiwa_joints) -> None:  # type: ignore[no-untyped-def]
    assert isinstance(inverse_kinematics(*iiwa_joints), SrsGeometry)
    assert isinstance(inverse_kinematics(PANDA, LOWER, UPPER), OffsetGeometry)
    six = inverse_kinematics(PANDA[:6], LOWER[:6], UPPER[:6])
    pose = six.flange(np.array([0.1, 0.2, 0.3, -1.5, 0.4, 1.0]))
    for q in six.ik_all(pose):
        np.testing.assert_allclose(six.flange(q), pose, atol=1e-4)


def test_malformed_arms_are_refused() -> None:
    with pytest.raises(PlanningError, match="7 of each"):
        OffsetGeometry.from_joints(PANDA[:6], LOWER[:6], UPPER[:6])
    bent = PANDA.copy()
    bent[2, 0, 3] += 0.1
    with pytest.raises(PlanningError, match="meet in one point"):
        OffsetGeometry.from_joints(bent, LOWER, UPPER)
    with pytest.raises(PlanningError, match="finite"):
        NumericInverse.from_joints(PANDA, LOWER, np.full(7, np.inf))
