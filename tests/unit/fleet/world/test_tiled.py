"""The tiled world: what is handed over at the border of a tile, what is seen across it, and who computes it."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from fleet.config import Connect, Fidelity, PhysicsConfig, RunConfig
from fleet.errors import ConfigError
from fleet.scale.floors import floor_for
from fleet.sensors.camera import Camera
from fleet.sensors.errors import SensorError
from fleet.world.bullet.engine.config import BulletConfig
from fleet.world.bullet.world import BulletWorld
from fleet.world.kinematic import CommandError, SnapshotError
from fleet.world.parcels import ParcelError
from fleet.world.protocol import ParcelBody, World
from fleet.world.scene import Scene
from fleet.world.site_scene import scene_of
from fleet.world.tiled.config import TiledConfig
from fleet.world.tiled.crew import TileWorkerError, shares
from fleet.world.tiled.split import CELL_M, split_floor
from fleet.world.tiled.world import TiledWorld

pytestmark = pytest.mark.bullet

LANE_Y_M = 1.5
"""A lane along the hall, far from its arm; the border lies at x = 5."""


@pytest.fixture
def lane(hall: Scene) -> Scene:
    """Return a hall of 10 x 6 m with one car on each side of the border in its middle, heading for it."""
    return replace(hall, size_m=(10.0, 6.0), car_start=np.array([[3.5, LANE_Y_M, 0.0], [6.5, LANE_Y_M, np.pi]]))


@pytest.fixture
def world(lane: Scene) -> Iterator[TiledWorld]:
    """Return a world of two tiles."""
    made = TiledWorld(lane, TiledConfig(n_cars=1))
    yield made
    made.close()


def step(world: World, scene: Scene, *speeds: float) -> None:
    """One tick straight ahead, with arms that stay."""
    commands = np.array([[0.0, speed] for speed in speeds])
    world.step(commands, scene.arm_start, np.zeros_like(scene.arm_start), np.zeros(world.n_arms, dtype=np.bool_))


def parcel(number: int, x: float, y: float, z: float) -> ParcelBody:
    """A parcel with its middle at a place."""
    pose = np.array([x, y, z, 0.0, 0.0, 0.0, 1.0])
    return ParcelBody(parcel=number, size_m=(0.1, 0.08, 0.06), mass_kg=0.5, pose=pose)


@pytest.mark.parametrize("n_cars", [100, 1_000])
def test_tiles_have_equal_shares_of_the_floor_and_arms_their_surroundings(n_cars: int) -> None:
    site = floor_for(n_cars)
    starts = np.zeros((n_cars, 3))
    scene, config = scene_of(site, starts, RunConfig().grip), TiledConfig()
    split = split_floor(scene, config)
    assert split.n_tiles == -(-n_cars // config.n_cars)
    sizes = np.bincount(split.tile_at.ravel())
    assert len(sizes) == split.n_tiles
    assert sizes.max() < 1.6 * sizes.mean()
    rows, cols = split.tile_at.shape
    y, x = (np.indices((rows, cols)) + 0.5) * CELL_M
    for (at_x, at_y), tile in zip(scene.arm_base[:, :2], split.tile_of_arm, strict=True):
        other = np.hypot(*(scene.arm_base[:, :2] - (at_x, at_y)).T) < 2 * config.arm_m
        if (split.tile_of_arm[other] == tile).all():
            assert set(split.tile_at[np.hypot(x - at_x, y - at_y) < config.arm_m]) == {tile}


def test_one_tile_is_a_bullet_world(lane: Scene) -> None:
    worlds = TiledWorld(lane, TiledConfig(n_cars=2)), BulletWorld(lane)
    for world in worlds:
        world.add_parcel(parcel(3, 3.5 + lane.car.tray_x_m, LANE_Y_M, 0.2))
        for _ in range(60):
            step(world, lane, 0.8, 0.3)
    tiled, plain = worlds
    assert tiled.car_poses().tolist() == plain.car_poses().tolist()
    assert tiled.parcel_poses().tolist() == plain.parcel_poses().tolist()
    assert tiled.contacts() == plain.contacts()
    assert tiled.min_clearance_m() == plain.min_clearance_m()
    for world in worlds:
        world.close()


def test_a_car_crosses_with_its_motion_and_its_parcel(world: TiledWorld, lane: Scene) -> None:
    """As in one engine: but for the solver's memory of contacts, nothing is lost at the border."""
    alone = BulletWorld(replace(lane, car_start=lane.car_start[:1]))
    loaded = parcel(3, 3.5 + lane.car.tray_x_m, LANE_Y_M, lane.car.tray_floor_z_m + 0.03)
    for each in (world, alone):
        each.add_parcel(loaded)
    first = world.tiles()[0]
    world.put_car(1, np.array([8.0, 4.5, 0.0]))
    for _ in range(round(3.0 / world.tick_s)):
        step(world, lane, 1.0, 0.0)
        step(alone, lane, 1.0)
        assert world.car_speeds()[0] == pytest.approx(alone.car_speeds()[0], abs=5e-3)
    assert world.tiles()[0] != first
    assert world.car_poses()[0] == pytest.approx(alone.car_poses()[0], abs=2e-3)
    assert world.parcel_poses() == pytest.approx(alone.parcel_poses(), abs=3e-3)
    assert (world.contacts().robot, world.contacts().static) == (0, 0)
    world.remove_parcel(3)
    assert world.parcel_ids().tolist() == []
    alone.close()


