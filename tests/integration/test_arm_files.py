"""Arms read from URDF, SDF and MJCF: they move as the engine says, never call a collision free, refuse bad files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pybullet_data
import pytest

from fleet.errors import ConfigError
from fleet.robots import ARMS
from fleet.world.bullet.bench.arm_file import ArmFile, ArmFileError, load, read_arm
from fleet.world.bullet.bench.dynamics import GRAVITY_MPS2, BodyDynamics
from fleet.world.bullet.confirm import PathConfirmer
from fleet.world.bullet.engine.client import Client
from planners.errors import PlanningError
from planners.motion.arm.ik import SrsGeometry
from planners.motion.arm.ik_offset import OffsetGeometry
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes

pytestmark = pytest.mark.bullet

DATA = Path(pybullet_data.getDataPath())
MJCF = """<mujoco model="a"><compiler angle="radian"/><worldbody><body name="b0" pos="0 0 0.1">
<geom type="cylinder" size="0.05 0.1"/><body name="l1" pos="0 0 0.2">
<joint name="j1" type="hinge" axis="0 0 1" range="-2 2" limited="true"/>
<geom type="capsule" fromto="0 0 0.05 0 0.1 0.3" size="0.04"/><body name="l2" pos="0 0 0.35">
<joint name="j2" type="hinge" axis="0 1 0" pos="0 0 0.02" range="-1.5 1.5" limited="true"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.04"/><body name="l3" pos="0.36 0 0">
<joint name="j3" type="hinge" axis="0.6 -0.8 0" range="-1 1" limited="true"/>
<geom type="box" size="0.1 0.03 0.03" pos="0.1 0 0"/><geom type="sphere" size="0.05" pos="0.2 0 0"/>
</body></body></body></body></worldbody></mujoco>"""
URDF = """<robot name="r"><link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
<link name="arm"><inertial><mass value="2"/><origin xyz="0 0 0.25"/><inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0"
ixz="0" iyz="0"/></inertial><collision><origin xyz="0 0 0.25"/><geometry><cylinder length="0.5" radius="0.05"/>
</geometry></collision></link>{joint}</robot>"""
HINGE = """<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.1"/>
<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="10" velocity="2"/></joint>"""


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def pairs_apart(arm: ArmFile) -> list[tuple[int, int]]:
    """Links of different rigid parts that may not touch."""
    part = arm.part_of_link
    return [(a, b) for a in part for b in part if part[a] < part[b] and (part[a], part[b]) not in arm.touching]


def engine_disagrees(arm: ArmFile, n: int) -> int:
    """States that the engine's bodies collide in although our spheres are free; forward kinematics on the way."""
    client = Client()
    body = load(client, arm.path)[arm.body]
    for name, value in arm.frozen.items():
        names = [client.getJointInfo(body, i)[1].decode() for i in range(client.getNumJoints(body))]
        client.resetJointState(body, names.index(name), value)
    local = client.getDynamicsInfo(body, -1)
    base = np.array(client.invertTransform(*local[3:5])[0]) + client.getBasePositionAndOrientation(body)[0]
    centre, half = np.array([0.45, 0.1, 0.5]), np.array([0.1, 0.15, 0.2])
    shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=half.tolist())
    box = client.createMultiBody(baseCollisionShapeIndex=shape, basePosition=(centre + base).tolist())
    checker = CollisionChecker(arm.model, Boxes.one(centre, half), margin=0.0)
    pairs = pairs_apart(arm)
    wrong = 0
    for q in np.random.default_rng(4).uniform(arm.model.lower, arm.model.upper, (n, arm.model.n_joints)):
        for joint, angle in zip(arm.joint_index, q.tolist(), strict=True):
            client.resetJointState(body, joint, angle)
        state = client.getLinkState(body, arm.joint_index[-1], computeForwardKinematics=1)
        last = arm.flange(q) @ np.linalg.inv(arm.link_from_frame[-1])
        np.testing.assert_allclose(np.array(state[4]) - base, last[:3, 3], atol=1e-4)
        if checker.free(q):
            touches = list(client.getClosestPoints(body, box, 0.0))
            for a, b in pairs:
                touches += client.getClosestPoints(body, body, 0.0, linkIndexA=a, linkIndexB=b)
            wrong += any(point[8] < 0 for point in touches)
    client.close()
    return wrong


