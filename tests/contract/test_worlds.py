"""What every world owes the simulation, whatever its fidelity."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
from scipy.optimize import least_squares

from fleet.robots import ARMS, ArmTeam
from fleet.robots.cars.racecar import racecar_spec
from fleet.sensors.camera import Camera
from fleet.sensors.errors import SensorError
from fleet.world.grid import GridConfig, GridWorld
from fleet.world.kinematic import KinematicConfig, KinematicWorld
from fleet.world.protocol import ParcelBody, World
from fleet.world.scene import Scene, StaticBox
from maps.grid import GridMap
from maps.lane_graph import grid_lane_graph
from planners.motion.arm.kinematics import link_frames

try:
    from fleet.world.bullet.engine.config import BulletConfig
    from fleet.world.bullet.world import BulletWorld
    from fleet.world.mixed.world import MixedWorld
    from fleet.world.tiled.config import TiledConfig
    from fleet.world.tiled.world import TiledWorld
except ImportError:  # pragma: no cover - only where pybullet is not installed
    BulletWorld = None  # type: ignore[assignment, misc]

FloatArray = npt.NDArray[np.float64]

ROWS, COLS, LANE_Y_M = 6, 8, 1.5
GRAPH = grid_lane_graph(GridMap(np.ones((ROWS, COLS), dtype=np.bool_)), "rotating")
ARM_XY, ARM_YAW = (1.66, 2.1), -math.pi / 2  # abeam of the tray of a car at x = 1.5 m
SLOT = (ARM_XY[0] + 0.45 * math.cos(math.radians(25)), ARM_XY[1] + 0.45 * math.sin(math.radians(25)), 0.25)
SIZE_M = (0.08, 0.08, 0.06)


def scene() -> Scene:
    """Return two cars in one lane, 4 m apart, and an arm that reaches the first one's tray and a pedestal."""
    arm = ARMS["iiwa"].spec()
    return Scene(
        size_m=(float(COLS), float(ROWS)),
        boxes=(
            StaticBox(kind="wall", centre_m=(7.5, 3.0, 0.5), half_m=(0.5, 3.0, 0.5)),
            StaticBox(kind="pedestal", centre_m=(SLOT[0], SLOT[1], 0.125), half_m=(0.08, 0.08, 0.125)),
        ),
        car_kinds=(racecar_spec(),),
        car_start=np.array([[1.5, LANE_Y_M, 0.0], [5.5, LANE_Y_M, 0.0]]),
        arms=ArmTeam.alike(arm, 1),
        arm_base=np.array([[*ARM_XY, 0.0, ARM_YAW]]),
        arm_start=arm.home_rad[None].copy(),
    )


@dataclass(frozen=True, kw_only=True)
class Case:
    """A kind of world and how to make its cars drive along the lane."""

    make: Callable[[], World]
    go: Callable[[World, int, float], FloatArray]
    """Command of one car (2,) that takes it east at some speed; 0 = stay."""


def steer(world: World, car: int, speed_mps: float) -> FloatArray:
    """Keep to the lane's centre line."""
    _, y, yaw = world.car_poses()[car]
    return np.array([-1.5 * (y - LANE_Y_M) - yaw if speed_mps else 0.0, speed_mps])


def hop(world: World, car: int, speed_mps: float) -> FloatArray:
    """Name the state of the present or the next cell."""
    col = min(math.floor(world.car_poses()[car, 0]) + (speed_mps > 0), COLS - 1)
    return np.array([GRAPH.state_at((ROWS - 1 - math.floor(LANE_Y_M)) * COLS + col, 0), 0.0])


CASES = {
    "kinematic": Case(make=lambda: KinematicWorld(scene(), KinematicConfig(tick_s=0.05)), go=steer),
    "grid": Case(make=lambda: GridWorld(scene(), GRAPH, GridConfig(tick_s=0.05, timestep_s=1.0)), go=hop),
    "mixed": Case(make=lambda: MixedWorld(scene()), go=steer),
    "bullet": Case(make=lambda: BulletWorld(scene(), BulletConfig()), go=steer),
    "tiled": Case(make=lambda: TiledWorld(scene(), TiledConfig(n_cars=1)), go=steer),
    "tiled_workers": Case(make=lambda: TiledWorld(scene(), TiledConfig(n_cars=1, n_workers=2)), go=steer),
}
ABSENT = pytest.mark.skipif(BulletWorld is None, reason="needs pybullet")
PLAIN = ("kinematic", "grid")
MARKS = {name: [] if name in PLAIN else [pytest.mark.bullet, ABSENT] for name in CASES}
MARKS["tiled_workers"].append(pytest.mark.slow)  # each starts two processes
PARAMS = [pytest.param(name, marks=marks) for name, marks in MARKS.items()]


