"""Transfers: what an arm is asked, depending on where the parcel is and how often it was tried."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.missions.parcels.perception import Sighting
from fleet.stations.arms.transfer import LOOSE, TRAY
from fleet.tasks.board import Task, TaskState
from tests.unit.fleet.missions.floor import SIZE_M, Floor, delivery, fake


def loading() -> tuple[Floor, Task]:
    """Car 0 stands at pick_1, and the parcel lies on slot 0."""
    floor = Floor(orders=[delivery("a")])
    task = floor.assigned("a", car=0)
    floor.come(0)
    floor.board.move(task, TaskState.LOADING, 0.0, "by hand")
    return floor, task


def test_a_parcel_is_moved_from_its_slot_into_the_tray() -> None:
    floor, task = loading()
    floor.transfers.request(floor.stations[0], task, 0, tick=3)
    (request,) = floor.arms.requests
    assert (request.arm, request.parcel, request.pick_via, request.place_via) == (0, 0, 0, TRAY)
    assert request.size_m == SIZE_M
    np.testing.assert_array_equal(request.car_pose, floor.car_poses()[0])
    np.testing.assert_array_equal(request.pick_pose, floor.inventory.pose(task))


def test_a_parcel_is_moved_from_the_tray_onto_its_slot() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=1)
    floor.come(1)
    floor.lay_in_tray(task, 1)
    floor.board.move(task, TaskState.UNLOADING, 0.0, "by hand")
    task.drop_slot = 2
    floor.transfers.request(floor.stations[2], task, 1, tick=3)
    (request,) = floor.arms.requests
    assert (request.arm, request.pick_via, request.place_via) == (2, TRAY, 2)


def test_a_parcel_beside_its_slot_is_gripped_as_it_lies() -> None:
    floor, task = loading()
    floor.lay_on_floor(task)
    floor.transfers.request(floor.stations[0], task, 0, tick=0)
    assert floor.arms.requests[0].pick_via == LOOSE


def test_the_third_and_last_attempt_grips_a_parcel_as_it_lies() -> None:
    floor, task = loading()
    may = []
    for _ in range(3):
        floor.transfers.request(floor.stations[0], task, 0, tick=0)
        may.append(floor.transfers.may_repeat(task))
    assert [request.pick_via for request in floor.arms.requests] == [0, 0, LOOSE]
    assert may == [True, True, False]


def test_the_next_errand_of_a_task_may_be_tried_as_often() -> None:
    floor, task = loading()
    for _ in range(3):
        floor.transfers.request(floor.stations[0], task, 0, tick=0)
    floor.transfers.succeed(task)
    assert floor.transfers.may_repeat(task)


def test_a_parcel_that_the_arm_holds_already_is_not_loose() -> None:
    floor, task = loading()
    floor.lay_on_floor(task)
    floor.world.in_grip[0] = task.parcel
    floor.transfers.request(floor.stations[0], task, 0, tick=0)
    assert floor.arms.requests[0].pick_via == 0


def test_a_parcel_that_is_not_found_is_refused() -> None:
    floor, task = loading()
    floor.perception = fake(find=lambda task, station: Sighting(pose=np.zeros(7), size_m=SIZE_M, reason="is dark"))
    floor.transfers.request(floor.stations[0], task, 0, tick=0)
    assert floor.arms.refused == [(0, 0, "is dark")]
    assert floor.arms.requests == []


def test_a_task_without_a_slot_is_not_served() -> None:
    floor, task = loading()
    task.pick_slot = None
    with pytest.raises(AssertionError, match="has a slot"):
        floor.transfers.request(floor.stations[0], task, 0, tick=0)
