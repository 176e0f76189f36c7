"""Offers: the most urgent tasks of each station, as many as cars could take, and when their turns would begin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from fleet.config import AllocationConfig
from fleet.dispatch.offers import N_SPARE, Offer
from fleet.tasks.order import Ability, Priority
from tests.unit.fleet.missions.floor import Floor, delivery, visit


def ready(*orders: Any, n_cars: int = 2, **own: Any) -> Floor:
    floor = Floor(orders=orders, n_cars=n_cars, **own)
    for order in orders:
        floor.ready(order.name)
    return floor


def offer(floor: Floor, cars: list[int] | None = None) -> Offer:
    """What is offered to some cars, all by default, from where they are."""
    asked = np.array(range(floor.missions.n_cars) if cars is None else cars, dtype=np.intp)
    return floor.offers.of(asked, 0, floor.ways.tails[asked], floor.turns.all(0.0).turns)


def names(offered: Offer) -> list[str]:
    return [task.order.name for task in offered.tasks]


def many(n: int = 9, **own: Any) -> list[Any]:
    return [delivery(f"o{k}", **own) for k in range(n)]


def test_some_more_are_offered_than_there_are_cars() -> None:
    assert names(offer(ready(*many()), [0])) == ["o0", "o1", "o2", "o3"]
    assert N_SPARE == 3


@pytest.mark.parametrize(("n_cars", "took_s", "n_offered"), [(6, 7.0, 2), (6, 2.0, 4), (6, 30.0, 1), (3, 1.0, 3)])
def test_no_more_are_offered_than_the_arm_can_begin_before_the_last_car_comes(
    n_cars: int, took_s: float, n_offered: int
) -> None:
    """The furthest of six cars needs 16.5 s, and of three 13.2 s; an arm begins 3 s after it has ended."""
    floor = ready(*many(), n_cars=n_cars)
    floor.stations.time(floor.stations[0]).add(took_s)
    assert len(offer(floor).tasks) == n_offered + N_SPARE


def test_each_station_has_offers_of_its_own() -> None:
    floor = ready(*many(5), *(delivery(f"p{k}", "pick_2") for k in range(5)))
    assert names(offer(floor, [0])) == ["o0", "o1", "o2", "o3", "p0", "p1", "p2", "p3"]


def test_without_cars_little_is_looked_at() -> None:
    assert names(offer(ready(*many()), [])) == ["o0", "o1", "o2"]


@pytest.mark.parametrize(("n_held", "n_offered"), [(6, 1), (2, 5), (0, 6)])
def test_cars_that_have_one_are_offered_few(n_held: int, n_offered: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fleet.dispatch.offers.N_EXCHANGED", 1)
    floor = ready(*many(20), n_cars=6)
    floor.stations.time(floor.stations[0]).add(0.1)
    asked = np.arange(6, dtype=np.intp)
    offered = floor.offers.of(asked, n_held, floor.ways.tails[asked], floor.turns.all(0.0).turns)
    assert len(offered.tasks) == n_offered + N_SPARE


def test_what_is_kept_for_another_car_is_not_offered() -> None:
    floor, asked = ready(*many(3)), np.array([1], dtype=np.intp)
    kept = {floor.task("o1").index}
    offered = floor.offers.of(asked, 0, floor.ways.tails[asked], floor.turns.all(0.0).turns, kept)
    assert names(offered) == ["o0", "o2"]


def test_a_car_without_a_way_does_not_count() -> None:
    floor = ready(*many(), n_cars=1)
    floor.wall_in(0)
    assert len(offer(floor).tasks) == 1 + N_SPARE


def test_they_begin_in_turn_where_the_arm_is_free() -> None:
    """The arm serves car 0 from 5.5 s on, and before that there is no time for a whole turn."""
    floor = Floor(orders=[delivery("a"), *many(2), delivery("p", "pick_2"), visit("v", "2,5")])
    floor.assigned("a", car=0)
    for name in ("o0", "o1", "p", "v"):
        floor.ready(name)
    offered = offer(floor, [1])
    assert names(offered) == ["o0", "o1", "p", "v"]
    assert offered.not_before_s == pytest.approx([15.5, 25.5, 0.0, 0.0])


def test_what_no_car_can_take_keeps_nothing_back() -> None:
    floor = ready(*many(needs=("cold",)), delivery("b"), delivery("c"))
    offered = offer(floor)
    assert names(offered) == ["o0", "b", "c"]  # the most urgent of them, to say why it waits
    assert offered.not_before_s.tolist()[1:] == [0.0, 10.0]


def test_who_can_do_it_counts_among_the_cars_that_are_asked() -> None:
    abilities = [Ability(max_payload_kg=0.1), Ability(max_payload_kg=2.0)]
    floor = ready(*many(6), abilities=abilities)
    assert names(offer(floor, [0])) == ["o0"]
    assert len(offer(floor, [1]).tasks) > 1


def test_the_oldest_for_a_busy_drop_station_do_not_hide_the_others() -> None:
    """All fourteen cars stood before one arm, the other had nothing to do, and a third was delivered less."""
    orders = [delivery("a"), delivery("b"), *many(6), *(delivery(name, drop="drop_2") for name in "pq")]
    floor = Floor(orders=orders, n_cars=3)
    floor.assigned("a", car=0)
    floor.assigned("b", car=2)
    for order in (*many(6), delivery("p"), delivery("q")):
        floor.ready(order.name)
    hidden, seen = ["o0", "o1", "o2", "o3"], ["o0", "o1", "o2", "o3", "p", "q"]
    # The work for drop_1 is that of two cars, 20 s; the longest way of the other one is 11 s.
    for busy_s, offered in ((40.0, hidden), (9.1, hidden), (8.9, seen), (math.inf, hidden), (0.0, seen)):
        floor.offers.change(AllocationConfig(busy_s=busy_s))
        assert names(offer(floor, [1])) == offered


def test_what_is_due_first_is_begun_first() -> None:
    floor = ready(delivery("a"), delivery("b", due_s=500.0), delivery("c", due_s=300.0))
    offered = offer(floor)
    assert names(offered) == ["c", "b", "a"]
    assert offered.not_before_s.tolist() == [0.0, 10.0, 20.0]


def test_the_most_urgent_class_is_looked_at_first() -> None:
    floor = ready(*many(), delivery("b", priority=Priority.EMERGENCY))
    assert names(offer(floor, [0]))[0] == "b"


def test_of_several_sources_the_soonest_is_taken_and_the_task_is_offered_once() -> None:
    """a: 5.5 + 12.1 s from pick_1, 7.7 + 15.4 s from pick_2; b: 5.5 + 15.4 s and 7.7 + 12.1 s."""
    picks = ("pick_2", "pick_1")
    floor = ready(delivery("a", "pick_2", picks=picks), delivery("b", "pick_2", "drop_2", picks=picks))
    assert names(offer(floor)) == ["a", "b"]
    assert [task.pick for task in floor.board.tasks] == ["pick_1", "pick_2"]


def test_a_source_whose_arm_is_taken_comes_later() -> None:
    """Car 0 is at pick_1 from 5.5 s on: the next could begin at 15.5 s, and at pick_2 at 7.7 s."""
    floor = Floor(orders=[delivery("a"), delivery("b", picks=("pick_1", "pick_2"))])
    floor.assigned("a", car=0)
    floor.ready("b")
    offered = offer(floor, [1])
    assert [task.pick for task in offered.tasks] == ["pick_2"]
    assert offered.not_before_s.tolist() == [0.0]


def test_a_parcel_that_has_a_slot_is_taken_from_there() -> None:
    floor = Floor(orders=[delivery("a", "pick_2", picks=("pick_2", "pick_1"))])
    floor.shelved("a")
    assert [(task.pick, task.pick_slot) for task in offer(floor).tasks] == [("pick_2", 0)]


def given(floor: Floor) -> tuple[list[str], set[str]]:
    """Names of the tasks that can be given out, and of visits without room."""
    tasks = [task.order.name for task in floor.board.tasks]
    costs = floor.costs(*tasks)
    columns, full = floor.offers.with_room(costs, len(tasks))
    return [tasks[k] for k in columns], {tasks[k] for k in full}


def test_what_can_be_given_out_goes_by_class_and_then_by_what_presses_most() -> None:
    orders = [delivery("a"), delivery("b", due_s=5.0), delivery("c", priority=Priority.EMERGENCY), delivery("d")]
    assert given(ready(*orders)) == (["c", "b", "a", "d"], set())


def test_what_no_car_can_take_is_not_given_out() -> None:
    assert given(ready(delivery("a", needs=("cold",)), delivery("b"))) == (["b"], set())


def test_visits_are_given_out_while_their_places_have_room() -> None:
    floor = ready(visit("u", "charger_1"), visit("v", "charger_1"), visit("w", "charger_1", needs=("cold",)))
    assert given(floor) == (["u"], {"v"})
