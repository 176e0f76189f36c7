"""Aboard: a car with room for several parcels takes more of a station, and brings them away one after the other."""

from __future__ import annotations

import pytest

from fleet.missions.phases import CarPhase
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Ability
from tests.unit.fleet.missions.floor import Floor, delivery

PICK, DROP = 0, 2
"""Arms of pick_1 and drop_1."""


def loaded(
    *orders: object, n_places: int = 3, planned: tuple[int, str] | None = None, **own: object
) -> tuple[Floor, Task]:
    """Car 0 stands at pick_1 with the parcel of `a` in its tray, and other orders are known.

    Of these one may be planned for a car that goes for another one before: `a`, or `z` if it is not car 0.
    """
    floor = Floor(orders=[delivery("a"), *orders], n_tray_places=n_places, **own)  # type: ignore[arg-type]
    task = floor.assigned("a", car=0)
    for order in orders:
        if order.name != "z":  # type: ignore[attr-defined]
            floor.ready(order.name)  # type: ignore[attr-defined]
    if planned is not None:
        car, name = planned
        first = task if car == 0 else floor.assigned("z", car=car)
        floor.loads.plan(car, [first, floor.task(name)])
    floor.arrive(0)
    floor.docks.tick(0, 0.0)
    floor.lay_in_tray(task, 0)
    floor.arms.leave_car(PICK)
    floor.docks.tick(1, 5.0)
    return floor, task


def test_a_car_takes_another_parcel_of_the_station_before_it_leaves() -> None:
    floor, first = loaded(delivery("b"))
    second = floor.task("b")
    assert floor.missions.aboard[0] == [first]
    assert (floor.missions.task_of[0], second.state, second.car) == (second, TaskState.ASSIGNED, 0)
    assert floor.missions.phase[0] is CarPhase.TO_PICK
    assert floor.missions.load_kg[0] == 0.5
    floor.arms.come_home(PICK)
    floor.docks.tick(2, 6.0)
    floor.docks.tick(3, 7.0)
    assert second.state is TaskState.LOADING
    floor.lay_in_tray(second, 0)
    floor.arms.leave_car(PICK)
    floor.docks.tick(4, 9.0)
    assert floor.missions.phase[0] is CarPhase.TO_DROP
    assert floor.missions.load_kg[0] == 1.0
    assert floor.missions.faults() == []


def test_what_goes_to_the_same_station_is_unloaded_at_one_stop_and_the_car_is_free_then() -> None:
    floor, first = loaded(delivery("b"))
    floor.arms.come_home(PICK)
    floor.docks.tick(2, 6.0)
    floor.docks.tick(3, 7.0)
    second = floor.task("b")
    floor.lay_in_tray(second, 0)
    floor.arms.leave_car(PICK)
    floor.docks.tick(4, 9.0)
    floor.arms.come_home(PICK)
    floor.docks.tick(5, 9.5)
    floor.arrive(0)
    for tick, slot in ((10, 0), (20, 1)):
        task = floor.missions.task_of[0]
        assert task is not None
        floor.docks.tick(tick, float(tick))
        assert (task.state, task.drop_slot) == (TaskState.UNLOADING, slot)
        floor.lay_on_slot(task, slot, "drop_1")
        floor.arms.come_home(DROP)
        floor.docks.tick(tick + 1, tick + 1.0)
        assert task.state is TaskState.DELIVERED
    assert {first.state, second.state} == {TaskState.DELIVERED}
    assert floor.missions.phase[0] is CarPhase.IDLE
    assert floor.missions.aboard[0] == []


@pytest.mark.parametrize(
    ("order", "own"),
    [
        (delivery("b"), {"n_places": 1}),
        (delivery("b", mass_kg=1.8), {}),
        (delivery("b", pick="pick_2"), {}),
        (delivery("b", needs=("cold",)), {}),
    ],
    ids=["no place", "too heavy together", "another station", "needs"],
)
def test_what_does_not_fit_is_left(order: object, own: dict[str, object]) -> None:
    floor, first = loaded(order, **own)  # type: ignore[arg-type]
    assert floor.missions.task_of[0] is first
    assert floor.missions.phase[0] is CarPhase.TO_DROP
    assert floor.task("b").state is TaskState.READY


def test_a_car_whose_next_parcel_is_taken_from_it_brings_away_what_it_has() -> None:
    floor, first = loaded(delivery("b"))
    second = floor.task("b")
    floor.interventions.requeue(second, 6.0, "by hand")
    assert floor.missions.phase[0] is CarPhase.IDLE
    floor.docks.tick(6, 6.0)
    assert (floor.missions.task_of[0], floor.missions.phase[0]) == (first, CarPhase.TO_DROP)
    assert floor.missions.aboard[0] == []


def test_what_is_aboard_of_a_dead_car_is_given_up() -> None:
    floor, first = loaded(delivery("b"), abilities=[Ability(max_payload_kg=2.0)] * 3)
    floor.interventions.retire(0, CarPhase.DEAD, 6.0, "by hand")
    floor.docks.tick(6, 6.0)
    assert (first.state, first.reason) == (TaskState.FAILED, "parcel stranded: car_0 is dead")
    assert floor.task("b").state is TaskState.READY
    assert floor.missions.aboard[0] == []


def test_what_is_planned_for_a_car_goes_before_what_is_more_urgent() -> None:
    floor, first = loaded(delivery("b"), delivery("c"), planned=(0, "c"), n_places=2)
    assert floor.missions.aboard[0] == [first]
    assert floor.missions.task_of[0] is floor.task("c")
    assert floor.task("b").state is TaskState.READY


def test_what_is_planned_for_another_car_is_left_to_it() -> None:
    floor, first = loaded(delivery("b"), delivery("z", pick="pick_2"), planned=(1, "b"))
    assert floor.loads.spoken_for(()) == {floor.task("b").index}
    assert floor.loads.spoken_for((1,)) == set()
    assert floor.missions.task_of[0] is first
    assert floor.missions.phase[0] is CarPhase.TO_DROP
    floor.missions.unassign(floor.task("z"), 6.0, "by hand")
    assert floor.loads.spoken_for(()) == set()
