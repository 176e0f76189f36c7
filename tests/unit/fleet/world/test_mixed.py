"""The mixed world: what is handed over at the border of a region, what sleeps, and who judges touches."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fleet.arrays import FloatArray
from fleet.config import Connect, Fidelity, Perception, RunConfig
from fleet.errors import ConfigError
from fleet.robots import ARMS, ArmTeam
from fleet.robots.cars.racecar import racecar_spec
from fleet.sensors.camera import Camera
from fleet.sensors.errors import SensorError
from fleet.world.kinematic import CommandError, KinematicWorld, SnapshotError
from fleet.world.mixed.config import MixedConfig
from fleet.world.mixed.region import Region
from fleet.world.mixed.split import regions_of
from fleet.world.mixed.world import MixedWorld
from fleet.world.parcels import ParcelError
from fleet.world.protocol import ParcelBody
from fleet.world.scene import Scene

pytestmark = pytest.mark.bullet

LANE_Y_M = 3.9
"""A lane past the arm of the hall, at the distance of a dock."""


@pytest.fixture
def lane(hall: Scene) -> Scene:
    """Return the hall with one car 3 m before the dock and one far away."""
    return replace(hall, car_start=np.array([[-1.2, LANE_Y_M, 0.0], [5.5, 1.5, 0.0]]))


@pytest.fixture
def world(lane: Scene) -> Iterator[MixedWorld]:
    """Return a mixed world of that."""
    made = MixedWorld(lane)
    yield made
    made.close()


def step(world: MixedWorld, speeds: tuple[float, float] = (0.0, 0.0), q: FloatArray | None = None) -> None:
    """One tick straight ahead, with arms that stay."""
    targets = ARMS["iiwa"].spec().home_rad[None] if q is None else q
    commands = np.array([[0.0, speed] for speed in speeds])
    world.step(commands, targets, np.zeros_like(targets), np.zeros(1, dtype=np.bool_))


def inside(world: MixedWorld, car: int) -> bool:
    """Whether a car is in a region."""
    return bool(world.regions()[car] >= 0)


def parcel(number: int, x: float, y: float, z: float, yaw: float = 0.0) -> ParcelBody:
    """A parcel with its middle at a place."""
    pose = np.array([x, y, z, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)])
    return ParcelBody(parcel=number, size_m=(0.1, 0.08, 0.06), mass_kg=0.5, pose=pose)


def from_car(world: MixedWorld, car: int) -> FloatArray:
    """Pose of the only parcel as the car sees it: place and rotation vector, shape (6,)."""
    x, y, yaw = world.car_poses()[car]
    pose = world.parcel_poses()[0]
    back = Rotation.from_euler("z", -yaw)
    turn = (back * Rotation.from_quat(pose[3:])).as_rotvec()
    return np.concatenate((back.apply(pose[:3] - (x, y, 0.0)), turn))


@pytest.mark.parametrize("motion", [(0.0, 0.0), (1.0, 0.0), (1.3, 0.4), (-0.4, -0.6)])
def test_a_car_enters_with_its_pose_speed_and_steering(lane: Scene, motion: tuple[float, float]) -> None:
    speed, steering = motion
    region = Region(lane, [0], MixedConfig())
    for pose in (np.array([1.9, LANE_Y_M, 0.3]), np.array([2.1, LANE_Y_M, -2.8])):
        region.enter(1, 0, pose, speed, steering)
        assert region.world.car_poses()[1] == pytest.approx(pose, abs=1e-9)
        assert region.world.car_speeds()[1] == pytest.approx(speed, abs=1e-9)
        assert region.world.car_steering()[1] == pytest.approx(steering, abs=1e-9)
        region.leave(1)
    region.world.close()


def test_a_car_that_entered_drives_on_as_it_did(lane: Scene) -> None:
    region = Region(lane, [0], MixedConfig())
    speed, steering, n_ticks = 0.8, 0.2, 6
    region.enter(0, 1, np.array([1.7, LANE_Y_M, 0.0]), speed, steering)
    commands, still = np.array([[0.0, 0.0], [steering, speed]]), np.zeros((1, 7))
    poses = []
    for _ in range(n_ticks):
        region.step(commands, lane.arm_start, still, np.zeros(1, dtype=np.bool_))
        poses.append(region.world.car_poses()[0])
    tick_s = region.world.tick_s
    turn = math.tan(steering) / lane.car.wheelbase_m * speed * n_ticks * tick_s
    assert poses[0][0] == pytest.approx(1.7 + speed * tick_s, abs=1e-3)
    assert poses[-1][2] == pytest.approx(turn, abs=0.02)
    assert region.world.car_speeds()[0] == pytest.approx(speed, abs=0.02)
    region.world.close()


def test_cars_are_physics_near_the_arm_and_nowhere_else(world: MixedWorld, lane: Scene) -> None:
    radius = MixedConfig().radius_m
    for _ in range(round(5.4 / world.tick_s)):
        step(world, (1.0, 0.0))
        x, y, yaw = world.car_poses()[0]
        tray = x + lane.car.tray_x_m * math.cos(yaw), y + lane.car.tray_x_m * math.sin(yaw)
        gap = math.dist(tray, lane.arm_base[0, :2])
        if gap < radius - 0.06:
            assert inside(world, 0)
        elif gap > radius + MixedConfig().margin_m + 0.06:
            assert not inside(world, 0)
    assert world.car_poses()[0, 0] > 3.5
    assert not inside(world, 1)
    assert world.car_poses()[1].tolist() == lane.car_start[1].tolist()
    assert (world.contacts().robot, world.contacts().static) == (0, 0)


def test_motion_goes_on_across_the_border(world: MixedWorld) -> None:
    jumps, before = [], world.car_poses()[0]
    for _ in range(round(5.4 / world.tick_s)):
        step(world, (1.0, 0.0))
        now = world.car_poses()[0]
        jumps.append(now[0] - before[0])
        before = now
    # From a stand to 1 m/s takes 0.7 s.
    after = round(1.0 / world.tick_s)
    assert np.array(jumps[after:]) == pytest.approx(world.tick_s, abs=1.5e-3)


def test_a_parcel_on_the_tray_keeps_its_place_as_the_car_leaves(world: MixedWorld, lane: Scene) -> None:
    while not inside(world, 0):
        step(world, (1.0, 0.0))
    x, y, _ = world.car_poses()[0]
    world.add_parcel(parcel(4, x + lane.car.tray_x_m + 0.02, y - 0.01, lane.car.tray_floor_z_m + 0.035, 0.4))
    for _ in range(30):
        step(world)
    while inside(world, 0):
        before = from_car(world, 0)
        step(world, (1.0, 0.0))
        if inside(world, 0):
            continue
    assert from_car(world, 0) == pytest.approx(before, abs=1e-9)
    for _ in range(60):
        step(world, (1.0, 0.0))
    assert from_car(world, 0) == pytest.approx(before, abs=1e-9)
    assert before[2] == pytest.approx(lane.car.tray_floor_z_m + 0.03, abs=0.002)


def test_a_parcel_on_the_tray_keeps_its_place_as_the_car_comes(world: MixedWorld, lane: Scene) -> None:
    x, y, _ = world.car_poses()[0]
    world.add_parcel(parcel(4, x + lane.car.tray_x_m, y, lane.car.tray_floor_z_m + 0.03, 0.4))
    while not inside(world, 0):
        before = from_car(world, 0)
        step(world, (1.0, 0.0))
    assert from_car(world, 0) == pytest.approx(before, abs=1e-3)
    for _ in range(20):
        step(world, (1.0, 0.0))
    assert from_car(world, 0) == pytest.approx(before, abs=5e-3)
    assert world.parcel_ids().tolist() == [4]


def test_what_rests_is_not_stepped_until_it_is_told_something(world: MixedWorld) -> None:
    world.add_parcel(parcel(1, 2.0, 5.0, 0.28))
    for _ in range(90):
        step(world)
    rest = world.state_bytes()
    assert world.n_awake() == 0
    for _ in range(50):
        step(world)
    assert world.state_bytes() == rest
    q = world.arm_positions()
    q[0, 3] += 0.01
    step(world, q=q)
    assert world.n_awake() == 1
    assert world.state_bytes() != rest


def test_obstacles_and_parcels_wake_a_region_and_far_ones_do_not(world: MixedWorld) -> None:
    for _ in range(90):
        step(world)
    world.add_obstacle(1, np.array([8.0, 1.0, 0.2]), np.array([0.2, 0.2, 0.2]))
    assert world.n_awake() == 0
    world.add_obstacle(2, np.array([3.0, 4.0, 0.2]), np.array([0.2, 0.2, 0.2]))
    assert world.n_awake() == 1
    world.remove_obstacle(1)
    world.remove_obstacle(2)
    for _ in range(90):
        step(world)
    world.add_parcel(parcel(1, 8.0, 1.0, 0.03))
    assert world.n_awake() == 0
    world.add_parcel(parcel(2, 2.0, 5.0, 0.28))
    assert world.n_awake() == 1


def test_touches_count_once_whoever_judges_them(hall: Scene) -> None:
    # The first two meet in the region, the others far from it.
    starts = np.array([[1.3, LANE_Y_M, 0.0], [2.0, LANE_Y_M, 0.0], [4.0, 1.5, 0.0], [5.0, 1.5, 0.0]])
    world = MixedWorld(replace(hall, car_start=starts))
    q = world.arm_positions()
    commands = np.array([[0.0, 0.6], [0.0, 0.0], [0.0, 0.6], [0.0, 0.0]])
    for _ in range(90):
        world.step(commands, q, np.zeros_like(q), np.zeros(1, dtype=np.bool_))
    assert (world.contacts().robot, world.contacts().static) == (2, 0)
    assert world.contacts_of()[0].tolist() == [1, 1, 1, 1]
    gaps = world.car_poses()[[1, 3], 0] - world.car_poses()[[0, 2], 0]
    assert gaps == pytest.approx([0.5, 0.5], abs=0.01)
    world.close()


def test_a_car_stops_at_a_wall_where_there_is_no_physics(hall: Scene) -> None:
    world = MixedWorld(replace(hall, car_start=np.array([[7.5, 3.0, 0.0]])))
    q = world.arm_positions()
    for _ in range(180):
        world.step(np.array([[0.0, 1.0]]), q, np.zeros_like(q), np.zeros(1, dtype=np.bool_))
    assert world.car_poses()[0, 0] == pytest.approx(9.0 - 0.41, abs=0.02)
    assert world.contacts().static == 1
    world.close()


def test_a_car_that_is_put_elsewhere_leaves_its_region(world: MixedWorld) -> None:
    while not inside(world, 0):
        step(world, (1.0, 0.0))
    world.put_car(0, np.array([6.0, 3.0, 1.0]))
    assert not inside(world, 0)
    step(world)
    assert world.car_poses()[0].tolist() == [6.0, 3.0, 1.0]


def test_pushes_move_cars_in_and_out_of_physics(world: MixedWorld) -> None:
    while not inside(world, 0):
        step(world, (1.0, 0.0))
    for _ in range(30):
        step(world)
    before = world.car_poses()
    for car in (0, 1):
        world.push_car(car, 0.1, -0.1, 0.2)
    for _ in range(60):
        step(world)
    assert world.car_poses() - before == pytest.approx(np.array([[0.1, -0.1, 0.2]] * 2), abs=0.03)


def test_a_moment_with_a_car_in_a_region_returns(world: MixedWorld, lane: Scene) -> None:
    while not inside(world, 0):
        step(world, (1.0, 0.0))
    x, y, _ = world.car_poses()[0]
    world.add_parcel(parcel(4, x + lane.car.tray_x_m, y, lane.car.tray_floor_z_m + 0.03))
    snapshot, moment = world.save(), (world.car_poses(), world.parcel_poses(), world.car_speeds())
    ends = []
    for _ in range(2):
        for _ in range(150):
            step(world, (1.0, 0.0))
        assert not inside(world, 0)
        ends.append((world.car_poses(), world.parcel_poses()))
        world.load(snapshot)
        assert inside(world, 0)
        # The parcel has left the region meanwhile and is put there anew.
        for one, other in zip(moment, (world.car_poses(), world.parcel_poses(), world.car_speeds()), strict=True):
            assert one == pytest.approx(other, abs=1e-9)
    for one, other in zip(*ends, strict=True):
        assert one == pytest.approx(other, abs=0.01)


def test_all_can_be_placed_anew(world: MixedWorld, lane: Scene) -> None:
    while not inside(world, 0):
        step(world, (1.0, 0.0))
    poses, q = np.array([[6.0, 3.0, 1.0], [1.84, LANE_Y_M, 0.0]]), lane.arm_start + 0.1
    world.place(poses, q)
    assert world.car_poses() == pytest.approx(poses, abs=1e-9)
    assert world.arm_positions() == pytest.approx(q, abs=1e-9)
    assert [inside(world, car) for car in (0, 1)] == [False, True]


def at_the_dock(world: MixedWorld, for_s: float = 1.0) -> None:
    """Let the first car bring a parcel to the arm, and stand there for a while."""
    x, y, _ = world.car_poses()[0]
    world.add_parcel(parcel(1, x + racecar_spec().tray_x_m, y, racecar_spec().tray_floor_z_m + 0.03))
    for _ in range(round(2.95 / world.tick_s)):
        step(world, (1.0, 0.0))
    for _ in range(round(for_s / world.tick_s)):
        step(world)


def shaken(world: MixedWorld, n_ticks: int) -> None:
    """Let the arm sway, so that its region is awake."""
    home = ARMS["iiwa"].spec().home_rad[None]
    for k in range(n_ticks):
        step(world, q=home + 0.02 * math.sin(0.3 * k))


def test_what_rests_sleeps_one_by_one_while_its_region_is_awake(world: MixedWorld) -> None:
    at_the_dock(world)
    shaken(world, 30)
    region = world._regions[0]
    inner = region.world
    asleep = inner._sleepers.asleep() if inner._sleepers is not None else set()
    assert world.n_awake() == 1
    assert asleep == {inner._cars.bodies[0], inner._parcels.body(1)}  # not the arm
    before = world.car_poses()[0].copy(), world.parcel_poses()[0].copy()
    shaken(world, 30)
    assert np.array_equal(world.car_poses()[0], before[0])  # a car that is held awake creeps
    assert np.array_equal(world.parcel_poses()[0], before[1])


def test_who_sleeps_starts_when_told_and_gives_way_when_shoved(world: MixedWorld) -> None:
    at_the_dock(world)
    shaken(world, 20)
    lies = from_car(world, 0)
    x = world.car_poses()[0, 0]
    world.push_car(0, 0.0, 0.05, 0.0)
    shaken(world, 30)
    assert world.car_poses()[0, 1] == pytest.approx(LANE_Y_M + 0.05, abs=0.01)
    shaken(world, 20)
    for _ in range(round(0.5 / world.tick_s)):
        step(world, (0.6, 0.0))
    assert world.car_poses()[0, 0] - x > 0.2
    assert from_car(world, 0)[:3] == pytest.approx(lies[:3], abs=0.005)  # the parcel came along


def test_a_moment_returns_to_the_last_bit_whoever_sleeps(world: MixedWorld) -> None:
    def go_on() -> bytes:
        shaken(world, 20)
        for _ in range(12):
            step(world, (0.0, 0.0))
        for _ in range(8):
            step(world, (0.2, 0.0))
        return world.state_bytes()

    at_the_dock(world, for_s=0.0)
    for ticks in (6, 9, 1, 1, 4):  # the car begins to sleep after half a second, which is 15 ticks
        shaken(world, ticks)
        moment = world.save()
        first = go_on()
        world.load(moment)
        assert go_on() == first
        world.load(moment)


def test_arms_of_one_dock_share_a_region_and_large_sites_have_no_more_than_they_may(hall: Scene) -> None:
    xs = [0.0, 1.2, 4.0, 6.0, 8.0]
    base = np.array([[x, 0.0, 0.0, 0.0] for x in xs])
    team = ArmTeam.alike(hall.arms.specs[0], len(xs))
    scene = replace(hall, arms=team, arm_base=base, arm_start=team.home_rad)
    assert regions_of(scene, MixedConfig()) == [[0, 1], [2], [3], [4]]
    base = np.array([[2.0 * k, 0.0, 0.0, 0.0] for k in range(68)])
    many = replace(hall, arms=hall.arms.part([0] * 68), arm_base=base, arm_start=np.zeros((68, 7)))
    seen = MixedConfig(images=True, memory_mb=750.0)
    parts = regions_of(many, seen)
    assert len(parts) == seen.n_regions(68) == 13
    assert replace(seen, images=False).n_regions(68) == 20  # arms that nobody sees take less
    assert sorted(arm for part in parts for arm in part) == list(range(68))
    assert {len(part) for part in parts} == {5, 6}
    none = replace(hall, arms=hall.arms.part(()), arm_base=np.zeros((0, 4)), arm_start=np.zeros((0, 7)))
    assert regions_of(none, MixedConfig()) == []


def test_cars_without_arms_are_those_of_the_kinematic_world(hall: Scene) -> None:
    scene = replace(hall, arms=hall.arms.part(()), arm_base=np.zeros((0, 4)), arm_start=np.zeros((0, 7)))
    world, twin = MixedWorld(scene, MixedConfig(tick_s=0.05)), KinematicWorld(scene)
    still, grip = np.zeros((0, 7)), np.zeros(0, dtype=np.bool_)
    for _ in range(40):
        for one in (world, twin):
            one.step(np.array([[0.3, 1.0], [-0.2, 0.5]]), still, still, grip)
    assert np.array_equal(world.car_poses(), twin.car_poses())
    world.close()


def test_bad_input_is_refused_by_name(world: MixedWorld) -> None:
    still = np.zeros((1, 7))
    with pytest.raises(CommandError, match=r"car_commands.*valid: \(\(2, 2\)"):
        world.step(np.zeros((3, 2)), still, still, np.zeros(1, dtype=np.bool_))
    world.add_parcel(parcel(4, 2.0, 5.0, 0.28))
    with pytest.raises(ParcelError, match="parcel 4 is in the world already"):
        world.add_parcel(parcel(4, 8.0, 1.0, 0.03))
    with pytest.raises(ParcelError, match=r"parcel 5 is not in the world; valid: \[4\]"):
        world.remove_parcel(5)
    with pytest.raises(SnapshotError, match="valid: what save"):
        world.load(None)
    far = Camera.looking_at("eye", eye_m=(8.0, 1.0, 2.0), target_m=(8.1, 1.0, 0.0), width_px=8, height_px=8)
    with pytest.raises(SensorError, match="camera eye: no arm is near"):
        world.image(far)
    with pytest.raises(ConfigError, match=r"mixed.radius_m is -1"):
        MixedConfig(radius_m=-1.0)
    with pytest.raises(ConfigError, match="connect"):
        RunConfig(fidelity=Fidelity.MIXED, connect=Connect.GUI)
    assert RunConfig(fidelity=Fidelity.MIXED, perception=Perception.CAMERA).fidelity.has_contact


def test_a_moment_knows_whom_the_arms_serve(world: MixedWorld) -> None:
    """They went on serving whom they served later, and touches of those did not count."""
    (region,) = world._regions
    before = world.save()
    world.set_serving(0, 0)
    world.load(before)
    assert region._serving.tolist() == [-1]


def test_to_save_a_moment_changes_nothing(lane: Scene) -> None:
    """A car came into its region a tick later where every tick was saved."""
    came = []
    for saves in (False, True):
        made = MixedWorld(lane)
        ticks = 0
        while not inside(made, 0) and ticks < 300:
            if saves:
                made.save()
            step(made, (1.0, 0.0))
            ticks += 1
        came.append(ticks)
        made.close()
    assert came[0] == came[1]
