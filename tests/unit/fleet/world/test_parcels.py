"""PlanarParcels: where they come to rest, and what they ride on."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from fleet.world.parcels import ParcelError, PlanarParcels
from fleet.world.protocol import ParcelBody
from fleet.world.scene import Scene

FloatArray = npt.NDArray[np.float64]
DOWN = (1.0, 0.0, 0.0, 0.0)  # tool axis straight down: half a turn about x
ON, OFF = np.array([True]), np.array([False])
AWAY = np.array([[0.0, 0.0, 2.0, *DOWN]])


def box(parcel: int, x: float, y: float, z: float, yaw: float = 0.0) -> ParcelBody:
    """Return a parcel 0.10 x 0.08 x 0.06 m."""
    pose = np.array([x, y, z, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)])
    return ParcelBody(parcel=parcel, size_m=(0.10, 0.08, 0.06), mass_kg=1.0, pose=pose)


def tip(x: float, y: float, z: float) -> FloatArray:
    """Return one tool tip that points down."""
    return np.array([[x, y, z, *DOWN]])


@pytest.fixture
def parcels(hall: Scene) -> PlanarParcels:
    """Return an empty hall."""
    return PlanarParcels(hall.boxes, hall.cars, 1)


def test_parcel_drops_on_the_highest_thing_below(parcels: PlanarParcels, hall: Scene) -> None:
    cars = hall.car_start
    parcels.add(box(3, 7.0, 3.0, 1.0), cars)  # floor
    parcels.add(box(1, 2.05, 5.0, 0.5), cars)  # pedestal, top 0.25
    parcels.add(box(2, 1.5 + 0.16, 1.5, 0.5), cars)  # tray of car 0, floor 0.18
    parcels.add(box(4, 2.05, 5.02, 0.5), cars)  # on top of parcel 1
    parcels.add(box(5, 2.0, 5.0, 0.10), cars)  # below the pedestal's top: beside it, on the floor
    assert parcels.ids.tolist() == [1, 2, 3, 4, 5]
    assert parcels.poses[:, 2] == pytest.approx([0.28, 0.21, 0.03, 0.34, 0.03])


def test_parcel_rides_in_the_tray_of_a_turning_car(parcels: PlanarParcels, hall: Scene) -> None:
    cars = hall.car_start.copy()
    parcels.add(box(0, 1.5 + 0.20, 1.5 + 0.05, 0.3, yaw=0.3), cars)
    cars[0] = (5.0, 2.0, math.pi / 2)
    parcels.update(cars, AWAY, OFF)
    assert parcels.poses[0, :3] == pytest.approx([5.0 - 0.05, 2.2, 0.21])
    assert 2 * math.atan2(parcels.poses[0, 5], parcels.poses[0, 6]) == pytest.approx(0.3 + math.pi / 2)


def test_suction_takes_only_what_it_touches(parcels: PlanarParcels, hall: Scene) -> None:
    cars = hall.car_start
    parcels.add(box(8, 2.0, 5.0, 0.5), cars)  # top face at 0.31
    parcels.update(cars, tip(2.0, 5.0, 0.335), ON)
    assert parcels.held.tolist() == [-1]
    parcels.update(cars, tip(2.0, 5.015, 0.315), ON)
    assert parcels.held.tolist() == [8]
    parcels.update(cars, tip(2.5, 5.015, 0.815), ON)
    assert parcels.poses[0, :3] == pytest.approx([2.5, 5.0, 0.78])


def test_held_parcel_turns_with_the_tool(parcels: PlanarParcels, hall: Scene) -> None:
    cars = hall.car_start
    parcels.add(box(8, 2.0, 5.0, 0.5), cars)
    parcels.update(cars, tip(2.0, 5.0, 0.31), ON)
    level = np.array([[3.0, 3.0, 1.0, 0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)]])  # tool axis along +x
    parcels.update(cars, level, ON)
    assert parcels.poses[0, :3] == pytest.approx([3.03, 3.0, 1.0])


def test_released_parcel_lands_in_the_tray_and_leaves_with_the_car(parcels: PlanarParcels, hall: Scene) -> None:
    cars = hall.car_start.copy()
    parcels.add(box(8, 2.0, 5.0, 0.5), cars)
    parcels.update(cars, tip(2.0, 5.0, 0.31), ON)
    parcels.update(cars, tip(1.66, 1.5, 0.26), ON)
    parcels.update(cars, tip(1.66, 1.5, 0.26), OFF)
    assert parcels.held.tolist() == [-1]
    assert parcels.poses[0, :3] == pytest.approx([1.66, 1.5, 0.21])
    cars[0, 0] += 1.0
    parcels.update(cars, AWAY, OFF)
    assert parcels.poses[0, :3] == pytest.approx([2.66, 1.5, 0.21])


def test_two_tools_never_hold_one_parcel(hall: Scene) -> None:
    parcels = PlanarParcels(hall.boxes, hall.cars, 2)
    parcels.add(box(0, 7.0, 3.0, 0.1), hall.car_start)
    parcels.update(hall.car_start, np.repeat(tip(7.0, 3.0, 0.06), 2, axis=0), np.array([True, True]))
    assert sorted(parcels.held.tolist()) == [-1, 0]


def test_remove_frees_the_grip(parcels: PlanarParcels, hall: Scene) -> None:
    parcels.add(box(0, 7.0, 3.0, 0.1), hall.car_start)
    parcels.update(hall.car_start, tip(7.0, 3.0, 0.06), ON)
    parcels.remove(0)
    assert parcels.held.tolist() == [-1]
    assert len(parcels.ids) == 0
    parcels.update(hall.car_start, AWAY, ON)


def test_ids_are_checked(parcels: PlanarParcels, hall: Scene) -> None:
    parcels.add(box(4, 7.0, 3.0, 0.1), hall.car_start)
    with pytest.raises(ParcelError, match="parcel 4 is in the world already"):
        parcels.add(box(4, 6.0, 3.0, 0.1), hall.car_start)
    with pytest.raises(ParcelError, match=r"parcel 5 is not in the world; valid: \[4\]"):
        parcels.remove(5)
