"""Containment: what nobody will be able to do any more ends at once, and everything else goes on."""

from __future__ import annotations

import pytest

from fleet.missions.phases import CarPhase
from fleet.tasks.board import TaskState
from tests.unit.fleet.missions.floor import Floor, delivery, visit


def dock_cell(floor: Floor, name: str) -> int:
    return floor.stations.named(name).place.dock.cell


def wreck_in(floor: Floor, car: int, cell: int) -> None:
    """A car lies dead in a cell."""
    floor.interventions.retire(car, CarPhase.DEAD, 0.0, "by hand")
    floor.traffic.set_dead(car, [cell])


def test_as_long_as_nothing_is_lost_nothing_ends() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.ready("a")
    floor.containment.tick(1.0)
    assert floor.task("a").state is TaskState.READY


def test_a_delivery_to_a_dock_with_a_wreck_fails_and_its_parcel_leaves() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.ready("a")
    wreck_in(floor, 0, dock_cell(floor, task.delivery.drop))
    floor.containment.tick(1.0)
    assert (task.state, task.car) == (TaskState.FAILED, None)
    assert (
        task.reason == f"no way leads from {task.pick} to {task.delivery.drop} any more: car_0 stands dead in the way"
    )
    assert len(floor.world.poses) == 0
    assert floor.inventory.balance() == 0


@pytest.mark.parametrize(("for_good", "state"), [(True, TaskState.FAILED), (False, TaskState.READY)])
def test_nothing_waits_for_a_car_that_leaves_when_it_has_delivered(for_good: bool, state: TaskState) -> None:
    floor = Floor(orders=[delivery("a"), delivery("b")])
    carried = floor.carried("a", car=0)
    floor.ready("b")
    for car in range(floor.missions.n_cars):
        floor.interventions.take_out(car, 0.0, for_good=for_good)
    floor.containment.tick(1.0)
    assert (carried.state, floor.task("b").state) == (TaskState.CARRIED, state)


def test_another_delivery_is_done_all_the_same() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b", drop="drop_2")])
    for name in ("a", "b"):
        floor.ready(name)
    wreck_in(floor, 0, dock_cell(floor, "drop_2"))
    floor.containment.tick(1.0)
    assert [floor.task(name).state for name in ("a", "b")] == [TaskState.READY, TaskState.FAILED]


def test_a_lane_that_is_blocked_for_now_is_no_reason() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.ready("a")
    floor.traffic.set_blocked(dock_cell(floor, task.delivery.drop), blocked=True)
    floor.containment.tick(1.0)
    assert task.state is TaskState.READY


def test_a_lane_that_is_blocked_for_good_is() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.ready("a")
    floor.traffic.set_blocked(dock_cell(floor, task.delivery.drop), blocked=True, for_good=True)
    floor.containment.tick(1.0)
    assert task.state is TaskState.FAILED


def test_where_no_car_is_left_nothing_waits() -> None:
    floor = Floor(orders=[delivery("a"), visit("v", "parking_4")])
    for name in ("a", "v"):
        floor.ready(name)
    for car in range(floor.n_cars):
        floor.interventions.retire(car, CarPhase.DEAD, 0.0, "by hand")
    floor.containment.tick(1.0)
    for name in ("a", "v"):
        assert (floor.task(name).state, floor.task(name).reason) == (TaskState.FAILED, "no car is left")


def test_a_car_that_will_be_back_is_waited_for() -> None:
    floor = Floor(orders=[delivery("a")], n_cars=1)
    floor.interventions.take_out(0, 0.0, for_good=False)
    task = floor.ready("a")
    floor.containment.tick(1.0)
    assert task.state is TaskState.READY
    floor.interventions.bring_back(0)
    floor.interventions.take_out(0, 2.0, for_good=True)
    floor.containment.tick(3.0)
    assert (task.state, task.reason) == (TaskState.FAILED, "no car is left")


def test_a_car_that_is_being_brought_back_may_come_back_anywhere() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.ready("a")
    floor.interventions.retire(1, CarPhase.RECOVERING, 0.0, "by hand")
    tail = int(floor.graph.state_cell[floor.ways.tails[1]])
    wreck_in(floor, 0, tail)
    floor.containment.tick(1.0)
    assert task.state is TaskState.READY


def test_a_visit_to_a_place_that_is_lost_fails() -> None:
    floor = Floor(orders=[visit("v", "parking_4")])
    task = floor.ready("v")
    floor.traffic.set_blocked(floor.places.cells[floor.places.named("parking_4").number], blocked=True, for_good=True)
    floor.containment.tick(1.0)
    assert task.state is TaskState.FAILED
    assert task.reason.startswith("no car that is left can come to parking_4 any more")