def confirmer_agrees(arm: ArmFile) -> None:
    """The confirmer and a plain look at the same links agree on every state, and it knows where a held thing is."""
    states = np.random.default_rng(1).uniform(arm.model.lower, arm.model.upper, (150, arm.model.n_joints))
    client = Client()
    body = load(client, arm.path)[arm.body]
    pairs = pairs_apart(arm)
    touching = []
    for q in states:
        for joint, angle in zip(arm.joint_index, q.tolist(), strict=True):
            client.resetJointState(body, joint, angle)
        points = [client.getClosestPoints(body, body, 0.0, linkIndexA=a, linkIndexB=b) for a, b in pairs]
        touching.append(any(point[8] < 0 for found in points for point in found))
    client.close()
    assert any(touching), arm.path
    confirmer = PathConfirmer.of_file(arm)
    assert [not confirmer.confirm(q[None]).free for q in states] == touching
    # A thing 2 m ahead of the last link, and a box there.
    alone = next(q for q, touch in zip(states, touching, strict=True) if not touch)
    corners = np.array([[x, y, 2 + z] for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05)])
    there = (arm.flange(alone) @ np.array([0.0, 0.0, 2.0, 1.0]))[:3]
    confirmer.set_boxes(there[None], np.full((1, 3), 0.02))
    assert confirmer.confirm(alone[None]).free
    assert confirmer.confirm(alone[None], corners).what == "held thing - box"
    confirmer.close()


def test_mjcf_arm_with_tilted_axes(tmp_path: Path) -> None:
    arm = read_arm(written(tmp_path, "arm.xml", MJCF))
    assert arm.joint_names == ("j1", "j2", "j3")
    np.testing.assert_allclose(arm.model.upper, [2.0, 1.5, 1.0])
    assert engine_disagrees(arm, 400) == 0
    confirmer_agrees(arm)


@pytest.fixture
def client() -> Iterator[Client]:
    client = Client()
    yield client
    client.close()


def dynamics_of(arm: ArmFile, client: Client) -> BodyDynamics:
    client.setGravity(0.0, 0.0, -GRAVITY_MPS2)
    return BodyDynamics(client, load(client, arm.path)[arm.body], arm.joint_index)


