"""Images of the physical world against its known geometry."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from fleet.robots import ARMS, ArmTeam
from fleet.robots.cars.racecar import racecar_spec
from fleet.sensors.camera import Camera
from fleet.world.bullet.world import BulletWorld
from fleet.world.protocol import ParcelBody
from fleet.world.scene import Scene, StaticBox

pytestmark = pytest.mark.bullet

SIZE_M, CENTRE_M, YAW_RAD, TOP_M = (0.08, 0.06, 0.1), np.array([1.1, 1.05, 0.25]), 0.3, 0.3
VIEWS = {
    "from above": {"eye_m": (1.0, 1.0, 1.8), "target_m": (1.0, 1.0, 0.0), "up": (0.0, 1.0, 0.0), "fov_rad": 0.5},
    "from the side": {"eye_m": (1.5, 0.1, 1.2), "target_m": (1.0, 1.0, 0.2), "fov_rad": 0.8},
    "askew": {"eye_m": (0.3, 1.3, 0.9), "target_m": (1.0, 1.0, 0.2), "up": (0.3, 0.1, 1.0), "fov_rad": 1.0},
}


@pytest.fixture(scope="module")
def world() -> Iterator[BulletWorld]:
    arm = ARMS["iiwa"].spec()
    scene = Scene(
        size_m=(3.0, 3.0),
        boxes=(StaticBox(kind="pedestal", centre_m=(1.0, 1.0, 0.1), half_m=(0.3, 0.3, 0.1)),),
        car_kinds=(racecar_spec(),),
        car_start=np.zeros((0, 3)),
        arms=ArmTeam.alike(arm, 1),
        arm_base=np.array([[2.4, 2.4, 0.0, 0.0]]),
        arm_start=arm.home_rad[None],
    )
    world = BulletWorld(scene)
    half = YAW_RAD / 2
    pose = np.array([*CENTRE_M, 0.0, 0.0, math.sin(half), math.cos(half)])
    world.add_parcel(ParcelBody(parcel=7, size_m=SIZE_M, mass_kg=0.2, pose=pose))
    yield world
    world.close()


def in_box(points: np.ndarray) -> np.ndarray:
    """Points in the parcel's frame."""
    cos, sin = math.cos(YAW_RAD), math.sin(YAW_RAD)
    return (points - CENTRE_M) @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("view", VIEWS)
def test_the_cloud_lies_on_the_parcel(world: BulletWorld, view: str) -> None:
    image = world.image(Camera.looking_at(view, width_px=401, height_px=300, **VIEWS[view]))
    points = in_box(image.cloud(image.parcel == 7))
    assert len(points) > 150
    outside = np.abs(points) - np.array(SIZE_M) / 2
    # Every point is on one of the faces, and none beyond another.
    assert np.abs(outside.max(axis=1)).max() < 1e-4


@pytest.mark.parametrize("view", VIEWS)
def test_outlines_are_where_the_intrinsics_say(world: BulletWorld, view: str) -> None:
    """To the pixel: half a pixel of shift in the principal point fails for one edge or the other."""
    camera = Camera.looking_at(view, width_px=401, height_px=300, **VIEWS[view])
    image = world.image(camera)
    signs = np.array([(a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    cos, sin = math.cos(YAW_RAD), math.sin(YAW_RAD)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    corners = camera.project((signs * np.array(SIZE_M) / 2) @ turn.T + CENTRE_M)[:, :2]
    v, u = np.nonzero(image.parcel == 7)
    seen = np.column_stack((u, v))
    assert (seen.min(axis=0) >= corners.min(axis=0)).all()
    assert (seen.max(axis=0) <= corners.max(axis=0)).all()
    # Corners are pointed: a pixel or two may be missing there, but the same on all sides.
    assert (seen.min(axis=0) - corners.min(axis=0) < 2.0).all()
    assert (corners.max(axis=0) - seen.max(axis=0) < 2.0).all()
    centre = camera.project(np.array([1.0, 1.0, 0.2]))
    # The pedestal's top, 0.6 m wide: its outline in the row and column of its middle.
    if view == "from above":
        top = np.abs(image.points()[..., 2] - 0.2) < 1e-3
        row = np.nonzero(top[round(centre[1])])[0]
        left, right = camera.project(np.array([[0.7, 1.0, 0.2], [1.3, 1.0, 0.2]]))[:, 0]
        assert (row.min(), row.max()) == (math.ceil(left), math.floor(right))


def test_bodies_links_and_parcels_are_told_apart(world: BulletWorld) -> None:
    camera = Camera.looking_at(
        "far", eye_m=(0.2, 0.2, 2.5), target_m=(1.8, 1.8, 0.3), width_px=320, height_px=240, fov_rad=1.0
    )
    image = world.image(camera)
    assert image.rgb.shape == (240, 320, 3)
    assert image.rgb.std() > 10
    arm = image.body == world._arms.bodies[0]
    assert {0, 1, 2, 3} <= set(image.link[arm].tolist())
    assert set(np.unique(image.parcel)) == {-1, 7}
    assert (image.body[image.parcel == 7] == world._parcels.body(7)).all()
    floor = image.points()[image.body == world._monitor.floor]
    assert np.abs(floor[:, 2]).max() < 1e-3


def test_looking_at_the_sky_sees_nothing(world: BulletWorld) -> None:
    image = world.image(Camera.looking_at("sky", eye_m=(1, 1, 2), target_m=(1.2, 1, 4), width_px=32, height_px=24))
    assert (image.body == -1).all()
    assert (image.link == -1).all()
    assert np.isinf(image.depth_m).all()
    assert image.cloud().shape == (0, 3)


def test_what_is_too_near_or_too_far_is_not_seen(world: BulletWorld) -> None:
    look = {"eye_m": (1.1, 1.05, 1.3), "target_m": (1.1, 1.05, 0.0), "up": (0, 1, 0), "width_px": 64, "height_px": 48}
    assert (world.image(Camera.looking_at("all", **look)).parcel == 7).any()
    near = world.image(Camera.looking_at("near", near_m=1.05, far_m=2.0, **look))
    far = world.image(Camera.looking_at("far", near_m=0.1, far_m=0.9, **look))
    assert not (near.depth_m < 1.05).any()
    assert not np.isfinite(far.depth_m).any()


def test_looking_changes_nothing(world: BulletWorld) -> None:
    before = world.state_bytes()
    images = [world.image(Camera.looking_at("eye", **VIEWS["askew"])) for _ in range(2)]
    assert world.state_bytes() == before
    for name in ("rgb", "depth_m", "body", "link", "parcel"):
        assert np.array_equal(getattr(images[0], name), getattr(images[1], name)), name
