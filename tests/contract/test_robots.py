"""Every robot in the table loads, has finite limits, and moves the way its specification says."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.robots import ARMS, CARS, TOOLS
from fleet.robots.arms.spec import ArmSpec
from fleet.robots.differential import LeggedChassis
from fleet.robots.spec import HINGES, WHEELS
from fleet.world.bullet.engine.client import Client

pytestmark = pytest.mark.bullet


def forward(spec: ArmSpec, q: np.ndarray) -> list[np.ndarray]:
    """Return the frame of every joint after its rotation, in the base frame."""
    pose, frames = np.eye(4), []
    for fixed, angle in zip(spec.base_from_joint, q, strict=True):
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        pose = pose @ fixed @ turn
        frames.append(pose)
    return frames


def test_every_robot_has_the_name_of_its_entry() -> None:
    for name, model in CARS.items():
        assert model.spec().name == name
    for name, arm in ARMS.items():
        assert arm.name == name


@pytest.mark.parametrize("name", CARS)
@pytest.mark.parametrize("wheels", ["sphere", "cylinder"])
def test_a_car_loads_with_either_wheel(name: str, wheels: str) -> None:
    client = Client()
    body = client.load_urdf(CARS[name].urdf(wheels), flags=client.URDF_USE_INERTIA_FROM_FILE)
    joints = {client.getJointInfo(body, joint)[1].decode() for joint in range(client.getNumJoints(body))}
    drive = CARS[name].spec().differential
    moved = {*(f"{wheel}_spin" for wheel in WHEELS), *HINGES}
    if drive is not None:
        chassis = drive.chassis
        legs = isinstance(chassis, LeggedChassis)
        moved = set(chassis.joints) if legs else {f"{roller}_spin" for roller in chassis.rollers}
    assert joints >= moved
    mass = sum(client.getDynamicsInfo(body, link)[0] for link in range(-1, len(joints)))
    assert mass == pytest.approx(CARS[name].spec().mass_kg, abs=0.05)
    client.close()


def test_the_racecar_weighs_what_its_parts_do() -> None:
    # Stock car, lidar, tray, wheels, hinges.
    assert CARS["racecar"].spec().mass_kg == pytest.approx(4.2 + 0.13 + 0.4 + 4 * 0.34055 + 2 * 0.1, abs=0.05)


@pytest.mark.parametrize("name", CARS)
def test_limits_of_a_car_are_finite_and_meshes_exist(name: str) -> None:
    spec = CARS[name].spec()
    numbers = {name: value for name, value in vars(spec).items() if isinstance(value, float)}
    assert np.isfinite(list(numbers.values())).all()
    # Places may be behind the reference point, wheels need no time to settle, and what does not steer has no steering.
    may_be = {"rear_axle_m", "tray_x_m", "settle_s"}
    may_be |= set() if spec.steers else {"max_steering_rad", "max_steering_rate_radps"}
    may_be |= set() if spec.lifts is None else {"max_payload_kg", "tray_wall_m"}  # a plate for pods, not for parcels
    assert min(value for name, value in numbers.items() if name not in may_be) > 0
    drive = spec.differential
    if drive is not None:
        assert min(vars(drive.limits).values()) > 0
    assert {"chassis", "tray"} <= {v.link for v in spec.visuals} <= {"chassis", "tray", *WHEELS}
    assert all(v.mesh is None or v.mesh.is_file() for v in spec.visuals)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("tool", TOOLS)
def test_forward_kinematics_of_an_arm_is_that_of_the_engine(name: str, tool: str) -> None:
    spec = ARMS[name].spec(TOOLS[tool])
    client = Client()
    body = client.load_urdf(spec.description, useFixedBase=True)
    rng = np.random.default_rng(0)
    for q in rng.uniform(spec.lower_rad, spec.upper_rad, (20, spec.n_joints)):
        for joint, angle in enumerate(q):
            client.resetJointState(body, joint, angle)
        for link, frame in enumerate(forward(spec, q)):
            state = client.getLinkState(body, link, computeForwardKinematics=1)
            turn = np.array(client.getMatrixFromQuaternion(state[5])).reshape(3, 3)
            np.testing.assert_allclose(frame[:3, 3], state[4], atol=1e-6)
            np.testing.assert_allclose(frame[:3, :3], turn, atol=1e-6)
    client.close()


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("tool", TOOLS)
def test_limits_of_an_arm_are_finite_and_home_is_behind_the_base(name: str, tool: str) -> None:
    spec = ARMS[name].spec(TOOLS[tool])
    limits = (spec.lower_rad, spec.upper_rad, spec.max_velocity_radps, spec.max_acceleration_radps2, spec.max_torque_nm)
    for values in limits:
        assert values.shape == (spec.n_joints,)
        assert np.isfinite(values).all()
    assert (spec.lower_rad < spec.home_rad).all()
    assert (spec.home_rad < spec.upper_rad).all()
    flange = forward(spec, spec.home_rad)[-1]
    tip = flange[:3, 3] + flange[:3, 2] * spec.tool_length_m
    np.testing.assert_allclose(tip[:2], [-0.40, 0.0], atol=1e-5)
    assert tip[2] + spec.stand_m > 0.45  # over the parcels on its slots, and over cars
    np.testing.assert_allclose(flange[:3, 2], [0.0, 0.0, -1.0], atol=1e-4)
    assert {v.link for v in spec.visuals} <= {f"link_{i}" for i in range(spec.n_joints + 1)} | {"tool"}
    assert "tool" in {v.link for v in spec.visuals}
    assert len(spec.outline.link_radii_m) == spec.n_joints
    assert all(v.mesh is None or v.mesh.is_file() for v in spec.visuals)


def test_the_tip_of_the_gripper_lies_between_its_finger_ends() -> None:
    tool = TOOLS["friction"]
    fingers = [v for v in tool.visuals if v.link_from_visual[0, 3] != 0.0]
    ends = [v.link_from_visual[2, 3] + v.size_m[2] / 2 for v in fingers]
    assert len(fingers) == 2
    assert all(end - v.size_m[2] / 2 < tool.length_m < end for end, v in zip(ends, fingers, strict=True))
    assert 2 * tool.finger_travel_m == pytest.approx(0.11)