def test_cars_that_meet_at_a_border_touch_once(world: TiledWorld, lane: Scene) -> None:
    for _ in range(round(2.5 / world.tick_s)):
        step(world, lane, 0.8, 0.8)
    gap_m = abs(np.diff(world.car_poses()[:, 0])[0]) - 2 * lane.car.front_m
    assert -0.02 < gap_m < 0.05
    assert world.contacts().robot >= 1
    assert world.contacts_of()[0].tolist() == [world.contacts().robot] * 2
    assert world.min_clearance_m() == pytest.approx(0.0, abs=0.01)


def test_a_shove_goes_on_across_a_border(world: TiledWorld, lane: Scene) -> None:
    world.put_car(0, np.array([4.6, LANE_Y_M, 0.0]))
    world.push_car(0, 0.6, 0.0, 0.0)
    for _ in range(round(1.0 / world.tick_s)):
        step(world, lane, 0.0, 0.0)
    assert world.tiles()[0] == world.tiles()[1]
    assert world.car_poses()[0, 0] == pytest.approx(5.2, abs=0.1)


@pytest.mark.parametrize("n_workers", [1, 2])
def test_a_moment_returns_with_its_cars_where_they_were(lane: Scene, n_workers: int) -> None:
    world = TiledWorld(lane, TiledConfig(n_cars=1, n_workers=n_workers))
    world.put_car(1, np.array([8.0, 4.5, 0.0]))
    world.add_parcel(parcel(3, 3.5 + lane.car.tray_x_m, LANE_Y_M, lane.car.tray_floor_z_m + 0.03))
    step(world, lane, 1.0, 0.0)
    then, tiles, poses = world.save(), world.tiles(), world.car_poses()
    for _ in range(round(2.5 / world.tick_s)):
        step(world, lane, 1.0, 0.0)
    assert world.tiles().tolist() != tiles.tolist()
    world.load(then)
    assert world.tiles().tolist() == tiles.tolist()
    assert world.car_poses().tolist() == poses.tolist()
    for _ in range(round(2.5 / world.tick_s)):
        step(world, lane, 1.0, 0.0)
    assert world.tiles().tolist() != tiles.tolist()
    ride = world.parcel_poses()[0, :2] - world.car_poses()[0, :2]
    assert ride == pytest.approx([lane.car.tray_x_m, 0.0], abs=0.02)
    world.close()


