"""Rays of the physical world against the engine's own, which knows nothing of what is computed beside it."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
import pytest

from fleet.config import Grip
from fleet.robots import ARMS, TOOLS, ArmTeam
from fleet.robots.cars.racecar import racecar_spec
from fleet.world.bullet import BulletConfig, BulletWorld
from fleet.world.protocol import ParcelBody
from fleet.world.scene import Scene, StaticBox

FloatArray = npt.NDArray[np.float64]

pytestmark = pytest.mark.bullet

BOXES = (
    StaticBox(kind="wall", centre_m=(5.0, 9.8, 0.5), half_m=(5.0, 0.2, 0.5)),
    StaticBox(kind="shelf", centre_m=(7.0, 3.0, 0.8), half_m=(0.4, 1.5, 0.8)),
    StaticBox(kind="pedestal", centre_m=(3.6, 4.0, 0.125), half_m=(0.1, 0.1, 0.125)),
)
LOW = np.array([0.5, 1.7, -0.4, -0.9, 0.3, 1.2, 0.1])
"""An arm that is stretched out close above the floor."""


CARS = ((2.0, 4.0, 0.3), (4.5, 6.0, 2.0), (1.5, 1.0, -1.2))


def crowded(grip: Grip = Grip.SUCTION, cars: tuple[tuple[float, float, float], ...] = CARS) -> BulletWorld:
    """Cars of which one leans on a parcel, arms of which one lies low, parcels and an obstacle."""
    arm = ARMS["iiwa"].spec(TOOLS[grip.value])
    scene = Scene(
        size_m=(10.0, 10.0),
        boxes=BOXES,
        car_kinds=(racecar_spec(),),
        car_start=np.array(cars),
        arms=ArmTeam.alike(arm, 2),
        arm_base=np.array([[3.0, 4.0, 0.0, 0.7], [6.0, 6.0, 0.2, -2.0]]),
        arm_start=np.array([LOW, arm.home_rad]),
    )
    world = BulletWorld(scene, BulletConfig(grip=grip))
    for number, at in enumerate([(1.6, 4.0, 0.3), (3.6, 4.0, 0.25), (2.5, 7.0, 0.0)]):
        pose = np.array([*at, 0.1, 0.2, 0.3, 0.9])
        pose[3:] /= np.linalg.norm(pose[3:])
        world.add_parcel(ParcelBody(parcel=number, size_m=(0.1, 0.08, 0.2), mass_kg=0.4, pose=pose))
    world.add_obstacle(1, np.array([4.0, 2.0, 0.3]), np.array([0.3, 0.2, 0.3]))
    return world


def play(world: BulletWorld, rng: np.random.Generator, n_ticks: int) -> None:
    """Let everything move at random."""
    for tick in range(n_ticks):
        if tick % 10 == 0:
            cars = rng.uniform((-0.8, -1.0), (0.8, 1.0), (world.n_cars, 2))
            turns = rng.uniform(-0.5, 0.5, (world.n_arms, 7))
        world.step(cars, world.arm_positions() + world.tick_s * turns, turns, np.zeros(world.n_arms, dtype=np.bool_))


def engine_fractions(world: BulletWorld, origins: FloatArray, ends: FloatArray) -> FloatArray:
    """What the engine itself says of rays."""
    return np.array([hit[2] for hit in world._client.rayTestBatch(origins.tolist(), ends.tolist())])


def gaps_m(world: BulletWorld, origins: FloatArray, ends: FloatArray) -> FloatArray:
    """Distance of what is said from what the engine says, along each ray."""
    gaps = world.rays(origins, ends) - engine_fractions(world, origins, ends)
    return np.asarray(np.abs(gaps) * np.linalg.norm(ends - origins, axis=1))


@pytest.mark.parametrize("grip", [Grip.SUCTION, Grip.FRICTION])
def test_rays_meet_what_the_engine_says_they_meet(grip: Grip) -> None:
    rng, world = np.random.default_rng(0), crowded(grip)
    for _ in range(8):
        play(world, rng, 20)
        flat = rng.uniform((0.0, 0.0, 0.07), (10.0, 10.0, 0.07), (2, 1000, 3))
        free = rng.uniform((0.0, 0.0, -0.2), (10.0, 10.0, 1.5), (2, 1000, 3))
        gaps = np.concatenate([gaps_m(world, *flat), gaps_m(world, *free)])
        # The engine itself is inexact past edges of boxes.
        assert np.mean(gaps > 1e-6) < 0.02
        assert np.mean(gaps > 0.02) < 0.002
    world.close()


@pytest.mark.parametrize("grip", [Grip.SUCTION, Grip.FRICTION])
def test_no_ray_goes_through_an_arm_or_a_parcel(grip: Grip) -> None:
    """Rays that begin at random near links and parcels and end within them, with fingers wherever they go."""
    rng, world = np.random.default_rng(1), crowded(grip)
    client = world._client
    moving = [(arm, link) for arm in world._arms.bodies for link in range(-1, client.getNumJoints(arm))]
    moving += [(body, -1) for body in world._parcels.by_body]
    n_met = 0
    for _ in range(6):
        play(world, rng, 15)
        for arm in world._arms.bodies:
            for joint in range(7, client.getNumJoints(arm)):
                low, high = client.getJointInfo(arm, joint)[8:10]
                if low < high:
                    client.resetJointState(arm, joint, rng.choice([low, high]))
        client.performCollisionDetection()
        for body, link in moving:
            low, high = np.array(client.getAABB(body, link))
            ends = rng.uniform(low, high, (60, 3))
            ends[:, 2] = np.maximum(ends[:, 2], 0.01)
            origins = ends + rng.normal(0.0, 0.6, ends.shape)
            origins[:, 2] = np.maximum(origins[:, 2], 0.01)
            hits = client.rayTestBatch(origins.tolist(), ends.tolist())
            met = np.array([(hit[0], hit[1]) == (body, link) and hit[2] > 0.0 for hit in hits])
            said = np.array([hit[2] for hit in hits])
            assert np.array_equal(world.rays(origins, ends)[met], said[met]), (body, link)
            n_met += int(met.sum())
    assert n_met > 1000
    world.close()


def test_rays_see_an_arm_that_rested_and_was_hit() -> None:
    rng, world = np.random.default_rng(4), crowded(cars=CARS[2:])  # no car is near
    client, body = world._client, world._arms.bodies[1]
    q, still = world.arm_positions(), np.zeros((world.n_cars, 2))

    def rest() -> None:
        world.step(still, q, np.zeros_like(q), np.zeros(2, dtype=np.bool_))

    for _ in range(60):
        rest()
    rested, away = world.arm_positions()[1], 0.0
    elbow = np.array(client.getAABB(body, 4)).mean(axis=0)
    pose = np.array([elbow[0] + 0.5, elbow[1], elbow[2], 0.0, 0.0, 0.0, 1.0])
    world.add_parcel(ParcelBody(parcel=7, size_m=(0.3, 0.3, 0.3), mass_kg=20.0, pose=pose))
    client.resetBaseVelocity(world._parcels.body(7), (-15.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for _ in range(20):
        rest()
        told = [state[0] for state in client.getJointStates(body, range(7))]
        assert np.array_equal(world.arm_positions()[1], told)
        away = max(away, float(np.abs(told - rested).max()))
        ends = rng.uniform(elbow - 0.5, elbow + 0.5, (500, 3))
        origins = ends + rng.normal(0.0, 0.5, ends.shape)
        hits = client.rayTestBatch(origins.tolist(), ends.tolist())
        met = np.array([hit[0] == body for hit in hits])
        assert np.array_equal(world.rays(origins, ends)[met], np.array([hit[2] for hit in hits])[met])
    assert away > 0.3
    world.close()


def test_rays_of_a_new_world_see_all_of_the_cars() -> None:
    """The engine finds new bodies at its first search only; some of these rays are its own, as they come near arms."""
    rng, world = np.random.default_rng(5), crowded()
    ends = rng.uniform((1.0, 3.0, 0.01), (5.0, 7.0, 0.4), (4000, 3))
    origins = rng.uniform((1.0, 3.0, 0.01), (5.0, 7.0, 1.5), (4000, 3))
    before = world.rays(origins, ends)
    world._client.performCollisionDetection()
    assert np.array_equal(world.rays(origins, ends), before)
    world.close()


def test_rays_see_cars_that_lie_on_their_side() -> None:
    rng, world = np.random.default_rng(2), crowded()
    body = world._cars.bodies[2]
    world._client.resetBasePositionAndOrientation(body, (1.5, 1.0, 0.3), (0.6, 0.2, 0.1, 0.77))
    play(world, rng, 5)
    x, y, _ = world.car_poses()[2]
    ends = rng.uniform((x - 0.5, y - 0.5, 0.01), (x + 0.5, y + 0.5, 0.6), (2000, 3))
    origins = rng.uniform((0.0, 0.0, 0.01), (4.0, 3.0, 0.6), (2000, 3))
    assert abs(world._cars.now.frames[2, 2, 2]) < 0.9
    hits = world._client.rayTestBatch(origins.tolist(), ends.tolist())
    met = np.array([hit[0] == body and hit[2] > 0.0 for hit in hits])
    assert met.sum() > 200
    gaps = gaps_m(world, origins, ends)[met]
    assert np.mean(gaps > 1e-6) < 0.1
    assert np.quantile(gaps, 0.98) < 0.01
    world.close()


def test_rays_past_an_edge_are_exact() -> None:
    """The engine stops some of these too early; a slab is what it is."""
    world = crowded()
    x, y = 7.0 - 0.4, 3.0 + 1.5  # a corner of the shelf
    offsets = np.array([-0.002, -0.0005, 0.0005, 0.002])
    # Diagonal rays that pass the corner on either side.
    origins = np.array([[x - 1.0 + d, y - 1.0 - d, 0.5] for d in offsets])
    ends = origins + np.array([2.0, 2.0, 0.0])
    assert (world.rays(origins, ends) < 1.0).tolist() == [False, False, True, True]
    world.close()


def test_rays_that_begin_inside_of_something_are_the_engines() -> None:
    world = crowded()
    play(world, np.random.default_rng(3), 1)
    inside = np.array([[7.0, 3.0, 0.5], [*world.car_poses()[0, :2], 0.1], [3.0, 4.0, 0.05], [5.0, 5.0, -0.1]])
    ends = inside + np.array([2.0, 0.5, 0.3])
    assert np.array_equal(world.rays(inside, ends), engine_fractions(world, inside, ends))
    assert np.array_equal(world.rays(inside, inside), engine_fractions(world, inside, inside))
    world.close()


def test_rays_of_a_world_without_robots() -> None:
    world = crowded()
    bare = dataclasses.replace(
        world._scene,
        car_start=np.zeros((0, 3)),
        arms=world._scene.arms.part(()),
        arm_base=np.zeros((0, 4)),
        arm_start=np.zeros((0, 7)),
    )
    world.close()
    world = BulletWorld(bare)
    origins, ends = np.array([[5.0, 5.0, 0.5]]), np.array([[5.0, 10.0, 0.5]])
    assert world.rays(origins, ends) == pytest.approx([0.92])
    world.close()
