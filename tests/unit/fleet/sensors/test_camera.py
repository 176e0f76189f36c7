"""Camera: pinhole geometry, and every argument that no camera can have is refused by name."""

import math
from typing import Any

import numpy as np
import pytest

from fleet.sensors.camera import Camera, CameraImage
from fleet.sensors.errors import SensorError

LOOKING: dict[str, Any] = {"eye_m": (1.0, 2.0, 3.0), "target_m": (1.5, 2.5, 0.0)}


def camera(**changes: Any) -> Camera:
    return Camera.looking_at("eye", **(LOOKING | changes))


def test_the_target_is_in_the_middle_and_up_is_up() -> None:
    eye = camera(width_px=320, height_px=200)
    u, v, depth = eye.project(np.array(LOOKING["target_m"]))
    assert (u, v) == pytest.approx((159.5, 99.5))
    assert depth == pytest.approx(math.sqrt(0.25 + 0.25 + 9.0))
    _, above, _ = eye.project(np.array([1.5, 2.5, 0.1]))
    assert above < v


def test_intrinsics_follow_from_the_field_of_view() -> None:
    eye = camera(width_px=640, height_px=480, fov_rad=math.radians(90.0))
    assert np.allclose(eye.matrix, [[240.0, 0.0, 319.5], [0.0, 240.0, 239.5], [0.0, 0.0, 1.0]])
    # The upper edge of the image is half the field of view above the axis.
    ray = eye.rays()[0, 320] - (0.0, 0.5 / eye.focal_px, 0.0)
    assert ray[1] == pytest.approx(-1.0)


def test_points_are_seen_where_they_are() -> None:
    eye = camera(width_px=64, height_px=48)
    depth = np.random.default_rng(0).uniform(0.5, 4.0, (48, 64)).astype(np.float32)
    depth[3, 5] = np.inf
    nothing = np.full((48, 64), -1, dtype=np.int32)
    rgb = np.zeros((48, 64, 3), dtype=np.uint8)
    image = CameraImage(camera=eye, rgb=rgb, depth_m=depth, body=nothing, link=nothing, parcel=nothing)
    seen = eye.project(image.points())
    assert np.isnan(image.points()[3, 5]).all()
    v, u = np.nonzero(np.isfinite(depth))
    assert np.allclose(seen[v, u], np.column_stack((u, v, depth[v, u])), atol=1e-6)
    assert image.cloud().shape == (48 * 64 - 1, 3)


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"width_px": 0}, "width_px is 0; valid: an integer from 1 to 2048"),
        ({"height_px": 4000}, "height_px is 4000"),
        ({"width_px": 64.5}, "width_px is 64.5"),
        ({"height_px": True}, "height_px is True"),
        ({"fov_rad": 0.0}, "fov_rad is 0.0; valid: 0.017 to 2.967"),
        ({"fov_rad": math.nan}, "fov_rad is nan"),
        ({"near_m": 0.0}, "near_m is 0.0; valid: a number > 0"),
        ({"near_m": math.nan}, "near_m is nan"),
        ({"far_m": 0.05}, "far_m is 0.05; valid: a number > near_m = 0.1"),
        ({"far_m": math.inf}, "far_m is inf"),
        ({"eye_m": (0.0, math.nan, 0.0)}, "eye_m is"),
        ({"target_m": (1.0, 2.0)}, "target_m is"),
        ({"target_m": (1.0, 2.0, 3.0)}, "valid: a point other than eye_m"),
        ({"up": (0.5, 0.5, -3.0)}, "up is"),
    ],
)
def test_what_no_camera_can_be(changes: dict[str, Any], what: str) -> None:
    with pytest.raises(SensorError, match="camera eye: ") as refused:
        camera(**changes)
    assert what in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("pose", [np.eye(3), np.diag([1.0, 1.0, -1.0, 1.0]), 2.0 * np.eye(4), np.full((4, 4), np.nan)])
def test_a_pose_is_a_rigid_transform(pose: np.ndarray) -> None:
    with pytest.raises(SensorError, match="camera eye: world_from_camera is"):
        Camera(name="eye", world_from_camera=pose)
