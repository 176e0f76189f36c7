"""Kinematic world: car limits, arm limits, geometry against brute force."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from fleet.errors import ConfigError, FleetError
from fleet.robots import ArmTeam
from fleet.robots.cars.models import CarModels
from fleet.world.arms import ServoArms
from fleet.world.kinematic import BicycleCars, CommandError, KinematicConfig, KinematicWorld, SnapshotError
from fleet.world.protocol import ParcelBody
from fleet.world.scene import Scene, StaticBox
from planners.motion.arm.kinematics import link_frames

FloatArray = npt.NDArray[np.float64]


def step(world: KinematicWorld, cars: FloatArray | None = None, arm_q: FloatArray | None = None) -> None:
    """Advance one tick; what is not said stays as it is."""
    q = world.arm_positions() if arm_q is None else arm_q
    command = np.zeros((world.n_cars, 2)) if cars is None else cars
    world.step(command, q, np.zeros_like(q), np.zeros(world.n_arms, dtype=np.bool_))


def corners(scene: Scene, pose: FloatArray, step_m: float = 0.002) -> FloatArray:
    """Return points all over the outline of a car."""
    car = scene.car
    u = np.arange(-car.rear_m, car.front_m + 1e-9, step_m)
    v = np.arange(-car.half_width_m, car.half_width_m + 1e-9, step_m)
    ends = [(u, np.full_like(u, side * car.half_width_m)) for side in (-1, 1)]
    ends += [(np.full_like(v, x), v) for x in (-car.rear_m, car.front_m)]
    local = np.concatenate([np.column_stack(pair) for pair in ends])
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return local @ np.array([[c, s], [-s, c]]) + pose[:2]


def test_car_obeys_its_limits_and_turns_on_its_circle(hall: Scene) -> None:
    cars, spec = BicycleCars(CarModels.alike(hall.car, 1), np.zeros((1, 3)), 0.05, 0.0125), hall.car
    wild = np.array([[9.0, 9.0]])
    cars.step(wild)
    assert cars.speeds[0] == pytest.approx(spec.max_accel_mps2 * 0.05)
    assert cars.steering[0] == pytest.approx(spec.max_steering_rate_radps * 0.05)
    for _ in range(60):
        cars.step(wild)
    assert cars.speeds[0] == pytest.approx(spec.max_speed_mps)
    assert cars.steering[0] == pytest.approx(spec.max_steering_rad)
    radius = spec.wheelbase_m / math.tan(spec.max_steering_rad)
    x, y, yaw = cars.poses[0]
    centre = np.array([x - radius * math.sin(yaw), y + radius * math.cos(yaw)])
    for _ in range(40):
        cars.step(wild)
        assert np.hypot(*(cars.poses[0, :2] - centre)) == pytest.approx(radius, abs=2e-4)
    cars.step(np.zeros((1, 2)))
    assert cars.speeds[0] == pytest.approx(spec.max_speed_mps - spec.max_brake_mps2 * 0.05)


def test_a_car_in_too_sharp_a_curve_drives_the_circle_that_its_tyres_hold(hall: Scene) -> None:
    held, free = (
        BicycleCars(CarModels.alike(hall.car, 1), np.zeros((1, 3)), 0.05, 0.0125, grip) for grip in (8.0, math.inf)
    )
    for cars in (held, free):
        for _ in range(60):
            cars.step(np.array([[0.8, 2.0]]))
    turned = []
    for cars in (held, free):
        before = cars.poses[0, 2]
        cars.step(np.array([[0.8, 2.0]]))
        turned.append(math.remainder(cars.poses[0, 2] - before, 2.0 * math.pi) / 0.05)
    assert turned[0] == pytest.approx(8.0 / 2.0)
    assert turned[1] == pytest.approx(2.0 * math.tan(0.8) / hall.car.wheelbase_m)
    # At the speed at which the fleet drives curves nothing is different.
    slow = [BicycleCars(CarModels.alike(hall.car, 1), np.zeros((1, 3)), 0.05, 0.0125, grip) for grip in (8.0, math.inf)]
    for _ in range(40):
        for cars in slow:
            cars.step(np.array([[-0.8, 1.0]]))
    assert np.array_equal(slow[0].poses, slow[1].poses)


def test_change_of_direction_passes_through_a_stand(hall: Scene) -> None:
    cars = BicycleCars(CarModels.alike(hall.car, 1), np.zeros((1, 3)), 0.05, 0.0125)
    cars.step(np.array([[0.0, 0.05]]))
    cars.step(np.array([[0.0, -1.0]]))
    assert cars.speeds[0] == 0.0
    cars.step(np.array([[0.0, -1.0]]))
    assert cars.speeds[0] == pytest.approx(-hall.car.max_accel_mps2 * 0.05)


def test_substeps_hardly_change_the_arc(hall: Scene) -> None:
    ends = []
    for substep_s in (0.0125, 0.0001):
        cars = BicycleCars(CarModels.alike(hall.car, 1), np.zeros((1, 3)), 0.05, substep_s)
        for _ in range(60):
            cars.step(np.array([[0.6, 1.0]]))
        ends.append(cars.poses[0])
    assert np.abs(ends[0] - ends[1])[:2].max() < 1e-3


def test_arms_obey_velocity_and_position_limits(hall: Scene) -> None:
    world = KinematicWorld(hall)
    before = world.arm_positions()
    step(world, arm_q=np.full((1, 7), 100.0))
    moved = world.arm_positions() - before
    assert moved[0] == pytest.approx(hall.arms.specs[0].max_velocity_radps * 0.05)
    assert world.arm_velocities()[0] == pytest.approx(hall.arms.specs[0].max_velocity_radps)
    for _ in range(100):
        step(world, arm_q=np.full((1, 7), 100.0))
    assert world.arm_positions()[0] == pytest.approx(hall.arms.specs[0].upper_rad)
    assert np.all(world.arm_velocities() == 0.0)


def test_tool_tip_agrees_with_the_forward_kinematics_of_the_planners(hall: Scene) -> None:
    rng = np.random.default_rng(0)
    arms = ServoArms(hall.arms, hall.arm_base, hall.arm_start, 0.05)
    world_from_base = np.eye(4)
    world_from_base[:3, :3] = Rotation.from_euler("z", hall.arm_base[0, 3]).as_matrix()
    world_from_base[:3, 3] = hall.arm_base[0, :3]
    for q in rng.uniform(hall.arms.specs[0].lower_rad, hall.arms.specs[0].upper_rad, (20, 7)):
        for _ in range(100):
            arms.step(q[None])
        world_from_flange = world_from_base @ link_frames(hall.arms.specs[0].base_from_joint, q)[-1]
        tip = (world_from_flange @ [0, 0, hall.arms.specs[0].tool_length_m, 1])[:3]
        assert arms.tips[0, :3] == pytest.approx(tip, abs=1e-9)
        assert Rotation.from_quat(arms.tips[0, 3:]).as_matrix() == pytest.approx(world_from_flange[:3, :3], abs=1e-9)


def test_clearance_of_cars_agrees_with_sampled_outlines(hall: Scene) -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        poses = rng.uniform((4.0, 2.0, -3.0), (5.2, 3.2, 3.0), (2, 3))
        scene = dataclasses.replace(
            hall,
            car_start=poses,
            boxes=(),
            arms=hall.arms.part(()),
            arm_base=np.zeros((0, 4)),
            arm_start=np.zeros((0, 7)),
        )
        world = KinematicWorld(scene)
        step(world)
        a, b = corners(scene, poses[0]), corners(scene, poses[1])
        gap = float(np.min(np.hypot(*(a[:, None] - b[None]).transpose(2, 0, 1))))
        if world.contacts().robot:
            assert world.min_clearance_m() == 0.0
            assert gap < 0.2  # outlines cross, or one car lies on the other
        else:
            assert world.min_clearance_m() == pytest.approx(gap, abs=0.002)


def test_a_lasting_touch_counts_once_and_again_when_it_comes_back(hall: Scene) -> None:
    world = KinematicWorld(hall)
    step(world)
    assert world.contacts().robot == 0
    for expected in (1, 2):
        world.put_car(0, world.car_poses()[0] + (2.8, 0.0, 0.0))
        step(world)
        step(world)
        assert world.contacts().robot == expected
        world.put_car(0, world.car_poses()[0] - (2.8, 0.0, 0.0))
        step(world)
    assert world.contacts().static == 0


def test_a_push_ends_where_something_is_in_the_way(hall: Scene) -> None:
    world = KinematicWorld(hall)
    free = world.car_poses()
    world.shove_car(0, 2.8, 0.0, 0.0)  # car_1 stands there
    step(world)
    pushed = world.car_poses()
    assert 0.0 < pushed[0, 0] - free[0, 0] < 2.8
    np.testing.assert_allclose(pushed[1], free[1])
    world.shove_car(1, 20.0, 0.0, 0.0)  # and here a wall
    step(world)
    assert world.car_poses()[1, 0] < free[1, 0] + 20.0
    assert (world.contacts().robot, world.contacts().static) == (0, 0)


def test_static_contacts_with_walls_and_run_time_boxes(hall: Scene) -> None:
    world = KinematicWorld(hall)
    world.push_car(1, 0.7, -1.0, 0.0)  # under the arch
    step(world)
    assert world.contacts().static == 0
    world.put_car(1, world.car_poses()[1] + (3.5, 1.0, 0.0))  # nose at 9.11, in the wall
    step(world)
    assert world.contacts().static == 1
    world.add_obstacle(5, np.array([1.5, 1.5, 0.2]), np.array([0.2, 0.2, 0.2]))
    step(world)
    step(world)
    assert world.contacts().static == 2
    world.remove_obstacle(5)
    with pytest.raises(FleetError, match="obstacle 5 does not exist"):
        world.remove_obstacle(5)


def test_arm_is_judged_against_cars_it_does_not_serve(hall: Scene) -> None:
    scene = dataclasses.replace(hall, car_start=np.array([[2.0, 4.0, 0.0]]))
    reach_down = np.array([[0.0, 1.2, 0.0, -1.2, 0.0, 0.7, 0.0]])
    counts = []
    for served in (0, -1):
        world = KinematicWorld(scene)
        world.set_serving(0, served)
        for _ in range(100):
            step(world, arm_q=reach_down)
        counts.append((world.contacts().robot, world.min_clearance_m()))
    assert counts == [(0, math.inf), (1, 0.0)]


def test_arm_that_dips_into_a_passing_car_touches_it(hall: Scene) -> None:
    # The car passes below the arm, whose tip is 0.36 m above the floor: the car is 0.25 m high, a held parcel 0.1 m.
    plate = StaticBox(kind="pedestal", centre_m=(2.0, 4.0, 0.255), half_m=(0.05, 0.05, 0.005))
    hover = np.array([[0.0, 0.299, 0.0, -1.617, 0.0, 1.225, 0.0]])
    car_start = np.array([[0.5, 4.0, 0.0], [0.5, 1.5, 0.0]])
    scene = dataclasses.replace(hall, boxes=(*hall.boxes, plate), car_start=car_start, arm_start=hover)
    seen = []
    for dip_rad, held in ((0.0, False), (0.4, False), (0.0, True)):
        world = KinematicWorld(scene)
        world.set_serving(0, 1)
        if held:
            pose = np.array([2.0, 4.0, 0.4, 0.0, 0.0, 0.0, 1.0])
            world.add_parcel(ParcelBody(parcel=1, size_m=(0.1, 0.1, 0.1), mass_kg=1.0, pose=pose))
        for tick in range(80):
            q = hover.copy()
            q[0, 1] += dip_rad * (20 < tick < 60)
            world.step(np.array([[0.0, 1.0], [0.0, 0.0]]), q, np.zeros_like(q), np.array([held]))
        seen.append((world.contacts().robot, round(world.min_clearance_m(), 2)))
    assert seen == [(0, 0.08), (1, 0.0), (1, 0.0)]


def test_arms_that_cross_touch_each_other(hall: Scene) -> None:
    base = np.array([[2.0, 4.5, 0.0, 0.0], [3.2, 4.5, 0.0, math.pi]])
    team = ArmTeam.alike(hall.arms.specs[0], 2)
    scene = dataclasses.replace(hall, arms=team, arm_base=base, arm_start=team.home_rad)
    world = KinematicWorld(scene)
    step(world)
    assert world.contacts().robot == 0
    for _ in range(60):
        step(world, arm_q=np.tile([0.0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0], (2, 1)))
    assert world.contacts().robot == 1


def test_rays_agree_with_brute_force(hall: Scene) -> None:
    rng = np.random.default_rng(2)
    world = KinematicWorld(hall)
    world.push_car(0, 0.0, 0.0, 0.7)
    origins = rng.uniform((-0.5, -0.5, 0.0), (10.5, 6.5, 0.0), (200, 3))
    ends = rng.uniform((-0.5, -0.5, 0.0), (10.5, 6.5, 0.0), (200, 3))
    ends[:20, 1] = origins[:20, 1]  # along x
    car = hall.car
    low = [b for b in hall.boxes if b.kind != "wall" or b.centre_m[2] < 1.0]
    shapes = [(*b.centre_m[:2], 0.0, -b.half_m[0], b.half_m[0], b.half_m[1]) for b in low]
    shapes += [(*pose, -car.rear_m, car.front_m, car.half_width_m) for pose in world.car_poses()]
    fractions = np.linspace(0.0, 1.0, 20001)
    got = world.rays(origins, ends)
    for origin, end, hit in zip(origins, ends, got, strict=True):
        points = origin[:2] + fractions[:, None] * (end - origin)[:2]
        first = 1.0
        for x, y, yaw, rear, front, half in shapes:
            dx, dy = points[:, 0] - x, points[:, 1] - y
            u, v = math.cos(yaw) * dx + math.sin(yaw) * dy, math.cos(yaw) * dy - math.sin(yaw) * dx
            inside = (u > rear) & (u < front) & (np.abs(v) < half)
            if inside.any() and not inside[0]:
                first = min(first, float(fractions[np.argmax(inside)]))
        for x, y, *_ in hall.arm_base:
            inside = np.hypot(points[:, 0] - x, points[:, 1] - y) < hall.arms.specs[0].outline.foot_m
            if inside.any() and not inside[0]:
                first = min(first, float(fractions[np.argmax(inside)]))
        assert hit == pytest.approx(first, abs=2e-4)


def test_wrong_shapes_and_settings_are_refused(hall: Scene) -> None:
    world = KinematicWorld(hall)
    with pytest.raises(CommandError, match=r"shapes \(\(3, 2\)"):
        step(world, np.zeros((3, 2)))
    with pytest.raises(SnapshotError, match="snapshot is a dict"):
        world.load({})
    with pytest.raises(ConfigError, match="tick_s is 0"):
        KinematicConfig(tick_s=0.0)
    with pytest.raises(ConfigError, match="substep_s is nan"):
        KinematicConfig(substep_s=math.nan)
    for grip_mps2 in (0.0, math.nan):
        with pytest.raises(ConfigError, match="grip_mps2"):
            KinematicConfig(grip_mps2=grip_mps2)
