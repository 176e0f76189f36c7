"""Inventory: parcels enter, leave, and are looked up where the world has them."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.missions.parcels.inventory import ASKEW_M, DROP_M, _half_height
from fleet.tasks.board import TaskState
from tests.unit.fleet.missions.floor import CAR, SIZE_M, Floor, delivery


def delivered(now_s: float = 10.0) -> Floor:
    """The parcel of `a` lies on the first slot of drop_1, to be collected after 5 s."""
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=0)
    floor.board.move(task, TaskState.UNLOADING, now_s, "by hand")
    task.drop_slot = floor.stations.named("drop_1").take_slot(task.index)
    floor.lay_on_slot(task, 0, "drop_1")
    floor.board.move(task, TaskState.DELIVERED, now_s, "by hand")
    floor.missions.release(0)
    floor.inventory.collect_later(floor.stations.named("drop_1"), 0, now_s)
    return floor


def test_a_parcel_enters_just_above_the_middle_of_its_slot() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.shelved("a")
    x, y, z = floor.stations.named("pick_1").place.slots[0]
    np.testing.assert_allclose(floor.inventory.pose(task), [x, y, z + SIZE_M[2] / 2 + DROP_M, 0, 0, 0, 1])
    assert floor.world.masses[task.parcel] == 0.5
    assert task.state is TaskState.READY
    assert floor.log.events == [("parcel_entered", {"task": "a", "station": "pick_1", "slot": 0})]
    assert (floor.inventory.n_entered, floor.inventory.balance()) == (1, 0)


def test_parcels_that_are_put_down_anyhow_lie_near_the_middle() -> None:
    floor = Floor(orders=[delivery(f"o{k}") for k in range(4)], askew=np.random.default_rng(1))
    slots = floor.stations.named("pick_1").place.slots
    off = np.array([floor.inventory.pose(floor.shelved(f"o{k}"))[:2] - slots[k, :2] for k in range(4)])
    assert (np.abs(off) <= ASKEW_M).all()
    assert len(np.unique(off)) == 8


def test_a_task_without_a_slot_cannot_enter() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.release()
    with pytest.raises(AssertionError, match="has a slot"):
        floor.inventory.enter(floor.task("a"), 0.0)


@pytest.mark.parametrize(("off_m", "lift_m", "stands"), [(0.049, 0.0, True), (0.051, 0.0, False), (0.0, 0.016, False)])
def test_a_parcel_is_on_a_slot_within_5_cm_and_15_mm_of_height(off_m: float, lift_m: float, stands: bool) -> None:
    floor = Floor(orders=[delivery("a")])
    task, station = floor.shelved("a"), floor.stations[0]
    floor.lay_on_slot(task, 0, "pick_1")
    floor.world.poses[0][0] += off_m
    floor.world.poses[0][2] += lift_m
    assert floor.inventory.on_slot(task, 0, station) is stands


def test_no_parcel_is_on_no_slot() -> None:
    floor = Floor(orders=[delivery("a")])
    assert not floor.inventory.on_slot(floor.shelved("a"), None, floor.stations[0])


def test_a_box_on_its_edge_is_as_high_as_it_is_turned() -> None:
    """A box of 6 x 5 x 4 cm, turned by 90 degrees about x, is 5 cm high; about y, 6 cm."""
    half = np.sqrt(0.5)
    assert _half_height(np.array([0, 0, 0, 0, 0, 0, 1.0]), SIZE_M) == pytest.approx(0.020)
    assert _half_height(np.array([0, 0, 0, half, 0, 0, half]), SIZE_M) == pytest.approx(0.025)
    assert _half_height(np.array([0, 0, 0, 0, half, 0, half]), SIZE_M) == pytest.approx(0.030)


def test_a_parcel_beside_a_slot_obstructs_it_where_another_could_not_stand() -> None:
    """Half of the longest edge there is and of the diagonal of this box: (0.1 + 0.0877) / 2 = 0.0939 m."""
    floor = Floor(orders=[delivery("a")])
    task, station = floor.shelved("a"), floor.stations[0]
    found = []
    for off_m in (0.093, 0.095):
        floor.lay_on_slot(task, 0, "pick_1")
        floor.world.poses[0][0] += off_m
        found.append(floor.inventory.obstructs(task, 0, station))
    floor.lay_on_floor(task)
    found.append(floor.inventory.obstructs(task, 0, station))
    assert found == [True, False, False]


def test_a_parcel_is_in_the_tray_of_the_car_it_lies_in() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.shelved("a")
    assert not floor.inventory.tray_is_loaded(1)
    floor.lay_in_tray(task, 1)
    assert [floor.inventory.in_tray(task, car) for car in (0, 1)] == [False, True]
    assert floor.inventory.tray_is_loaded(1)


def test_a_parcel_that_has_left_is_nowhere() -> None:
    """A car was towed with the parcel of a task that had failed, while an arm was still on its way home from it."""
    floor = Floor(orders=[delivery("a")])
    task = floor.carried("a", car=1)
    floor.lay_in_tray(task, 1)
    floor.board.move(task, TaskState.FAILED, 1.0, "by hand")
    floor.inventory.empty_tray(1)
    assert not floor.inventory.in_world(task)
    assert not floor.inventory.in_tray(task, 1)
    assert not floor.inventory.on_slot(task, 0, floor.stations.named("pick_1"))


@pytest.mark.parametrize(
    ("at", "inside"), [(0, True), (1, False), (2, False)], ids=["on the floor", "beside", "in the air over it"]
)
def test_a_parcel_beside_or_over_a_tray_is_not_in_it(at: int, inside: bool) -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.shelved("a")
    floor.lay_in_tray(task, 0)
    x, y, yaw = floor.car_poses()[0]
    if at == 1:
        floor.world.poses[0][0] = x + np.cos(yaw) * (CAR.tray_x_m + CAR.tray_size_m[0] / 2 + 0.01)
        floor.world.poses[0][1] = y + np.sin(yaw) * (CAR.tray_x_m + CAR.tray_size_m[0] / 2 + 0.01)
    elif at == 2:
        floor.world.poses[0][2] += CAR.tray_size_m[2] + 0.11
    assert floor.inventory.in_tray(task, 0) is inside


def test_a_delivered_parcel_is_collected_when_its_time_has_come() -> None:
    floor = delivered(now_s=10.0)
    floor.inventory.collect(14.9)
    assert floor.task("a").state is TaskState.DELIVERED
    floor.inventory.collect(15.0)
    assert floor.task("a").state is TaskState.COLLECTED
    assert floor.stations.named("drop_1").n_free == 4
    assert (floor.inventory.n_left, floor.inventory.balance()) == (1, 0)
    floor.inventory.collect(100.0)  # nothing more to do
    assert floor.inventory.n_left == 1


def test_a_slot_whose_parcel_has_failed_is_not_collected() -> None:
    floor = delivered(now_s=10.0)
    floor.board.move(floor.task("a"), TaskState.FAILED, 11.0, "by hand")
    floor.inventory.collect(15.0)
    assert floor.inventory.n_left == 0


def test_a_cancelled_task_takes_its_parcel_out_of_the_warehouse() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b")])
    floor.inventory.withdraw(floor.shelved("a"), TaskState.CANCELLED, 1.0, "by hand")
    floor.inventory.withdraw(floor.task("b"), TaskState.CANCELLED, 1.0, "by hand")
    assert [task.state for task in floor.board.tasks] == [TaskState.CANCELLED] * 2
    assert floor.stations[0].n_free == 4
    assert (floor.inventory.n_entered, floor.inventory.n_left, floor.inventory.balance()) == (1, 1, 0)


def test_a_slot_that_is_left_is_free_even_if_the_next_leg_begins_there() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b", after=("a",), same_car_as="a")])
    floor.inventory.vacate(floor.shelved("a"))
    floor.inventory.vacate(floor.task("b"))  # has none
    assert (floor.stations[0].n_free, floor.task("b").pick_slot) == (4, None)


def test_the_books_are_right_in_every_state() -> None:
    floor = delivered()
    assert floor.inventory.misplaced() == []
    other = Floor(orders=[delivery("a"), delivery("b"), delivery("c", release_s=9.0)])
    other.carried("a", car=0)
    assert other.inventory.misplaced() == []
    other.ready("b")
    assert other.inventory.misplaced() == []


def test_a_parcel_that_is_not_where_the_books_say_is_told() -> None:
    orders = [delivery("a"), delivery("b"), delivery("c"), delivery("d", "pick_2"), delivery("e")]
    floor = Floor(orders=orders)
    for name in ("a", "b", "d"):
        floor.shelved(name)
    floor.ready("e")  # has no slot
    floor.lay_on_floor(floor.task("a"))
    floor.world.remove_parcel(1)
    floor.world.poses[2] = floor.world.poses[4] = floor.world.poses[0].copy()
    floor.lay_on_floor(floor.task("d"))
    floor.world.in_grip[1] = 3  # was fetched ahead
    assert floor.inventory.misplaced() == [
        "a: booked as ready, lies at (6.00, 3.00, 0.02)",
        "b: booked as ready, not in the world",
        "c: booked as backlog, in the world",
        "e: booked as ready, in the world",
    ]


def test_nothing_is_said_of_parcels_that_failed_or_that_an_arm_moves() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b")])
    for name, state in (("a", TaskState.LOADING), ("b", TaskState.FAILED)):
        floor.board.move(floor.assigned(name, car=0), state, 0.0, "by hand")
        floor.lay_on_floor(floor.task(name))
        floor.missions.leave(0)
    assert floor.inventory.misplaced() == []
