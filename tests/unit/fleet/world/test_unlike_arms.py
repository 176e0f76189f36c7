"""Arms of several models in one world: each moves as its own model says, and none through joints it does not have."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fleet.errors import ConfigError
from fleet.robots import ARMS, TOOLS, ArmTeam
from fleet.world.kinematic import KinematicConfig, KinematicWorld
from fleet.world.scene import Scene
from planners.motion.arm.kinematics import link_frames

NAMES = ("xarm", "iiwa", "panda")


@pytest.fixture(scope="module")
def team() -> ArmTeam:
    return ArmTeam.of([ARMS[name].spec(TOOLS["suction"]) for name in NAMES])


def test_rows_of_arms_with_fewer_joints_end_with_joints_that_stand_still(team: ArmTeam) -> None:
    assert (team.width, team.n_joints.tolist()) == (7, [6, 7, 7])
    assert np.array_equal(team.joints[0, 6], np.eye(4)[:3])
    assert team.lower_rad[0, 6] == team.upper_rad[0, 6] == team.home_rad[0, 6] == 0.0
    part = team.part([0])
    assert (len(part), part.width, part.joints.shape) == (1, 7, (1, 7, 3, 4))


def test_tips_are_where_each_model_has_them(team: ArmTeam, hall: Scene) -> None:
    base = np.array([[2.0, 4.5, 0.15, 0.3], [5.0, 4.5, 0.0, -2.0], [8.0, 4.5, 0.0, 1.0]])
    scene = dataclasses.replace(hall, arms=team, arm_base=base, arm_start=team.home_rad)
    world = KinematicWorld(scene, KinematicConfig())
    rng = np.random.default_rng(0)
    target = rng.uniform(team.lower_rad, team.upper_rad)
    target[0, 6] = 1.0  # a joint that the arm does not have
    for _ in range(200):
        world.step(np.zeros((2, 2)), target, np.zeros_like(target), np.zeros(3, dtype=np.bool_))
    q = world.arm_positions()
    assert q[0, 6] == 0.0
    target[0, 6] = 0.0
    np.testing.assert_allclose(q, target, atol=1e-9)
    for arm, spec in enumerate(team.specs):
        flange = link_frames(spec.base_from_joint, q[arm, : spec.n_joints])[-1]
        x, y, z = flange[:3, 3] + spec.tool_length_m * flange[:3, 2]
        cos, sin = np.cos(base[arm, 3]), np.sin(base[arm, 3])
        tip = base[arm, :3] + (cos * x - sin * y, sin * x + cos * y, z)
        np.testing.assert_allclose(world._arms.tips[arm, :3], tip, atol=1e-9)


def test_who_needs_arms_of_one_model_says_so(team: ArmTeam) -> None:
    with pytest.raises(ConfigError, match="the toy: arms of the models xarm, iiwa, panda; valid: arms of one model"):
        team.only("the toy")
    assert team.part([1]).only("the toy").name == "iiwa"