def test_one_joint_in_numbers(tmp_path: Path, client: Client) -> None:
    arm = read_arm(written(tmp_path, "r.urdf", URDF.format(joint=HINGE)), tool_length_m=0.5)
    assert (arm.max_velocity_radps.tolist(), arm.max_torque_nm.tolist()) == ([2.0], [10.0])
    # The last frame's z is the joint's axis, and a quarter turn about y takes z to x.
    np.testing.assert_allclose(arm.flange([0.0])[:3, 2], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(arm.flange([0.0])[:3, 3], [0, 0, 0.1])
    np.testing.assert_allclose(arm.jacobian([0.3])[3:, 0], [0, 1, 0], atol=1e-12)
    dynamics = dynamics_of(arm, client)
    flat, still = np.array([np.pi / 2]), np.zeros(1)
    np.testing.assert_allclose(dynamics.mass_matrix(np.array([0.2])), [[0.1 + 2 * 0.25**2]], rtol=1e-5)
    # Lying flat, gravity pulls 2 kg at 0.25 m; upright it pulls nothing.
    np.testing.assert_allclose(dynamics.bias(flat, still), [-2 * 9.81 * 0.25], rtol=1e-5)
    np.testing.assert_allclose(dynamics.torque(still, still, np.ones(1)), [0.225], rtol=1e-5)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("none.urdf", None, "no such file"),
        ("arm.dae", "x", "unknown kind '.dae'"),
        ("broken.urdf", "<robot", "not XML"),
        ("broken.xml", "<mujoco", "not XML"),
        ("fixed.urdf", URDF.format(joint=HINGE.replace("revolute", "fixed")), "no movable joint"),
        ("slide.urdf", URDF.format(joint=HINGE.replace("revolute", "prismatic")), "'turn' of the chain slides"),
        ("flat.urdf", URDF.format(joint=HINGE).replace("0.2 0.2 0.1", "0.2 0 0.1"), "a box of size"),
        ("roots.urdf", URDF.format(joint=""), "links without a joint: base, arm"),
        (
            "loop.urdf",
            URDF.format(joint=HINGE.replace('"base"', '"arm"')),
            "links without a joint: base|hangs on itself",
        ),
        ("parents.urdf", URDF.format(joint=HINGE + HINGE), "'arm' hangs on two joints"),
        (
            "orphan.urdf",
            URDF.format(joint=HINGE.replace('"base"', '"bass"')),
            "parent 'bass'; valid: a link of the file",
        ),
        ("twice.urdf", URDF.format(joint=HINGE + '<link name="arm"/>'), "name 'arm': 2"),
        ("nan.urdf", URDF.format(joint=HINGE.replace("0 0 0.1", "nan 0 0")), "origin xyz 'nan 0 0'; valid: finite"),
        ("word.urdf", URDF.format(joint=HINGE.replace("-1.5", "low")), "limit lower 'low'"),
        ("swapped.urdf", URDF.format(joint=HINGE.replace("-1.5", "3")), "limits 3 to 1.5; valid: lower before upper"),
        ("pointless.urdf", URDF.format(joint=HINGE.replace("0 1 0", "0 0 0")), "axis '0 0 0'; valid: a direction"),
        ("light.urdf", URDF.format(joint=HINGE).replace('"2"/><origin', '"-2"/><origin'), "mass -2"),
        ("bare.urdf", URDF.format(joint=HINGE).replace("collision>", "visual>"), "no collision shapes"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, name: str, text: str | None, message: str) -> None:
    path = tmp_path / name
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(ArmFileError, match=message):
        read_arm(path)


def test_odd_input_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, "r.urdf", URDF.format(joint=HINGE))
    for wrong in ({"path": 3}, {"tool_length_m": np.nan}, {"tool_length_m": "a"}, {"allowed": [("arm",)]}):
        with pytest.raises(ArmFileError, match="valid:"):
            read_arm(**({"path": path} | wrong))  # type: ignore[arg-type]
    with pytest.raises(ArmFileError, match=r"'panda_finger_joint1' at 9.0; valid: 0 to 0.04"):
        read_arm(DATA / "franka_panda/panda.urdf", frozen={"panda_finger_joint1": 9.0})
    with pytest.raises(ConfigError, match="arm is 'nobody'; valid: iiwa, panda, xarm"):
        ARMS.named("nobody")
    arm = read_arm(path)
    confirmer = PathConfirmer.of_file(arm)
    here = np.zeros((1, 1))
    cases: list[Callable[[], object]] = [
        lambda: confirmer.confirm(np.array([[np.nan]])),
        lambda: confirmer.confirm(np.zeros((3, 4))),
        lambda: confirmer.confirm(np.empty((0, 1))),
        lambda: confirmer.confirm(here, np.full((4, 3), np.nan)),
        lambda: confirmer.confirm(here, allowance_m=np.nan),
        lambda: confirmer.set_boxes(np.full((1, 3), np.nan), np.ones((1, 3))),
        lambda: confirmer.set_boxes(np.zeros((2, 3)), np.ones((1, 3))),
        lambda: confirmer.set_boxes(np.zeros((1, 3)), -np.ones((1, 3))),
        lambda: confirmer.set_things([np.empty((0, 3))]),
    ]
    for case in cases:
        with pytest.raises(PlanningError, match="valid: "):
            case()
    assert confirmer.confirm(here).free
    confirmer.close()


def test_unknown_names_are_told(tmp_path: Path) -> None:
    path = written(tmp_path, "r.urdf", URDF.format(joint=HINGE))
    with pytest.raises(ArmFileError, match="no link 'hand'; valid: arm"):
        read_arm(path, tip="hand")
    with pytest.raises(ArmFileError, match="no joint 'finger'"):
        read_arm(path, frozen={"finger": 0.0})
    with pytest.raises(ArmFileError, match="no link 'x'; valid: base, arm"):
        read_arm(path, allowed=[("x", "arm")])


@pytest.mark.slow
def test_the_arms_that_ship_with_the_engine(client: Client) -> None:
    panda = read_arm(DATA / "franka_panda/panda.urdf", frozen={"panda_finger_joint1": 0.04})
    assert isinstance(panda.inverse, OffsetGeometry)
    assert panda.frozen == {"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.0}
    xarm = read_arm(DATA / "xarm/xarm6_robot.urdf")
    iiwa = read_arm(DATA / "kuka_iiwa/kuka_with_gripper2.sdf", tip="lbr_iiwa_link_7")
    assert isinstance(iiwa.inverse, SrsGeometry)
    assert [arm.model.n_joints for arm in (panda, xarm, iiwa)] == [7, 6, 7]
    for arm in (panda, xarm, iiwa):
        assert engine_disagrees(arm, 300) == 0
        confirmer_agrees(arm)
        q = np.random.default_rng(0).uniform(arm.model.lower, arm.model.upper)
        for found in arm.inverse.ik_all(arm.flange(q)):
            np.testing.assert_allclose(arm.flange(found), arm.flange(q), atol=1e-4)
    mass = dynamics_of(panda, client).mass_matrix(np.zeros(7))
    np.testing.assert_allclose(mass, mass.T, atol=1e-9)
    assert np.linalg.eigvalsh(mass).min() > 0
