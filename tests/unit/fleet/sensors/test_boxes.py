"""Locating boxes in images that are computed ray by ray from boxes whose poses are known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fleet.sensors.boxes import LocateStatus, SeenBox, locate_boxes
from fleet.sensors.camera import Camera
from fleet.sensors.errors import SensorError

CAMERA = Camera.looking_at(
    "above",
    eye_m=(0.0, 0.0, 1.2),
    target_m=(0.0, 0.0, 0.0),
    up=(0.0, 1.0, 0.0),
    width_px=480,
    height_px=360,
    fov_rad=math.radians(28.0),
)


@dataclass
class Box:
    size_m: tuple[float, float, float]
    centre_m: tuple[float, float, float]
    yaw_rad: float = 0.0
    tilt_rad: float = 0.0
    """About its own x axis."""
    pitch_rad: float = 0.0
    """About its own y axis, before that."""

    @property
    def rotation(self) -> np.ndarray:
        return Rotation.from_euler("ZYX", (self.yaw_rad, self.pitch_rad, self.tilt_rad)).as_matrix()


def taken(boxes: list[Box], camera: Camera = CAMERA) -> tuple[np.ndarray, np.ndarray]:
    """Depths and labels of boxes on a floor at z = 0: slabs method, pixel by pixel."""
    eye = camera.world_from_camera[:3, 3]
    rays = camera.rays() @ camera.world_from_camera[:3, :3].T
    depth = np.where(rays[..., 2] < 0, -eye[2] / np.minimum(rays[..., 2], -1e-9), np.inf)
    labels = np.full(depth.shape, -1)
    for label, box in enumerate(boxes):
        origin = (eye - box.centre_m) @ box.rotation
        turned = rays @ box.rotation
        turned[turned == 0] = 1e-12
        ends = np.stack([(sign * np.array(box.size_m) / 2 - origin) / turned for sign in (-1, 1)])
        first, last = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
        hit = (first <= last) & (first > 0) & (first < depth)
        depth, labels = np.where(hit, first, depth), np.where(hit, label, labels)
    return depth, labels


def errors(seen: SeenBox, box: Box) -> tuple[float, float]:
    """Distance of the top's centre [m], and turn between the sides, right angles apart [rad]."""
    top = np.array(box.centre_m) + box.rotation[:, 2] * box.size_m[2] / 2
    off_rad = seen.yaw_rad - box.yaw_rad
    return float(np.linalg.norm(seen.world_from_top[:3, 3] - top)), abs(
        (off_rad + math.pi / 4) % (math.pi / 2) - math.pi / 4
    )


def test_lone_boxes_anywhere_and_any_way_round() -> None:
    rng = np.random.default_rng(0)
    wrong_m, wrong_rad, wrong_size_m = [], [], []
    for _ in range(60):
        size = tuple(rng.uniform(0.05, 0.08, 3))
        x, y = rng.uniform((-0.25, -0.18), (0.25, 0.18))
        box = Box(size, (x, y, size[2] / 2), rng.uniform(-math.pi, math.pi))
        search = locate_boxes(CAMERA, *taken([box]), 0.0)
        assert search.status is LocateStatus.FOUND
        seen = search.best
        assert seen is not None
        distance_m, turn_rad = errors(seen, box)
        wrong_m.append(distance_m)
        wrong_rad.append(turn_rad)
        wrong_size_m.append(np.abs(np.array(seen.size_m) - (*sorted(size[:2], reverse=True), size[2])).max())
        assert seen.tilt_rad < 3e-3
        assert seen.centre_m[2] == pytest.approx(size[2] / 2, abs=1e-3)
    assert max(wrong_m) < 1e-3
    assert max(wrong_rad) < math.radians(1.5)
    assert np.median(wrong_rad) < math.radians(0.5)
    assert max(wrong_size_m) < 2e-3


def test_a_box_that_leans() -> None:
    for tilt in (-0.5, -0.2, 0.1, 0.3, 0.6):
        box = Box((0.08, 0.06, 0.05), (0.05, -0.04, 0.06), yaw_rad=0.4, tilt_rad=tilt)
        seen = locate_boxes(CAMERA, *taken([box]), 0.0).best
        assert seen is not None
        assert errors(seen, box)[0] < 1.5e-3
        assert seen.tilt_rad == pytest.approx(abs(tilt), abs=0.02)
        assert seen.world_from_top[:3, 2] @ box.rotation[:, 2] > 0.999


@pytest.mark.parametrize("least_up", [0.5, 0.7])
def test_a_box_on_its_corner_has_a_face_or_none_but_no_plane_across_its_edges(
    monkeypatch: pytest.MonkeyPatch, least_up: float
) -> None:
    monkeypatch.setattr("fleet.sensors.boxes.LEAST_UP", least_up)
    corner = math.atan(math.sqrt(0.5))
    box = Box((0.07, 0.07, 0.07), (0.05, -0.04, 0.09), yaw_rad=0.4, tilt_rad=math.radians(45.0), pitch_rad=corner)
    search = locate_boxes(CAMERA, *taken([box]), 0.0)
    assert (search.status is LocateStatus.FOUND) == (least_up < 1 / math.sqrt(3))
    for seen in search.boxes:
        normals = box.rotation.T @ seen.world_from_top[:3, 2]
        assert np.abs(normals).max() > 0.999
        face = np.array(box.centre_m) + 0.035 * seen.world_from_top[:3, 2]
        assert np.linalg.norm(seen.world_from_top[:3, 3] - face) < 2e-3


