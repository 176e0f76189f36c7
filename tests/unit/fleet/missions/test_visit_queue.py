"""VisitQueue and VisitRoutes: visits without a car, and what is left of them as moves and time."""

from __future__ import annotations

from fleet.tasks.board import TaskState
from fleet.tasks.reasons import TaskReason
from planners.mapf.distance_table import UNREACHABLE
from tests.unit.fleet.missions.floor import Floor, delivery, visit

CHARGER_1, CHARGER_2, PARKING_4 = 4, 5, 9


def test_visits_that_are_ready_are_told_in_the_order_in_which_their_turn_came() -> None:
    floor = Floor(orders=[visit("v", "parking_4"), visit("w", "parking_5"), delivery("a"), visit("x", "parking_5")])
    for name in "wav":
        floor.ready(name)
    assert [task.order.name for task in floor.visit_queue.ready()] == ["w", "v"]
    floor.board.move(floor.task("w"), TaskState.ASSIGNED, 1.0, "by hand")
    assert [task.order.name for task in floor.visit_queue.ready()] == ["v"]
    floor.board.move(floor.task("w"), TaskState.READY, 2.0, "by hand")
    assert [task.order.name for task in floor.visit_queue.ready()] == ["v", "w"]


def test_chargers_are_left_to_visits_that_found_no_room() -> None:
    floor = Floor(orders=[visit(name, ("charger_1", "charger_2")) for name in "uvw"])
    for name in "uvw":
        floor.ready(name)
    assert floor.visit_queue.chargers_wanted() == set()
    floor.reasons.note(floor.task("u"), TaskReason.STATION_FULL, "full", 0.0)
    assert floor.visit_queue.chargers_wanted() == {CHARGER_1}
    for name in "vw":
        floor.reasons.note(floor.task(name), TaskReason.STATION_FULL, "full", 0.0)
    assert floor.visit_queue.chargers_wanted() == {CHARGER_1, CHARGER_2}


def test_blocked_chargers_are_not_kept_and_those_that_somebody_waits_for_are() -> None:
    floor = Floor(orders=[visit("v", ("charger_1", "charger_2"))], n_cars=2)
    floor.reasons.note(floor.ready("v"), TaskReason.STATION_FULL, "full", 0.0)
    floor.block(floor.places.cells[CHARGER_1])
    assert floor.visit_queue.chargers_wanted() == {CHARGER_2}
    floor.reasons.forget(floor.task("v"))
    floor.missions.bind(0, CHARGER_2)
    assert floor.visit_queue.chargers_wanted() == {CHARGER_2}


def test_without_visits_no_charger_is_wanted() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.reasons.note(floor.ready("a"), TaskReason.STATION_FULL, "full", 0.0)
    assert floor.visit_queue.chargers_wanted() == set()


def test_the_rest_of_a_visit_is_its_moves_between_errands_and_its_stands() -> None:
    """From the first parking place it is 11 moves to the second, and from there 8 to the third."""
    floor = Floor(orders=[visit("v", "parking_1", "parking_2", "parking_3", stand_s=4.0)])
    task = floor.ready("v")
    assert floor.routes.rest(task) == (19.0, 12.0)
    task.n_errands_done = 1
    assert floor.routes.rest(task) == (8.0, 8.0)


def test_a_visit_without_a_way_on_never_ends() -> None:
    floor = Floor(orders=[visit("v", "parking_1", "parking_2", "parking_3")])
    floor.block(floor.places.cells[PARKING_4 - 2])
    assert floor.routes.rest(floor.ready("v"))[0] == UNREACHABLE


def test_of_the_next_errand_only_places_with_room_count_if_any_has() -> None:
    floor = Floor(orders=[visit("v", ("charger_1", "charger_2"))])
    task = floor.ready("v")
    one, two = map(floor.places.named, ("charger_1", "charger_2"))
    assert floor.routes.errands(task) == [(one, two)]
    floor.missions.bind(0, CHARGER_1)
    floor.bookings.book(0)
    assert floor.routes.errands(task) == [(two,)]
    assert floor.routes.to_errand(task, floor.ways.tails).tolist() == [11.0, 6.0]  # charger_1 would be 8 and 3
    floor.missions.bind(1, CHARGER_2)
    floor.bookings.book(1)
    assert floor.routes.errands(task) == [(one, two)]
    task.place = "charger_1"  # its own car has room there
    assert floor.routes.errands(task) == [(one,)]


def test_room_is_counted_down_and_a_lane_always_has_some() -> None:
    floor = Floor(orders=[visit("v", ("charger_1", "charger_2")), visit("w", "2,5")])
    task, lane = floor.ready("v"), floor.ready("w")
    rooms: dict[int, int] = {}
    assert [floor.routes.take_room(task, rooms) for _ in range(3)] == [True, True, False]
    assert rooms == {CHARGER_1: 0, CHARGER_2: 0}
    assert [floor.routes.take_room(lane, rooms) for _ in range(3)] == [True] * 3
    assert floor.routes.room(floor.places.named("2,5")) == 1


def test_a_delivery_does_not_stand() -> None:
    floor = Floor(orders=[delivery("a")])
    assert floor.routes.stands_s(floor.ready("a")) == []
