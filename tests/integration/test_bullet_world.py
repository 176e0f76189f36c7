"""The physical world: driving, contacts, grips, snapshots and silence."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt
import pytest

from fleet.config import Connect, Grip
from fleet.errors import ConfigError
from fleet.robots import ARMS, TOOLS, ArmTeam
from fleet.robots.cars.racecar import racecar_spec
from fleet.world.bullet import BulletConfig, BulletWorld
from fleet.world.bullet.confirm import PathConfirmer
from fleet.world.bullet.engine.client import Client, PhysicsError
from fleet.world.bullet.engine.config import exact_tick_s
from fleet.world.protocol import ParcelBody
from fleet.world.scene import Scene, StaticBox
from planners.errors import PlanningError

FloatArray = npt.NDArray[np.float64]

pytestmark = pytest.mark.bullet

# Straight down in front of the base: tip 0.45 m ahead and 0.10 m above a parcel of 0.08 m on a slot at z = 0.25 m.
SLOT = (0.45, 0.0, 0.25)
SLOT_BOX = StaticBox(kind="pedestal", centre_m=(0.45, 0.0, 0.125), half_m=(0.08, 0.08, 0.125))

MakeWorld = Callable[..., BulletWorld]


def scene_of(**parts: object) -> Scene:
    """Return an empty floor of 10 x 10 m with `parts` on it."""
    empty = Scene(
        size_m=(10.0, 10.0),
        boxes=(),
        car_kinds=(racecar_spec(),),
        car_start=np.zeros((0, 3)),
        arms=ArmTeam.alike(ARMS["iiwa"].spec(), 0),
        arm_base=np.zeros((0, 4)),
        arm_start=np.zeros((0, 7)),
    )
    return dataclasses.replace(empty, **parts)  # type: ignore[arg-type]


@pytest.fixture
def make_world() -> Iterator[MakeWorld]:
    """Return a maker of worlds; all are closed at the end."""
    worlds: list[BulletWorld] = []

    def make(
        cars: list[tuple[float, float, float]] | None = None,
        arms: list[tuple[float, float, float, float]] | None = None,
        boxes: tuple[StaticBox, ...] = (),
        start: FloatArray | None = None,
        **config: object,
    ) -> BulletWorld:
        settings = BulletConfig(**config)  # type: ignore[arg-type]
        arm = ARMS["iiwa"].spec(TOOLS[settings.grip.value])
        n_arms = len(arms or [])
        scene = scene_of(
            boxes=boxes,
            car_start=np.array(cars or [], dtype=np.float64).reshape(-1, 3),
            arms=ArmTeam.alike(arm, n_arms),
            arm_base=np.array(arms or [], dtype=np.float64).reshape(-1, 4),
            arm_start=np.tile(arm.home_rad if start is None else start, (n_arms, 1)),
        )
        world = BulletWorld(scene, settings)
        worlds.append(world)
        return world

    yield make
    for world in worlds:
        world.close()


def run(
    world: BulletWorld,
    seconds: float,
    command: tuple[float, float] = (0.0, 0.0),
    q: FloatArray | None = None,
    grip: bool = False,
) -> None:
    """Repeat one command for all cars while the arms stand."""
    goal = world.arm_positions() if q is None else np.tile(q, (world.n_arms, 1))
    for _ in range(round(seconds / world.tick_s)):
        world.step(
            np.tile(command, (world.n_cars, 1)), goal, np.zeros_like(goal), np.full(world.n_arms, grip, dtype=np.bool_)
        )


def sweep(world: BulletWorld, a: FloatArray, b: FloatArray, seconds: float, grip: bool) -> float:
    """Move every arm from a to b on a quintic; return the largest joint error [rad]."""
    n, worst = round(seconds / world.tick_s), 0.0
    for k in range(1, n + 1):
        s = k / n
        q = np.tile(a + (b - a) * (10 * s**3 - 15 * s**4 + 6 * s**5), (world.n_arms, 1))
        qd = np.tile((b - a) * (30 * s**2 - 60 * s**3 + 30 * s**4) / seconds, (world.n_arms, 1))
        world.step(np.zeros((world.n_cars, 2)), q, qd, np.full(world.n_arms, grip, dtype=np.bool_))
        worst = max(worst, float(np.abs(world.arm_positions() - q).max()))
    return worst


def above(tip_x: float, tip_z: float, tool: str) -> FloatArray:
    """Joints with the tool pointing down in front of the base: a planar two-link solution."""
    x, z = (
        tip_x,
        tip_z + ARMS["iiwa"].spec(TOOLS[tool]).tool_length_m + 0.081 - 0.36,
    )  # last step of the wrist, height of the shoulder
    reach = np.hypot(x, z)
    bend = np.arccos((reach**2 - 0.42**2 - 0.40**2) / (2 * 0.42 * 0.40))
    upper = np.arctan2(x, z) - np.arcsin(0.40 * np.sin(bend) / reach)
    return np.array([0.0, upper, 0.0, -bend, 0.0, np.pi - upper - bend, 0.0])


def parcel(number: int, mass_kg: float = 0.5, size: float = 0.08, at: tuple[float, float, float] = SLOT) -> ParcelBody:
    pose = np.array([at[0], at[1], at[2] + size / 2 + 0.0005, 0.0, 0.0, 0.0, 1.0])
    return ParcelBody(parcel=number, size_m=(size, size, size), mass_kg=mass_kg, pose=pose)


def test_a_car_drives_straight_and_brakes(make_world: MakeWorld) -> None:
    world = make_world(cars=[(1.0, 1.0, 0.0)])
    for k in range(60):
        run(world, world.tick_s, (0.0, (k + 1) / 60))
    assert world.car_speeds()[0] == pytest.approx(1.0, abs=0.05)
    run(world, 1.5, (0.0, 1.0))
    x, y, yaw = world.car_poses()[0]
    assert x == pytest.approx(3.0, abs=0.05)
    assert abs(y - 1.0) < 0.01
    assert abs(yaw) < 0.01
    run(world, 0.5)
    stop = world.car_poses()[0]
    assert stop[0] - x < 0.15
    run(world, 5.0)
    np.testing.assert_allclose(world.car_poses()[0], stop, atol=5e-4)  # a standing car does not creep


AT_ONCE = BulletConfig(tick_s=exact_tick_s(8, 240.0), n_steps_per_call=8)
"""Eight steps of 1/240 s in one call of the engine."""


def test_motors_are_as_strong_when_steps_are_made_at_once(make_world: MakeWorld) -> None:
    gained = []
    for at_once in (False, True):
        settings = {"tick_s": AT_ONCE.tick_s, "n_steps_per_call": 8} if at_once else {"tick_s": AT_ONCE.tick_s / 4}
        world = make_world(cars=[(1.0, 1.0, 0.0)], **settings)
        run(world, 0.2, (0.0, 2.0))
        gained.append(world.car_speeds()[0])
    torque_nm, radius_m = 0.6, 0.05
    mass_kg = sum(world._client.getDynamicsInfo(world._cars.bodies[0], link)[0] for link in range(-1, 6))
    assert gained[1] == pytest.approx(gained[0], rel=0.05)
    assert gained[1] < 0.2 * 4 * torque_nm / radius_m / mass_kg


def test_an_arm_too_weak_for_its_weight_sinks_also_when_steps_are_made_at_once() -> None:
    arm = ARMS["iiwa"].spec()
    weak = dataclasses.replace(arm, max_torque_nm=arm.max_torque_nm * 0.1)
    level = np.array([0.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0])
    scene = scene_of(arms=ArmTeam.alike(weak, 1), arm_base=np.array([[5.0, 5.0, 1.5, 0.0]]), arm_start=level[None])
    sunk = []
    for config in (BulletConfig(tick_s=AT_ONCE.tick_s / 4), AT_ONCE):
        world = BulletWorld(scene, config)
        run(world, 0.2)
        sunk.append(world.arm_positions()[0, 1] - level[1])
        world.close()
    assert sunk[0] > 0.02
    assert sunk[1] == pytest.approx(sunk[0], rel=0.05)


def test_a_car_hardly_creeps_on_its_wheels_when_steps_are_made_at_once(make_world: MakeWorld) -> None:
    world = make_world(cars=[(1.0, 1.0, 0.0), (3.0, 1.0, 0.7)], tick_s=AT_ONCE.tick_s, n_steps_per_call=8)
    run(world, 1.0, (0.5, 0.6))
    run(world, 1.0)
    stop = world.car_poses()
    run(world, 20.0)
    np.testing.assert_allclose(world.car_poses(), stop, atol=20.0 * 0.00015)  # 0.15 mm/s


def test_wheels_touch_the_floor_only(make_world: MakeWorld) -> None:
    """Beside each other cars are 5 mm apart, and wheels stand out by 10 mm."""
    side_m = 2 * racecar_spec().half_width_m + 0.005
    world = make_world(cars=[(1.0, 1.0, 0.0), (1.0, 1.0 + side_m, 0.0)])
    start = world.car_poses()
    run(world, 0.5)
    np.testing.assert_allclose(world.car_poses(), start, atol=1e-5)
    assert world.contacts().robot == 0


def test_positive_steering_turns_left_on_the_circle_of_the_bicycle(make_world: MakeWorld) -> None:
    world = make_world(cars=[(2.0, 2.0, 0.0)])
    run(world, 1.0, (0.4, 0.5))
    assert world.car_steering()[0] == pytest.approx(0.4, abs=0.01)
    before = world.car_poses()[0, 2]
    run(world, 1.0, (0.4, 0.5))
    turned = world.car_poses()[0, 2] - before
    assert turned == pytest.approx(0.5 * np.tan(0.4) / 0.325, rel=0.1)


def test_two_cars_that_meet_are_one_robot_contact(make_world: MakeWorld) -> None:
    world = make_world(cars=[(1.0, 1.0, 0.0), (3.0, 1.05, np.pi)])
    run(world, 1.0, (0.0, 0.5))
    assert world.contacts().robot == 0
    assert world.min_clearance_m() > 0.0
    run(world, 2.5, (0.0, 0.5))
    assert world.contacts().robot == 1
    assert world.contacts().static == 0
    assert world.min_clearance_m() == 0.0


def test_a_car_against_a_wall_is_one_static_contact(make_world: MakeWorld) -> None:
    wall = StaticBox(kind="wall", centre_m=(2.5, 1.0, 0.5), half_m=(0.5, 1.0, 0.5))
    world = make_world(cars=[(1.0, 1.0, 0.0)], boxes=(wall,))
    run(world, 3.0, (0.0, 0.5))
    assert world.contacts().static == 1
    assert world.contacts().robot == 0
    assert world.car_poses()[0, 0] < 1.62


def test_an_obstacle_comes_and_goes(make_world: MakeWorld) -> None:
    world = make_world(cars=[(1.0, 1.0, 0.0)])
    origin, end = np.array([[1.0, 3.0, 0.3]]), np.array([[5.0, 3.0, 0.3]])
    world.add_obstacle(4, np.array([3.0, 3.0, 0.5]), np.array([0.5, 0.5, 0.5]))
    assert world.rays(origin, end)[0] == pytest.approx(1.5 / 4.0)
    world.remove_obstacle(4)
    assert world.rays(origin, end)[0] == 1.0
    with pytest.raises(PhysicsError, match="obstacle 4"):
        world.remove_obstacle(4)


def test_a_parcel_stays_in_the_tray_and_is_no_contact(make_world: MakeWorld) -> None:
    world = make_world(cars=[(1.0, 1.0, 0.0)])
    car = racecar_spec()
    world.add_parcel(parcel(3, mass_kg=2.0, at=(1.0 + car.tray_x_m, 1.0, car.tray_floor_z_m)))
    for k in range(60):
        run(world, world.tick_s, (0.3, 1.5 * (k + 1) / 60))
    run(world, 1.0, (-0.3, 1.5))
    run(world, 1.0)
    x, y, yaw = world.car_poses()[0]
    offset = world.parcel_poses()[0, :2] - [x, y]
    ahead, left = offset @ [np.cos(yaw), np.sin(yaw)], offset @ [-np.sin(yaw), np.cos(yaw)]
    assert abs(ahead - car.tray_x_m) < car.tray_size_m[0] / 2
    assert abs(left) < car.tray_size_m[1] / 2
    assert world.parcel_poses()[0, 2] == pytest.approx(car.tray_floor_z_m + 0.04, abs=0.002)
    assert world.contacts().robot == world.contacts().static == 0


def test_a_push_displaces_a_car(make_world: MakeWorld) -> None:
    world = make_world(cars=[(2.0, 2.0, 0.3)])
    world.push_car(0, 0.2, -0.3, 0.5)
    run(world, 1.0)
    np.testing.assert_allclose(world.car_poses()[0], [2.2, 1.7, 0.8], atol=0.02)


@pytest.mark.parametrize("grip", list(Grip))
def test_a_grip_lifts_a_parcel_and_drops_it_when_told(make_world: MakeWorld, grip: Grip) -> None:
    tip = SLOT[2] + (0.083 if grip is Grip.SUCTION else 0.04)
    low, high = above(SLOT[0], tip, grip.value), above(SLOT[0], tip + 0.1, grip.value)
    world = make_world(arms=[(0.0, 0.0, 0.0, 0.0)], boxes=(SLOT_BOX,), start=high, grip=grip)
    world.add_parcel(parcel(5))
    assert sweep(world, high, low, 1.0, grip=False) < 5e-3
    assert world.held()[0] == -1
    run(world, 0.5, q=low, grip=True)
    assert world.held()[0] == 5
    sweep(world, low, high, 1.0, grip=True)
    assert world.held()[0] == 5
    assert world.parcel_poses()[0, 2] == pytest.approx(SLOT[2] + 0.04 + 0.1, abs=0.01)
    run(world, 0.8, q=high, grip=False)
    assert world.held()[0] == -1
    assert world.parcel_poses()[0, 2] < SLOT[2] + 0.06
    assert world.contacts().robot == world.contacts().static == 0


def test_a_parcel_above_the_limit_of_the_cup_is_dropped(make_world: MakeWorld) -> None:
    low, high = above(SLOT[0], SLOT[2] + 0.083, "suction"), above(SLOT[0], SLOT[2] + 0.183, "suction")
    world = make_world(arms=[(0.0, 0.0, 0.0, 0.0)], boxes=(SLOT_BOX,), start=low, grip_force_n=24.0)
    world.add_parcel(parcel(5, mass_kg=2.0))
    run(world, 0.2, q=low, grip=True)
    sweep(world, low, high, 2.0, grip=True)  # 19.6 N of weight and little more
    assert world.held()[0] == 5
    sweep(world, high, low, 0.3, grip=True)
    run(world, 0.1, q=low, grip=True)
    sweep(world, low, high, 0.3, grip=True)
    assert world.held()[0] == -1
    assert "N, the cup holds 24.0 N" in world.grip_loss(0)
    assert world.parcel_poses()[0, 2] < SLOT[2] + 0.06


def test_an_arm_may_touch_the_tray_it_serves_only(make_world: MakeWorld) -> None:
    car = racecar_spec()
    tray = (0.55, 0.0, car.tray_floor_z_m)
    low, high = above(0.55, tray[2] - 0.002, "suction"), above(0.55, tray[2] + 0.15, "suction")
    for serving, expected in ((0, 0), (-1, 1)):
        world = make_world(cars=[(0.55, -car.tray_x_m, np.pi / 2)], arms=[(0.0, 0.0, 0.0, 0.0)], start=high)
        world.set_serving(0, serving)
        sweep(world, high, low, 1.0, grip=False)
        run(world, 0.2, q=low)
        assert world.contacts().robot == expected


@pytest.mark.parametrize(
    ("serving", "tip_z", "carries", "touches"),
    [
        pytest.param(-1, 0.45, False, False, id="hovers"),
        pytest.param(-1, 0.20, False, True, id="dips"),
        pytest.param(1, 0.20, False, True, id="dips while it serves another"),
        pytest.param(0, 0.09, False, True, id="dips before the tray it serves"),
        pytest.param(-1, 0.45, True, False, id="carries high"),
        pytest.param(-1, 0.30, True, True, id="carries low"),
    ],
)
def test_an_arm_that_dips_before_a_passing_car_touches_it(
    make_world: MakeWorld, serving: int, tip_z: float, carries: bool, touches: bool
) -> None:
    on_slot, off_slot = above(0.45, SLOT[2] + 0.083, "suction"), above(0.45, 0.50, "suction")
    aside = np.array([np.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    high, low = above(0.55, 0.45, "suction") + aside, above(0.55, tip_z, "suction") + aside
    world = make_world(
        cars=[(-1.6, 0.55, 0.0), (3.0, 3.0, 0.0)],
        arms=[(0.0, 0.0, 0.0, 0.0)],
        boxes=(SLOT_BOX,),
        start=on_slot if carries else high,
    )
    world.set_serving(0, serving)
    if carries:
        world.add_parcel(parcel(1))
        run(world, 0.2, q=on_slot, grip=True)
        sweep(world, on_slot, off_slot, 1.0, grip=True)
        sweep(world, off_slot, high, 2.0, grip=True)
        assert world.held()[0] == 1
    for tick in range(round(3.5 / world.tick_s)):
        q = high + (low - high) * np.clip(tick * world.tick_s - 1.0, 0.0, 1.0)
        command = np.array([[0.0, 0.5], [0.0, 0.0]])
        world.step(command, q[None], np.zeros((1, 7)), np.array([carries]))
    assert (world.contacts().robot > 0) == touches
    assert world.contacts().static == 0
    assert (world.min_clearance_m() == 0.0) == (touches and serving != 0)


def test_two_fresh_worlds_agree_to_the_last_bit_and_a_snapshot_returns_exactly(make_world: MakeWorld) -> None:
    def play(world: BulletWorld) -> bytes:
        home = world.arm_positions()
        for k in range(30):
            q = home + 0.1 * np.sin(k / 10)
            world.step(np.array([[0.2, 0.8], [-0.1, 0.5]]), q, np.zeros_like(q), np.zeros(1, dtype=np.bool_))
        return world.state_bytes()

    def build() -> BulletWorld:
        world = make_world(cars=[(1.0, 1.0, 0.0), (1.0, 3.0, 0.0)], arms=[(4.0, 4.0, 0.0, 1.0)])
        world.add_parcel(parcel(1, at=(1.16, 1.0, 0.18)))
        run(world, 0.2)
        return world

    first, second = build(), build()
    snapshot = first.save()
    saved = first.state_bytes()
    after = play(first)
    assert after == play(second)
    assert after != saved
    first.load(snapshot)
    assert first.state_bytes() == saved
    assert play(first) == after


def test_a_snapshot_of_standing_robots_returns_exactly(make_world: MakeWorld) -> None:
    def play(world: BulletWorld) -> bytes:
        run(world, 0.5)
        run(world, 0.5, (0.3, 0.7))
        run(world, 1.0)
        return world.state_bytes()

    world = make_world(cars=[(1.0, 1.0, 0.0), (1.0, 3.0, 0.0)], arms=[(4.0, 4.0, 0.0, 1.0)])
    run(world, 0.3, (0.5, 0.8))
    run(world, 1.5)
    snapshot, saved = world.save(), world.state_bytes()
    after = play(world)
    world.load(snapshot)
    assert world.state_bytes() == saved
    assert play(world) == after


def test_a_snapshot_brings_back_what_left_and_removes_what_came(make_world: MakeWorld) -> None:
    world = make_world(cars=[(1.0, 1.0, 0.0)])
    world.add_parcel(parcel(1, at=(3.0, 3.0, 0.0)))
    run(world, 0.5)
    snapshot = world.save()
    poses = world.parcel_poses()
    world.remove_parcel(1)
    world.add_parcel(parcel(2, at=(4.0, 4.0, 0.0)))
    world.add_obstacle(0, np.array([5.0, 5.0, 0.5]), np.array([0.5, 0.5, 0.5]))
    run(world, 0.5, (0.0, 1.0))
    world.load(snapshot)
    assert world.parcel_ids().tolist() == [1]
    np.testing.assert_allclose(world.parcel_poses(), poses)
    assert world.car_poses()[0, 0] == pytest.approx(1.0, abs=1e-3)
    with pytest.raises(PhysicsError, match="obstacle 0"):
        world.remove_obstacle(0)


@pytest.mark.parametrize("mine", [Grip.FRICTION, Grip.SUCTION])
def test_another_world_of_the_process_changes_nothing(make_world: MakeWorld, mine: Grip) -> None:
    """The engine has one distance at which contacts end for all its connections; each kind of grip needs its own."""

    def driven(world: BulletWorld) -> bytes:
        run(world, 0.5, (0.2, 1.0))
        return world.state_bytes()

    alone = driven(make_world(cars=[(1.0, 1.0, 0.0)], grip=mine))
    world = make_world(cars=[(1.0, 1.0, 0.0)], grip=mine)
    other = Grip.SUCTION if mine is Grip.FRICTION else Grip.FRICTION
    beside = make_world(cars=[(1.0, 1.0, 0.0)], grip=other)
    run(beside, 0.1)
    PathConfirmer.of_spec(ARMS["iiwa"].spec()).close()
    assert driven(world) == alone


def test_a_path_is_confirmed_or_refused_with_its_first_bad_state() -> None:
    spec = ARMS["iiwa"].spec(TOOLS["suction"])
    confirmer = PathConfirmer.of_spec(spec)
    path = spec.home_rad + np.linspace(0.0, 1.5, 100)[:, None] * np.eye(7)[0]
    held = np.array([[x, y, spec.tool_length_m + z] for x in (-0.04, 0.04) for y in (-0.04, 0.04) for z in (0.0, 0.08)])
    assert confirmer.confirm(path).free
    # Just below where the tip passes after 0.8 rad: the held parcel strikes it, the bare tool does not.
    centre = np.array([[0.40 * np.cos(np.pi + 0.8), 0.40 * np.sin(np.pi + 0.8), 0.55]])
    confirmer.set_boxes(centre, np.full((1, 3), 0.03))
    assert confirmer.confirm(path).free
    verdict = confirmer.confirm(path, held)
    assert (verdict.free, verdict.what) == (False, "held thing - box")
    assert 0.0 < path[verdict.first_index, 0] < 0.8
    # The same as a thing of four corners.
    confirmer.set_boxes(np.empty((0, 3)), np.empty((0, 3)))
    confirmer.set_things([centre + 0.03 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])])
    assert confirmer.confirm(path).free
    assert confirmer.confirm(path, held).what == "held thing - thing 0"
    folded = np.array([0.0, -2.0, 0.0, 2.0, 0.0, -1.8, 0.0])
    assert confirmer.confirm(np.array([spec.home_rad, folded])).first_index == 1
    # What an arm stands on counts for all but its lowest links.
    table = (np.array([[0.0, 0.0, 0.0]]), np.array([[0.9, 0.9, 0.2]]))
    confirmer.set_things([])
    confirmer.set_boxes(*table)
    assert confirmer.confirm(path).what == "lbr_iiwa_link_1 - box"
    confirmer.set_boxes(*table, min_frame=np.array([2]))
    assert confirmer.confirm(path).free
    assert confirmer.confirm(np.array([[0.0, 2.09, 0.0, 0.0, 0.0, 0.0, 0.0]])).what.endswith(" - box")
    confirmer.close()


def test_the_arm_that_confirms_is_the_one_of_the_model() -> None:
    tool = TOOLS["suction"]
    spec = ARMS["iiwa"].spec(tool)
    other = dataclasses.replace(spec, description=spec.description.replace("lbr_iiwa", "other"))
    confirmer = PathConfirmer.of_spec(other)
    confirmer.set_boxes(np.zeros((1, 3)), np.array([[0.9, 0.9, 0.2]]))
    assert confirmer.confirm(spec.home_rad[None]).what == "other_link_1 - box"
    confirmer.close()


def test_arms_that_meet_are_told() -> None:
    spec = ARMS["iiwa"].spec(TOOLS["suction"])
    confirmer = PathConfirmer.of_spec(spec)
    reach = np.array([np.pi / 2, 1.2, 0.0, -0.3, 0.0, 0.0, 0.0])  # along y, where the other arm stands
    path = spec.home_rad + np.linspace(0.0, 1.0, 50)[:, None] * (reach - spec.home_rad)
    still = np.tile(spec.home_rad, (50, 1))
    with pytest.raises(PlanningError, match="neighbour None"):
        confirmer.confirm_beside(path, still)
    confirmer.set_neighbour(spec, np.array([0.0, 0.8, 0.0]))
    assert confirmer.confirm_beside(still, still).free
    verdict = confirmer.confirm_beside(path, still)
    assert not verdict.free
    assert 10 < verdict.first_index < 50
    assert " - the other arm's " in verdict.what
    assert confirmer.confirm(path).free  # one path alone is not asked about the other arm
    confirmer.close()


def test_a_closed_connection_does_not_reach_the_next_one() -> None:
    """The engine gives the number of a closed connection to the next: its functions would act there."""
    first = Client()
    first.setGravity(0.0, 0.0, -9.81)
    number = first.id
    first.close()
    second = Client()
    assert second.id == number
    for name in ("setGravity", "stepSimulation"):
        with pytest.raises(PhysicsError, match=f"{name}: the connection to the physics engine is closed"):
            getattr(first, name)()
    second.close()


def test_bad_worlds_are_refused(make_world: MakeWorld, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(PhysicsError, match="physics server with key 98765 does not answer"):
        make_world(connect=Connect.SHARED_MEMORY, shared_memory_key=98765)
    monkeypatch.delenv("DISPLAY", raising=False)
    if sys.platform.startswith("linux"):
        with pytest.raises(PhysicsError, match="no display"):
            make_world(connect=Connect.GUI)
    world = make_world(cars=[(1.0, 1.0, 0.0)])
    with pytest.raises(PhysicsError, match="parcel 9"):
        world.remove_parcel(9)
    fingers = ArmTeam.alike(ARMS["iiwa"].spec(TOOLS["friction"]), 1)
    with pytest.raises(ConfigError, match="'friction'; valid: suction"):
        BulletWorld(scene_of(arms=fingers, arm_base=np.zeros((1, 4)), arm_start=np.zeros((1, 7))))


def test_the_engine_prints_nothing() -> None:
    code = """