@pytest.fixture(params=PARAMS)
def case(request: pytest.FixtureRequest) -> Case:
    """Return one kind of world."""
    return CASES[request.param]


@pytest.fixture
def world(case: Case) -> Iterator[World]:
    """Return a fresh world and close it afterwards."""
    made = case.make()
    yield made
    made.close()


def run(
    case: Case, world: World, seconds: float, *, speeds: tuple[float, float] = (0.0, 0.0), grip: bool = False
) -> None:
    """Let time pass, arms holding still."""
    q = world.arm_positions()
    for _ in range(round(seconds / world.tick_s)):
        command = np.array([case.go(world, car, speed) for car, speed in enumerate(speeds)])
        world.step(command, q, np.zeros_like(q), np.array([grip]))


def reach(case: Case, world: World, tip_m: tuple[float, float, float], *, grip: bool, seconds: float = 2.0) -> None:
    """Move the arm's tip to a point of the world, tool down, along a smooth joint-space line."""
    spec = scene().arms.specs[0]
    c, s = math.cos(ARM_YAW), math.sin(ARM_YAW)
    dx, dy = tip_m[0] - ARM_XY[0], tip_m[1] - ARM_XY[1]
    goal = np.array([c * dx + s * dy, c * dy - s * dx, tip_m[2]])

    def miss(q: FloatArray) -> FloatArray:
        flange = link_frames(spec.base_from_joint, q)[-1]
        tip = flange[:3, 3] + spec.tool_length_m * flange[:3, 2]
        return np.concatenate((tip - goal, 0.3 * (flange[:3, 2] - (0.0, 0.0, -1.0)), [0.01 * q[2], 0.01 * q[6]]))

    guess = np.array([math.atan2(goal[1], goal[0]), 0.6, 0.0, -1.6, 0.0, 0.9, 0.0])
    end = least_squares(miss, guess, bounds=(spec.lower_rad, spec.upper_rad)).x
    assert np.abs(miss(end)[:3]).max() < 2e-3
    start = world.arm_positions()[0]
    # The line's greatest speed is twice its mean; stay a tenth below the joints' limits.
    seconds = max(seconds, 2.2 * float(np.max(np.abs(end - start) / spec.max_velocity_radps)))
    n = round(seconds / world.tick_s)
    for tick in range(1, n + round(0.3 / world.tick_s)):
        u = min(tick / n, 1.0)
        q = start + (end - start) * (u - math.sin(2 * math.pi * u) / (2 * math.pi))
        qd = (end - start) * (1.0 - math.cos(2 * math.pi * u)) / seconds
        command = np.array([case.go(world, car, 0.0) for car in range(world.n_cars)])
        world.step(command, q[None], qd[None], np.array([grip]))


def parcel(number: int, x: float, y: float, bottom_m: float) -> ParcelBody:
    """Return a small parcel whose lower face is at a height."""
    pose = np.array([x, y, bottom_m + SIZE_M[2] / 2, 0.0, 0.0, 0.0, 1.0])
    return ParcelBody(parcel=number, size_m=SIZE_M, mass_kg=0.5, pose=pose)


def test_shapes_and_start(world: World) -> None:
    start = scene()
    assert (world.n_cars, world.n_arms) == (2, 1)
    assert world.tick_s > 0
    assert world.car_poses() == pytest.approx(start.car_start, abs=0.005)
    assert world.car_speeds() == pytest.approx(np.zeros(2), abs=0.01)
    assert world.car_steering().shape == (2,)
    assert world.arm_positions() == pytest.approx(start.arm_start, abs=0.005)
    assert world.arm_velocities().shape == (1, 7)
    assert world.held().tolist() == [-1]
    assert world.parcel_ids().shape == (0,)
    assert world.parcel_poses().shape == (0, 7)


def test_answers_are_copies(world: World) -> None:
    before = world.state_bytes()
    for ask in (world.car_poses, world.car_speeds, world.arm_positions, world.held):
        ask()[:] = 5
    assert world.state_bytes() == before


def test_an_image_or_a_named_refusal(world: World) -> None:
    camera = Camera.looking_at("eye", eye_m=(1.0, 1.0, 2.0), target_m=(2.0, 1.0, 0.0), width_px=32, height_px=24)
    if isinstance(world, KinematicWorld | GridWorld):
        with pytest.raises(SensorError, match=r"camera eye: .*; valid: fidelity physics"):
            world.image(camera)
        return
    before = world.state_bytes()
    assert world.image(camera).depth_m.shape == (24, 32)
    assert world.state_bytes() == before


