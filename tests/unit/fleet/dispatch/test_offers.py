"""Offers: ready tasks that there is room for at their stations."""

from __future__ import annotations

from fleet.tasks.order import Priority
from tests.unit.fleet.missions.floor import Floor, delivery, visit


def offered(floor: Floor, *, sequences: bool = False) -> tuple[list[str], set[str]]:
    """Names of the tasks that are offered, and of those without room."""
    tasks = floor.board.in_state("ready")  # type: ignore[arg-type]
    costs = floor.cost_model.of(tasks, floor.situation(), 0.0, 0.0)
    columns, full = floor.offers.of(costs, len(tasks), sequences=sequences)
    return [tasks[k].order.name for k in columns], {tasks[k].order.name for k in full}


def slow(floor: Floor) -> None:
    """All arms take 30 s: two transfers keep them busy for 60 s, and caps of 2 let 3 be given out."""
    for station in floor.stations:
        floor.stations.time(station).add(30.0)


def ready(*orders: object, n_cars: int = 2) -> Floor:
    floor = Floor(orders=orders, n_cars=n_cars)  # type: ignore[arg-type]
    for order in orders:
        floor.ready(order.name)  # type: ignore[attr-defined]
    return floor


def test_as_many_are_offered_as_keep_an_arm_busy_for_a_minute() -> None:
    """60 s / 7 s is nearly 9."""
    drops = [delivery(f"o{k}", f"pick_{1 + k % 2}", "drop_1") for k in range(8)]
    assert len(offered(ready(*drops))[0]) == 8
    assert Floor(n_cars=2).offers._room() == [9, 9, 9, 9]


def test_a_slow_station_takes_one_more_than_may_be_near() -> None:
    floor = ready(*(delivery(f"o{k}", "pick_1") for k in range(4)))
    slow(floor)
    assert floor.offers._room() == [3, 3, 3, 3]
    assert offered(floor) == (["o0", "o1", "o2"], {"o3"})


def test_who_plans_ahead_gets_all_of_a_station_that_has_room() -> None:
    floor = ready(*(delivery(f"o{k}", "pick_1") for k in range(4)))
    slow(floor)
    assert offered(floor, sequences=True) == (["o0", "o1", "o2", "o3"], set())


def test_cars_that_are_under_way_take_room_at_both_ends() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b"), delivery("c", "pick_2", "drop_1")], n_cars=3)
    slow(floor)
    floor.assigned("a", car=0)
    floor.carried("b", car=1)
    # One is bound for pick_1; both will come to drop_1.
    assert floor.offers._room() == [2, 3, 1, 3]
    floor.ready("c")
    assert offered(floor) == (["c"], set())
    assert floor.missions.under_way().tolist() == [0, 1, -1]


def test_the_most_urgent_class_comes_first_and_then_what_presses_most() -> None:
    floor = Floor(
        orders=[delivery("a"), delivery("b", due_s=5.0), delivery("c", priority=Priority.EMERGENCY), delivery("d")]
    )
    for name in "abcd":
        floor.ready(name)
    assert offered(floor)[0] == ["c", "b", "a", "d"]


def test_what_no_car_can_take_is_not_offered_and_takes_no_room() -> None:
    floor = ready(delivery("a", needs=("cold",)), delivery("b"))
    assert offered(floor) == (["b"], set())


def test_visits_are_offered_while_their_places_have_room() -> None:
    floor = ready(visit("u", "charger_1"), visit("v", "charger_1"), visit("w", "charger_1", needs=("cold",)))
    assert offered(floor) == (["u"], {"v"})