def test_a_noisy_depth() -> None:
    box = Box((0.08, 0.06, 0.05), (0.1, 0.05, 0.025), yaw_rad=0.7)
    depth, labels = taken([box])
    noise = np.random.default_rng(0).normal(0.0, 0.0006, depth.shape)
    seen = locate_boxes(CAMERA, depth + noise, labels, 0.0).best
    assert seen is not None
    distance_m, turn_rad = errors(seen, box)
    assert distance_m < 2e-3
    assert turn_rad < math.radians(2.0)


def test_touching_boxes_are_told_apart_and_the_highest_comes_first() -> None:
    boxes = [Box((0.06, 0.06, 0.05), (-0.03, 0.0, 0.025)), Box((0.06, 0.06, 0.07), (0.03, 0.0, 0.035))]
    search = locate_boxes(CAMERA, *taken(boxes), 0.0)
    assert [box.label for box in search.boxes] == [1, 0]
    assert max(errors(box, boxes[box.label])[0] for box in search.boxes) < 1e-3


def test_what_lies_under_another_is_obstructed() -> None:
    boxes = [Box((0.08, 0.08, 0.05), (0.0, 0.0, 0.025)), Box((0.06, 0.06, 0.06), (0.035, 0.02, 0.08))]
    search = locate_boxes(CAMERA, *taken(boxes), 0.0)
    assert search.status is LocateStatus.FOUND
    assert [(box.label, box.obstructed) for box in search.boxes] == [(1, False), (0, True)]
    below = locate_boxes(CAMERA, taken(boxes)[0], np.where(taken(boxes)[1] == 0, 0, -1), 0.0)
    assert below.status is LocateStatus.ALL_OBSTRUCTED
    assert below.best is None
    assert len(below.boxes) == 1


def test_a_wall_beside_a_box_hides_nothing() -> None:
    wall, box = Box((0.01, 0.5, 0.14), (0.205, 0.0, 0.07)), Box((0.06, 0.06, 0.05), (0.17, 0.0, 0.025))
    depth, labels = taken([wall, box])
    search = locate_boxes(CAMERA, depth, np.where(labels == 1, 1, -1), 0.0)
    assert search.status is LocateStatus.FOUND


def test_a_box_at_the_edge_of_the_image_is_obstructed() -> None:
    half_m = 1.2 * 180 / CAMERA.focal_px
    search = locate_boxes(CAMERA, *taken([Box((0.08, 0.08, 0.002), (0.0, half_m, 0.001))]), 0.0)
    assert search.status is LocateStatus.ALL_OBSTRUCTED


def test_nothing_there_is_a_status() -> None:
    depth, labels = taken([])
    assert locate_boxes(CAMERA, depth, labels, 0.0).status is LocateStatus.NOTHING_SEEN
    assert locate_boxes(CAMERA, np.full(depth.shape, np.inf), labels + 1, 0.0).status is LocateStatus.NOTHING_SEEN
    assert locate_boxes(CAMERA, np.full(depth.shape, np.nan), labels + 1, 0.0).best is None


def test_no_face_is_a_status() -> None:
    far = taken([Box((0.008, 0.008, 0.01), (0.0, 0.0, 0.005))])
    assert locate_boxes(CAMERA, *far, 0.0).status is LocateStatus.NO_FACE
    # A wall seen from the front: no face of it looks up.
    front = Camera.looking_at("front", eye_m=(0, -1, 0.05), target_m=(0, 0, 0.05), width_px=200, height_px=150)
    seen = taken([Box((0.3, 0.05, 0.3), (0.0, 0.0, 0.15))], front)
    assert locate_boxes(front, *seen, 0.0).status is LocateStatus.NO_FACE


@pytest.mark.parametrize("labels", [0, 7])
def test_noise_for_an_image_ends_in_a_status(labels: int) -> None:
    rng = np.random.default_rng(labels)
    depth = rng.uniform(0.1, 2.0, (360, 480))
    depth[rng.random(depth.shape) < 0.3] = np.nan
    search = locate_boxes(CAMERA, depth, rng.integers(-1, labels + 1, depth.shape), 0.0)
    assert search.status is not LocateStatus.FOUND


def test_bad_arguments_are_named() -> None:
    depth, labels = taken([])
    with pytest.raises(SensorError, match=r"depth_m is of shape \(2, 2\); valid: \(360, 480\)"):
        locate_boxes(CAMERA, np.zeros((2, 2)), labels, 0.0)
    with pytest.raises(SensorError, match="labels is of shape"):
        locate_boxes(CAMERA, depth, labels[1:], 0.0)
    with pytest.raises(SensorError, match="support_z_m is nan"):
        locate_boxes(CAMERA, depth, labels, math.nan)