def test_cars_that_stay_stay(case: Case, world: World) -> None:
    run(case, world, 1.0)
    assert world.car_poses() == pytest.approx(scene().car_start, abs=0.005)
    assert (world.contacts().robot, world.contacts().static) == (0, 0)
    gap_m = 4.0 - 0.41 - 0.09
    assert world.min_clearance_m() <= gap_m + 0.01


def test_car_drives_along_the_lane(case: Case, world: World) -> None:
    run(case, world, 3.0, speeds=(0.5, 0.0))
    run(case, world, 1.0)
    x, y, yaw = world.car_poses()[0]
    assert x > 2.4
    assert y == pytest.approx(LANE_Y_M, abs=0.03)
    assert yaw == pytest.approx(0.0, abs=0.05)
    assert world.car_speeds()[0] == pytest.approx(0.0, abs=0.02)
    assert world.car_poses()[1] == pytest.approx(scene().car_start[1], abs=0.01)
    assert world.contacts().robot == 0


def test_driving_into_a_car_is_a_contact(case: Case, world: World) -> None:
    run(case, world, 4.6, speeds=(1.0, 0.0))
    assert world.contacts().robot >= 1
    assert world.contacts().static == 0
    assert world.min_clearance_m() == pytest.approx(0.0, abs=0.01)


def test_driving_into_the_wall_is_a_contact(case: Case, world: World) -> None:
    run(case, world, 3.0, speeds=(0.0, 0.8))
    assert world.contacts().static >= 1
    assert world.contacts().robot == 0


def test_arm_reaches_its_target(case: Case, world: World) -> None:
    start = world.arm_positions()
    reach(case, world, (SLOT[0], SLOT[1], 0.5), grip=False)
    assert np.abs(world.arm_positions() - start).max() > 0.1
    assert world.arm_velocities() == pytest.approx(np.zeros((1, 7)), abs=0.02)


def test_parcels_rest_where_they_are_put(case: Case, world: World) -> None:
    world.add_parcel(parcel(7, SLOT[0], SLOT[1], SLOT[2]))
    world.add_parcel(parcel(3, 4.0, 4.0, 0.005))
    run(case, world, 0.5)
    assert world.parcel_ids().tolist() == [3, 7]
    poses = world.parcel_poses()
    assert poses[0, :3] == pytest.approx([4.0, 4.0, 0.03], abs=0.005)
    assert poses[1, :3] == pytest.approx([SLOT[0], SLOT[1], 0.28], abs=0.005)
    world.remove_parcel(3)
    assert world.parcel_ids().tolist() == [7]
    assert world.contacts().static == 0


def test_pick_place_and_ride(case: Case, world: World) -> None:
    world.add_parcel(parcel(9, SLOT[0], SLOT[1], SLOT[2]))
    world.set_serving(0, 0)
    top = SLOT[2] + SIZE_M[2]
    reach(case, world, (SLOT[0], SLOT[1], top + 0.15), grip=False)
    assert world.held().tolist() == [-1]
    reach(case, world, (SLOT[0], SLOT[1], top + 0.003), grip=False, seconds=1.0)
    run(case, world, 0.3, grip=True)
    assert world.held().tolist() == [9]
    reach(case, world, (SLOT[0], SLOT[1], top + 0.20), grip=True, seconds=1.0)
    assert world.parcel_poses()[0, 2] == pytest.approx(SLOT[2] + 0.20 + SIZE_M[2] / 2, abs=0.02)

    tray = racecar_spec()
    x = world.car_poses()[0, 0] + tray.tray_x_m
    low = tray.tray_floor_z_m + SIZE_M[2] + 0.005
    reach(case, world, (x, LANE_Y_M, 0.50), grip=True)
    reach(case, world, (x, LANE_Y_M, low), grip=True, seconds=1.0)
    run(case, world, 0.3)
    assert world.held().tolist() == [-1]
    reach(case, world, (x, LANE_Y_M, 0.50), grip=False, seconds=1.0)
    world.set_serving(0, -1)
    run(case, world, 2.5, speeds=(0.5, 0.0))
    run(case, world, 1.0)
    offset = world.parcel_poses()[0, :3] - [world.car_poses()[0, 0] + tray.tray_x_m, LANE_Y_M, 0.0]
    assert world.car_poses()[0, 0] > 2.3
    assert offset == pytest.approx([0.0, 0.0, tray.tray_floor_z_m + SIZE_M[2] / 2], abs=0.03)
    assert world.contacts().static == 0


