"""Perception: a parcel is where it is, or where a camera's picture shows it."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.missions.parcels.perception import SeenPoses, TruePoses
from fleet.sensors.camera import Camera
from fleet.sensors.station_camera import station_camera
from fleet.tasks.board import Task
from tests.unit.fleet.missions.floor import CAR, SIZE_M, Floor, delivery, fake


def camera_of(floor: Floor) -> Camera:
    place = floor.stations[0].place
    return station_camera(place, place.dock.tray_xy, CAR.tray_floor_z_m)


def picture(floor: Floor, size_m: tuple[float, float, float] = SIZE_M, label: int = 0, tall_m: float = 0.0) -> None:
    """The camera sees a straight box where parcel 0 lies: a face over a floor, pixel by pixel."""
    camera = camera_of(floor)
    centre = floor.world.poses[0][:3]
    eye = camera.world_from_camera[:3, 3]
    rays = camera.rays() @ camera.world_from_camera[:3, :3].T
    top = centre[2] + size_m[2] / 2
    depth = (eye[2] - 0.0) / -rays[..., 2]
    labels = np.full(depth.shape, -1)
    to_top = (eye[2] - top) / -rays[..., 2]
    hits = eye[:2] + rays[..., :2] * to_top[..., None]
    hit = (np.abs(hits - centre[:2]) <= np.array(size_m[:2]) / 2).all(axis=-1)
    depth, labels = np.where(hit, to_top, depth), np.where(hit, label, labels)
    if tall_m:  # something before it hides a half
        hidden = hit & (hits[..., 0] > centre[0])
        depth, labels = np.where(hidden, depth - tall_m, depth), np.where(hidden, -1, labels)
    floor.world.picture = fake(depth_m=depth, parcel=labels)


def seeing() -> tuple[Floor, Task, SeenPoses]:
    floor = Floor(orders=[delivery("a")])
    task = floor.shelved("a")
    return floor, task, SeenPoses(floor.stations, CAR, floor.world, floor.inventory, floor.log)


def test_true_poses_are_those_of_the_world() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.shelved("a")
    sighting = TruePoses(floor.inventory).find(task, floor.stations[0])
    np.testing.assert_array_equal(sighting.pose, floor.world.poses[0])
    assert (sighting.size_m, sighting.reason) == (SIZE_M, "")


def test_a_parcel_is_located_to_millimetres_by_its_upper_face() -> None:
    floor, task, perception = seeing()
    picture(floor)
    sighting = perception.find(task, floor.stations[0])
    assert sighting.reason == ""
    assert sighting.size_m == (0.06, 0.05, 0.04)
    np.testing.assert_allclose(sighting.pose[:3], floor.world.poses[0][:3], atol=0.003)
    (error,) = perception.errors
    assert error.distance_m < 0.003
    assert error.turn_rad < 0.05
    assert floor.log.kinds()[-1] == "parcel_located"
    assert perception.looks["pick_1"] is floor.world.picture


def test_a_face_that_is_none_of_the_parcels_is_not_believed() -> None:
    floor, task, perception = seeing()
    picture(floor, size_m=(0.10, 0.05, 0.04))
    sighting = perception.find(task, floor.stations[0])
    assert sighting.reason.startswith("camera_pick_1 sees a face of 0.")
    assert sighting.reason.endswith("which is none of the parcel's")
    assert np.isnan(sighting.pose).all()
    assert perception.n_blind == 1


def test_a_parcel_that_is_not_in_the_picture_is_not_located() -> None:
    floor, task, perception = seeing()
    picture(floor, label=7)
    sighting = perception.find(task, floor.stations[0])
    assert sighting.reason == "camera_pick_1 sees no part of the parcel"
    assert floor.log.events[-1][0] == "parcel_not_located"


def test_a_parcel_that_is_half_hidden_is_not_located() -> None:
    floor, task, perception = seeing()
    picture(floor, tall_m=0.1)
    assert perception.find(task, floor.stations[0]).reason == "camera_pick_1 sees the parcel partly hidden"


def test_no_look_is_needed_for_a_parcel_in_the_grip() -> None:
    floor, task, perception = seeing()
    floor.world.in_grip[0] = task.parcel
    sighting = perception.find(task, floor.stations[0])
    assert floor.world.looked == []
    assert sighting.pose == pytest.approx(floor.world.poses[0])
