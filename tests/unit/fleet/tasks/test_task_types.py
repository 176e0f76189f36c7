"""What the types of orders become, and what each refuses in one line."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from fleet.tasks import TASK_TYPES
from fleet.tasks.order import Ability, Delivery, Order, Visit
from fleet.tasks.order_file import OrderBook, read_orders
from fleet.tasks.place_names import PlaceNames
from maps.site import Site

CARS = [
    Ability(max_payload_kg=2.0, capabilities=frozenset({"car_0"})),
    Ability(max_payload_kg=0.4, capabilities=frozenset({"car_1", "camera"})),
]
Read = Callable[..., OrderBook]


@pytest.fixture
def read(small_site: Site, tmp_path: Path) -> Read:
    """Read objects as a JSON file; `id` and `release_s` are filled in."""

    def read_items(*items: dict[str, object], n_chargers: int = 2) -> OrderBook:
        path = tmp_path / "orders.json"
        rows = [{"id": f"o{k}", "release_s": 0} | item for k, item in enumerate(items)]
        path.write_text(json.dumps([{"id": "good", "release_s": 0, "type": "park"}, *rows]), encoding="utf-8")
        return read_orders(path, small_site, CARS, n_chargers=n_chargers)

    return read_items


def made(book: OrderBook) -> list[Order]:
    assert book.refused == ()
    return [order for order in book.orders if order.name != "good"]


LEGS = {"type": "multi_stop", "stops": ["pick_1>drop_2", "pick_2>drop_1"], "mass_kg": [0.3, 0.5], "size_m": 0.06}
ERRANDS = [
    ({"type": "move", "places": "parking_3"}, (("parking_3",),), 0.0),
    ({"type": "move", "places": "6,1", "stand_s": 10}, (("6,1",),), 10.0),
    (
        {"type": "patrol", "places": ["pick_1", "6, 1", "pick_1"], "stand_s": 2},
        (("pick_1",), ("6,1",), ("pick_1",)),
        2.0,
    ),
    ({"type": "inspect", "places": ["drop_1"], "needs": "camera"}, (("drop_1",),), 5.0),
    ({"type": "charge"}, (("charger_1", "charger_2"),), 0.0),
    ({"type": "charge", "places": "charger_2"}, (("charger_2",),), 0.0),
    ({"type": "park", "places": ["parking_2", "parking_18"], "stand_s": 600}, (("parking_2", "parking_18"),), 600.0),
]


@pytest.mark.parametrize(("item", "errands", "stand_s"), ERRANDS, ids=lambda value: str(value)[:40])
def test_visits(read: Read, item: dict[str, object], errands: tuple[tuple[str, ...], ...], stand_s: float) -> None:
    (visit,) = made(read(item))
    assert isinstance(visit, Visit)
    assert (visit.kind, visit.errands, visit.stand_s) == (item["type"], errands, stand_s)
    assert (visit.until_full, visit.inspects) == (visit.kind == "charge", visit.kind == "inspect")


def test_every_type_is_tried_here() -> None:
    tried = {str(item["type"]) for item, *_ in ERRANDS}
    assert tried | {"delivery", "multi_stop", "pod"} == set(TASK_TYPES)


def test_a_place_has_one_name_however_it_is_written(small_site: Site, read: Read) -> None:
    names = PlaceNames(small_site)
    cols = small_site.grid.cols
    for name, cell in small_site.bays().items():
        (visit,) = made(read({"type": "move", "places": f"{cell // cols},{cell % cols}"}))
        assert isinstance(visit, Visit)
        assert visit.errands == ((name,),)
        assert names.cell(name) == cell


def test_legs_wait_for_each_other_and_for_a_car_that_can_carry_them_all(read: Read) -> None:
    first, second = made(read(LEGS | {"due_s": 90, "needs": ["car_0"]}))
    assert isinstance(first, Delivery)
    assert isinstance(second, Delivery)
    assert [(leg.name, leg.pick, leg.drop, leg.mass_kg) for leg in (first, second)] == [
        ("o0_1", "pick_1", "drop_2", 0.3),
        ("o0_2", "pick_2", "drop_1", 0.5),
    ]
    assert (first.after, first.same_car_as) == ((), "")
    assert (second.after, second.same_car_as) == (("o0_1",), "o0_1")
    assert [leg.payload_kg for leg in (first, second)] == [0.5, 0.5]
    assert [car.fits(first) for car in CARS] == [True, False]
    assert (second.due_s, second.needs) == (90.0, ("car_0",))


def test_rounds_are_orders_of_their_own(read: Read) -> None:
    orders = made(
        read(
            {"id": "night", "type": "patrol", "places": ["pick_1", "drop_1"], "every_s": 60, "times": 3, "due_s": 50},
            {"id": "last", "type": "park", "after": "night"},
        )
    )
    rounds = [order for order in orders if order.name != "last"]
    assert [(order.name, order.release_s, order.due_s) for order in rounds] == [
        ("night_1", 0.0, 50.0),
        ("night_2", 60.0, 110.0),
        ("night_3", 120.0, 170.0),
    ]
    (last,) = set(orders) - set(rounds)
    assert last.after == ("night_1", "night_2", "night_3")


def test_what_waits_for_an_order_of_several_legs_waits_for_all(read: Read) -> None:
    *_, last = made(read(LEGS | {"id": "tour"}, {"id": "last", "release_s": 1, "type": "park", "after": ["tour"]}))
    assert last.after == ("tour_1", "tour_2")


def test_batches(read: Read) -> None:
    book = read(LEGS | {"batch": "b"}, {"type": "park", "batch": "b"}, {"type": "park", "batch": "b", "release_s": 5})
    assert [order.name for order in book.orders if order.batch == "b"] == ["o0_1", "o0_2", "o1"]
    (refusal,) = book.refused
    assert refusal.cause == "release_s is '5'; valid: 0, as the others of batch 'b'"


BAD: list[tuple[dict[str, object], str]] = [
    ({"type": "fly"}, "type is 'fly'; valid: delivery, multi_stop, move, patrol, inspect, charge, park"),
    ({"type": "move"}, "places is missing; valid: a move has places"),
    ({"type": "move", "places": ["pick_1", "drop_1"]}, "places is 'pick_1;drop_1'; valid: one place"),
    (
        {"type": "move", "places": "parking_19"},
        "places is 'parking_19'; valid: pick_1, pick_2, drop_1, drop_2, parking_1 to parking_18, "
        "charger_1 to charger_2, or row,col of a cell with a lane",
    ),
    ({"type": "move", "places": "0,0"}, "places is '0,0'; valid: pick_1"),
    ({"type": "move", "places": "99,1"}, "places is '99,1'; valid: pick_1"),
    ({"type": "move", "places": "-1,1"}, "places is '-1,1'; valid: pick_1"),
    (
        {"type": "move", "places": "pick_1", "drop": "drop_1"},
        "drop is 'drop_1'; valid: nothing, a move has places, stand_s",
    ),
    (
        {"type": "inspect", "places": "6,1", "stand_s": 11},
        "stand_s is '11'; valid: at most 10, because 6,1 is in a lane",
    ),
    ({"type": "inspect", "places": "pick_1", "stand_s": 3601}, "stand_s is '3601'; valid: a number from 0 to 3600"),
    ({"type": "patrol", "places": "pick_1"}, "places is 'pick_1'; valid: two places or more"),
    ({"type": "patrol", "places": ["pick_1", "pick_1"]}, "places is 'pick_1;pick_1'; valid: another place than pick_1"),
    ({"type": "charge", "places": "parking_1"}, "places is 'parking_1'; valid: charger_1, charger_2, or none"),
    ({"type": "park", "places": "charger_1"}, "places is 'charger_1'; valid: parking_1 to parking_18, or none"),
    (
        {"type": "park", "needs": "wings"},
        "needs is 'wings'; valid: what one car has and carries (camera, car_0, car_1)",
    ),
    ({"type": "park", "every_s": 60}, "times is ''; valid: a number from 2 to 1000"),
    ({"type": "park", "times": 2}, "every_s is ''; valid: a number from 1"),
    ({"type": "park", "every_s": 60, "times": 2.5}, "times is '2.5'; valid: a whole number"),
    ({"type": "park", "every_s": 60, "times": 2, "batch": "b"}, "batch is 'b'; valid: none for an order that recurs"),
    ({"id": "good", "type": "park"}, "id 'good' stands twice; valid: each id once"),
    (LEGS | {"stops": ["pick_1>drop_2"]}, "stops is 'pick_1>drop_2'; valid: 2 to 50 legs, as in pick_1>drop_1;"),
    (LEGS | {"stops": "pick_1>drop_2;drop_1"}, "stops is 'drop_1'; valid: PICK>DROP with pick_1, pick_2 and drop_1"),
    (LEGS | {"mass_kg": [0.1, 0.2, 0.3]}, "mass_kg is '0.1;0.2;0.3'; valid: one for all legs, or 2"),
    (LEGS | {"mass_kg": [0.3, 0.5], "needs": "camera"}, "needs is 'camera'; valid: what one car has and carries"),
    ({"pick": "pick_1"}, "drop is missing; valid: a delivery has pick, drop, mass_kg, size_m"),
]


@pytest.mark.parametrize(("item", "expected"), BAD, ids=[expected[:40] for _, expected in BAD])
def test_what_cannot_be_is_refused_and_the_rest_goes_on(read: Read, item: dict[str, object], expected: str) -> None:
    book = read(item)
    assert [order.name for order in book.orders] == ["good"]
    (refusal,) = book.refused
    assert refusal.where.endswith("orders.json, order 2")
    assert refusal.cause.startswith(expected)
    assert "\n" not in str(refusal)


def test_nobody_charges_without_batteries(read: Read) -> None:
    (refusal,) = read({"type": "charge"}, n_chargers=0).refused
    assert refusal.cause == "type is 'charge'; valid: any other, because this run has no batteries (--battery)"


def test_a_number_that_is_another_order_s_name(read: Read) -> None:
    book = read({"id": "a", "type": "park", "every_s": 1, "times": 2}, {"id": "a_2", "type": "park"})
    (refusal,) = book.refused
    assert refusal.cause == "id 'a_2' stands twice, and that of 'a' has this number; valid: each id once"


def test_a_circle_through_a_recurring_order_is_found(read: Read) -> None:
    book = read(
        {"id": "a", "type": "park", "every_s": 1, "times": 2, "after": "b"}, {"id": "b", "type": "park", "after": "a"}
    )
    assert [order.name for order in book.orders] == ["good"]
    assert sorted(refusal.name for refusal in book.refused) == ["a", "b"]


@pytest.mark.parametrize("kind", ["csv", "json"])
def test_the_example_of_the_documentation_is_accepted(repository: Path, small_site: Site, kind: str) -> None:
    book = read_orders(repository / "docs" / "examples" / f"shift.{kind}", small_site, CARS)
    assert book.refused == ()
    names = [order.name for order in book.orders]
    assert sorted(names) == sorted(["bread", "cake", "tour_1", "tour_2", "night_1", "night_2", "leak", "clear", "home"])
    assert {order.due_s for order in book.orders if order.name not in ("cake", "leak")} == {math.inf}