def test_a_tool_that_fails_drops_what_it_holds_and_holds_again_when_it_was_off(case: Case, world: World) -> None:
    world.add_parcel(parcel(9, SLOT[0], SLOT[1], SLOT[2]))
    top = SLOT[2] + SIZE_M[2]
    reach(case, world, (SLOT[0], SLOT[1], top + 0.003), grip=False)
    run(case, world, 0.3, grip=True)
    reach(case, world, (SLOT[0], SLOT[1], top + 0.05), grip=True, seconds=1.0)
    assert (world.held().tolist(), world.grip_loss(0)) == ([9], "")
    world.fail_grip(0)
    run(case, world, 0.5, grip=True)
    assert world.held().tolist() == [-1]
    assert world.grip_loss(0) == "its tool has failed"
    assert world.parcel_poses()[0, 2] == pytest.approx(top - SIZE_M[2] / 2, abs=0.005)
    reach(case, world, (SLOT[0], SLOT[1], top + 0.003), grip=True, seconds=1.0)
    assert world.held().tolist() == [-1]
    run(case, world, 0.1)
    run(case, world, 0.3, grip=True)
    assert (world.held().tolist(), world.grip_loss(0)) == ([9], "")


def test_rays_meet_walls_cars_and_run_time_boxes(case: Case, world: World) -> None:
    run(case, world, 0.1)
    origins = np.array([[1.5, 4.5, 0.2], [3.0, LANE_Y_M, 0.08], [1.5, 4.5, 0.2]])
    ends = np.array([[9.5, 4.5, 0.2], [7.0, LANE_Y_M, 0.08], [1.5, 5.5, 0.2]])
    assert world.rays(origins, ends) == pytest.approx([5.5 / 8, (5.5 - 0.09 - 3.0) / 4, 1.0], abs=0.005)
    world.add_obstacle(2, np.array([4.0, 4.5, 0.25]), np.array([0.25, 0.25, 0.25]))
    run(case, world, 0.1)
    assert world.rays(origins, ends)[0] == pytest.approx(2.25 / 8, abs=0.005)
    world.remove_obstacle(2)
    run(case, world, 0.1)
    assert world.rays(origins, ends)[0] == pytest.approx(5.5 / 8, abs=0.005)


@pytest.mark.parametrize(
    ("origins", "ends"),
    [
        (np.zeros((2, 3)), np.ones((3, 3))),
        (np.zeros((2, 2)), np.ones((2, 2))),
        (np.zeros(3), np.ones(3)),
        (np.array([[1.0, np.nan, 0.1]]), np.ones((1, 3))),
        (np.ones((1, 3)), np.array([[math.inf, 0.0, 0.1]])),
        (np.ones((1, 3)), np.array([[1e300, 0.0, 0.1]])),
    ],
)
def test_rays_that_are_none_are_refused(world: World, origins: FloatArray, ends: FloatArray) -> None:
    with pytest.raises(SensorError, match="valid: "):
        world.rays(origins, ends)


def test_rays_may_come_in_any_kind_of_array(case: Case, world: World) -> None:
    run(case, world, 0.1)
    origins, ends = np.array([[1.5, 4.5, 0.5]] * 4), np.array([[9.5, 4.5, 0.5]] * 4)
    told = world.rays(origins, ends)
    assert np.array_equal(world.rays(origins.astype(np.float32), np.asfortranarray(ends)), told)
    assert np.array_equal(world.rays(origins[::2], ends[::2]), told[::2])
    assert world.rays(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


def test_pushed_car_moves_the_way_it_is_pushed(case: Case, world: World) -> None:
    world.push_car(1, 0.0, 0.3, 0.0)
    run(case, world, 1.0)
    moved = world.car_poses()[1] - scene().car_start[1]
    assert moved[1] > 0.02
    assert abs(moved[0]) < 0.1


def test_snapshot_returns_exactly(case: Case, world: World) -> None:
    world.add_parcel(parcel(1, 1.5 + racecar_spec().tray_x_m, LANE_Y_M, 0.2))
    run(case, world, 0.5, speeds=(0.3, 0.0))
    snapshot, before = world.save(), world.state_bytes()
    ends = []
    for _ in range(2):
        run(case, world, 1.0, speeds=(0.5, 0.2))
        ends.append(world.state_bytes())
        world.load(snapshot)
        assert world.state_bytes() == before
    assert ends[0] == ends[1] != before


def test_same_commands_give_the_same_state(case: Case) -> None:
    ends = []
    for _ in range(2):
        world = case.make()
        world.add_parcel(parcel(1, SLOT[0], SLOT[1], SLOT[2]))
        run(case, world, 1.5, speeds=(0.5, 0.5))
        ends.append(world.state_bytes())
        world.close()
        world.close()
    assert ends[0] == ends[1]