def test_the_number_of_processes_changes_nothing() -> None:
    site = floor_for(100)
    grid = site.grid
    starts = np.column_stack((grid.cell_xy(np.flatnonzero(grid.free)[:200:2]), np.zeros(100)))
    scene = scene_of(site, starts, RunConfig().grip)
    states = []
    for n_workers in (1, 2, 3):
        world = TiledWorld(scene, TiledConfig(n_cars=20, n_workers=n_workers))
        for _ in range(8):
            step(world, scene, *np.linspace(0.0, 1.5, 100).tolist())
        states.append((world.state_bytes(), world.contacts(), world.min_clearance_m()))
        world.close()
    assert states[0] == states[1] == states[2]


def test_a_process_that_ends_is_named(lane: Scene) -> None:
    world = TiledWorld(lane, TiledConfig(n_cars=1, n_workers=2))
    crew = world._crew
    os.kill(crew._workers[1]._process.pid, signal.SIGKILL)  # type: ignore[attr-defined]
    with pytest.raises(TileWorkerError, match=r"tiles \[1\] has ended with status -9; valid: .*--workers 1"):
        step(world, lane, 0.0, 0.0)
    assert world.state_bytes() == world.state_bytes(), "what is still known"
    assert world.car_poses().shape == (2, 3)
    world.close()
    world.close()


def test_refusals_name_what_is_valid(world: TiledWorld, lane: Scene) -> None:
    with pytest.raises(CommandError, match="valid"):
        world.step(np.zeros((1, 2)), lane.arm_start, lane.arm_start, np.zeros(1, dtype=np.bool_))
    with pytest.raises(SnapshotError, match="valid"):
        world.load(3)
    world.add_parcel(parcel(3, 4.0, 4.0, 0.03))
    with pytest.raises(ParcelError, match="valid"):
        world.add_parcel(parcel(3, 4.0, 4.0, 0.03))
    with pytest.raises(ParcelError, match=r"valid: \[3\]"):
        world.remove_parcel(4)


@pytest.mark.parametrize(
    "settings",
    [{"fidelity": Fidelity.KINEMATIC}, {"fidelity": Fidelity.PHYSICS, "connect": Connect.GUI}],
)
def test_processes_are_for_physics_without_a_window(settings: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="--workers is 2; valid: 1, or more with --fidelity physics"):
        RunConfig(physics=PhysicsConfig(workers_n=2), **settings)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="--workers is 0; valid: an integer from 1"):
        PhysicsConfig(workers_n=0)


@pytest.mark.parametrize("n_workers", [1, 2, 3, 5])
def test_every_tile_is_dealt_out_once_and_numbers_of_tiles_differ_by_one(n_workers: int) -> None:
    dealt = shares(np.random.default_rng(0).integers(0, 140, 13), n_workers)
    assert sorted(tile for own in dealt for tile in own) == list(range(13))
    sizes = [len(own) for own in dealt]
    assert max(sizes) - min(sizes) <= 1
    assert all(own == sorted(own) for own in dealt)


def test_processes_have_about_as_many_cars_whatever_order_tiles_are_numbered_in() -> None:
    # Every second tile or so is empty when the run begins, as on the generated floor for 1,000 cars.
    n_cars = np.array([71, 78, 78, 0, 137, 0, 118, 133, 0, 126, 0, 0, 135, 0, 124])
    assert max(int(n_cars[own].sum()) for own in shares(n_cars, 2)) < 1.1 * n_cars.sum() / 2


def test_pictures_without_robots_are_refused(lane: Scene) -> None:
    unseen = TiledWorld(lane, TiledConfig(bullet=BulletConfig(visuals=False), n_cars=1))
    eye, target = np.array([3.0, 3.0, 2.0]), np.array([3.0, LANE_Y_M, 0.0])
    camera = Camera.looking_at("eye", eye_m=eye, target_m=target, width_px=32, height_px=24)
    with pytest.raises(SensorError, match="camera eye: this world was made without images"):
        unseen.image(camera)
    unseen.close()