import numpy as np
from fleet.robots import ARMS, ArmTeam
from fleet.robots.cars.racecar import racecar_spec
from fleet.world.bullet import BulletWorld
from fleet.world.scene import Scene
arm = ARMS["iiwa"].spec()
scene = Scene(size_m=(5.0, 5.0), boxes=(), car_kinds=(racecar_spec(),), car_start=np.ones((1, 3)),
              arms=ArmTeam.alike(arm, 1), arm_base=np.zeros((1, 4)), arm_start=arm.home_rad[None])
world = BulletWorld(scene)
world.step(np.zeros((1, 2)), arm.home_rad[None], np.zeros((1, 7)), np.zeros(1, dtype=bool))
world.close()
world.close()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == ""
    assert done.stderr == ""


def test_clearance_of_an_arm_leaves_out_the_car_it_serves(make_world: MakeWorld) -> None:
    car, home = racecar_spec(), ARMS["iiwa"].spec().home_rad
    over_tray = above(0.55, 0.45, "suction")  # tip 0.2 m above the tray walls
    found = {}
    for serving in (-1, 0):
        world = make_world(cars=[(0.55, -car.tray_x_m, np.pi / 2)], arms=[(0.0, 0.0, 0.0, 0.0)])
        world.set_serving(0, serving)
        sweep(world, home, over_tray, 2.0, grip=False)
        found[serving] = world.min_clearance_m()
    assert found[-1] == pytest.approx(0.2 - TOOLS["suction"].half_width_m, abs=0.01)
    assert found[0] == pytest.approx(0.55 - car.half_width_m - 0.12, abs=0.01)  # base of the arm, before it served
