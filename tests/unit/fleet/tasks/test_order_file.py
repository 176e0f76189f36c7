"""Orders from CSV and JSON files: one bad order is refused in one line, the rest goes on."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from fleet.tasks.order import Ability, Delivery, Priority
from fleet.tasks.order_file import OrderBook, OrdersError, read_orders
from fleet.tasks.precedence import broken
from maps.site import Site

HEADER = "id,release_s,pick,drop,mass_kg,size_m\n"
GOOD = "a,0,pick_1,drop_1,0.3,0.06\n"
CARS = [Ability(max_payload_kg=2.0), Ability(max_payload_kg=1.0, capabilities=frozenset({"cold", "fragile"}))]


Read = Callable[..., OrderBook]


@pytest.fixture
def read(small_site: Site, tmp_path: Path) -> Read:
    """Read text as a file of that kind."""

    def read_text(text: str, kind: str = "csv") -> OrderBook:
        path = tmp_path / f"orders.{kind}"
        path.write_text(text, encoding="utf-8")
        return read_orders(path, small_site, CARS)

    return read_text


def test_a_parcel_that_no_grip_holds_is_refused(small_site: Site, tmp_path: Path) -> None:
    path = tmp_path / "orders.csv"
    path.write_text(HEADER + GOOD + "b,0,pick_1,drop_1,0.9,0.06\n", encoding="utf-8")
    book = read_orders(path, small_site, CARS, grip_kg=0.68)
    assert [order.name for order in book.orders] == ["a"]
    (refusal,) = book.refused
    assert refusal.cause == "mass_kg is '0.9'; valid: at most 0.68, what the arms' grip holds"


def test_orders_are_read_in_the_order_of_their_release(read: Read) -> None:
    orders = read(
        HEADER
        + "late,12.5,pick_2,drop_1,0.25,0.06x0.05x0.08\n"
        + "first,0,pick_1,drop_2,2,0.1\n"
        + "\n"
        + ' second , 0 ,pick_1,drop_1,"0.05",0.04 \n'
    ).orders
    assert [order.name for order in orders] == ["first", "second", "late"]
    assert orders[0].size_m == (0.1, 0.1, 0.1)
    late = orders[2]
    assert (late.release_s, late.pick, late.drop, late.mass_kg) == (12.5, "pick_2", "drop_1", 0.25)
    assert late.size_m == (0.06, 0.05, 0.08)
    assert (late.due_s, late.priority, late.after, late.picks, late.needs) == (
        math.inf,
        Priority.NORMAL,
        (),
        ("pick_2",),
        (),
    )


def test_a_spreadsheet_s_file_is_read(small_site: Site, tmp_path: Path) -> None:
    """With a byte order mark and the line ends of another system."""
    path = tmp_path / "orders.csv"
    path.write_bytes(b"\xef\xbb\xbf" + (HEADER + "a,0,pick_1,drop_1,0.3,0.06\n").replace("\n", "\r\n").encode())
    assert [order.name for order in read_orders(path, small_site, CARS).orders] == ["a"]


def test_optional_columns_stand_in_any_order(read: Read) -> None:
    text = (
        "due_s,id,needs,priority,after,release_s,pick,picks,drop,mass_kg,size_m\n"
        "90,b,cold;fragile,emergency,a,5,pick_2,pick_1;pick_2,drop_1,0.5,0.06\n"
        ",a,,,,0,pick_1,,drop_1,0.5,0.06\n"
    )
    a, b = read(text).orders
    assert (a.name, a.due_s, a.priority) == ("a", math.inf, Priority.NORMAL)
    assert (b.due_s, b.priority, b.after, b.picks) == (90.0, Priority.EMERGENCY, ("a",), ("pick_2", "pick_1"))
    assert b.needs == ("cold", "fragile")


def test_json_says_the_same(read: Read) -> None:
    items = [
        {"id": "a", "release_s": 0, "pick": "pick_1", "drop": "drop_1", "mass_kg": 0.5, "size_m": [0.06, 0.05, 0.08]},
        {"id": "b", "release_s": 5, "pick": "pick_1", "drop": "drop_1", "mass_kg": 0.5, "size_m": 0.06}
        | {"due_s": 90.5, "priority": "idle", "after": ["a"], "picks": ["pick_2"], "needs": "cold"},
        {"id": "c"},
        7,
        {"id": "d", "colour": "red"},
        {"id": "e", "release_s": None},
    ]
    book = read(json.dumps(items), "json")
    a, b = book.orders
    assert a.size_m == (0.06, 0.05, 0.08)
    assert (b.due_s, b.priority, b.after, b.picks, b.needs) == (
        90.5,
        Priority.IDLE,
        ("a",),
        ("pick_1", "pick_2"),
        ("cold",),
    )
    said = [str(refusal).split("orders.json, ")[1] for refusal in book.refused]
    assert said[0].startswith("order 3: release_s is missing")
    assert said[1].startswith("order 4: is 7; valid: an object")
    assert said[2].startswith("order 5: colour is not a known entry")
    assert said[3].startswith("order 6: release_s is None; valid: text, a number")


BAD = [
    ("b,0,pick_1\n", "3 fields; valid: 6"),
    ("b,0,pick_9,drop_1,0.3,0.06\n", "pick is 'pick_9'; valid: pick_1, pick_2"),
    ("b,0,drop_1,drop_1,0.3,0.06\n", "pick is 'drop_1'; valid: pick_1, pick_2"),
    ("b,0,pick_1,drop_7,0.3,0.06\n", "drop is 'drop_7'; valid: drop_1, drop_2"),
    ("b,-1,pick_1,drop_1,0.3,0.06\n", "release_s is '-1'; valid: a number from 0"),
    ("b,soon,pick_1,drop_1,0.3,0.06\n", "release_s is 'soon'; valid: a number"),
    ("b,0,pick_1,drop_1,nan,0.06\n", "mass_kg is 'nan'; valid: a number from 0.05 to 3"),
    ("b,0,pick_1,drop_1,0.3,0.5\n", "size_m is '0.5'; valid: a number from 0.04 to 0.1"),
    ("b,0,pick_1,drop_1,0.3,0.06x0.06\n", "size_m is '0.06x0.06'; valid: one edge"),
    (GOOD, "id 'a' stands twice; valid: each id once"),
    (",0,pick_1,drop_1,0.3,0.06\n", "id is empty"),
]


@pytest.mark.parametrize(("line", "expected"), BAD)
def test_a_bad_line_is_refused_and_the_rest_goes_on(read: Read, line: str, expected: str) -> None:
    book = read(HEADER + GOOD + "\n" + line + "z,1,pick_1,drop_1,0.3,0.06\n")
    assert [order.name for order in book.orders] == ["a", "z"]
    (refusal,) = book.refused
    assert refusal.where.endswith("orders.csv, line 4")
    assert refusal.cause.startswith(expected)
    assert "\n" not in str(refusal)


MORE = "id,release_s,pick,drop,mass_kg,size_m,due_s,priority,after,picks,needs\n"


@pytest.mark.parametrize(
    ("rest", "expected"),
    [
        ("3,,,,", "due_s is '3'; valid: a number from 5 (release_s)"),
        ("later,,,,", "due_s is 'later'; valid: a number"),
        (",urgent,,,", "priority is 'urgent'; valid: emergency, normal, idle"),
        (",,nobody,,", "after is 'nobody'; valid: ids of other orders"),
        (",,b,,", "after is 'b', a circle of b; valid: no circle"),
        (",,,pick_1;pick_7,", "picks is 'pick_7'; valid: pick_1, pick_2"),
        (",,,,flying", "needs is 'flying'; valid: what one car has and carries (cold, fragile)"),
        (",,,,cold", "needs is 'cold'"),
    ],
)
def test_what_optional_columns_get_wrong(read: Read, rest: str, expected: str) -> None:
    """The order of 1.5 kg is too heavy for the only car that is cold."""
    book = read(MORE + f"b,5,pick_1,drop_1,1.5,0.06,{rest}\na,0,pick_1,drop_1,0.3,0.06,,,,,\n")
    assert [order.name for order in book.orders] == ["a"]
    assert [refusal.cause.startswith(expected) for refusal in book.refused] == [True], book.refused


def test_what_no_car_can_carry(small_site: Site, tmp_path: Path) -> None:
    path = tmp_path / "orders.csv"
    path.write_text(HEADER + GOOD + "b,0,pick_1,drop_1,1.5,0.06\n", encoding="utf-8")
    (refusal,) = read_orders(path, small_site, CARS[1:]).refused
    assert refusal.cause == "mass_kg is '1.5'; valid: at most 1, the greatest payload of a car"


def test_followers_of_refused_orders_are_refused_with_that_cause(read: Read) -> None:
    rows = ["a,0,pick_9,drop_1,0.3,0.06,,,,,", "b,0,pick_1,drop_1,0.3,0.06,,,a,,", "c,0,pick_1,drop_1,0.3,0.06,,,b;d,,"]
    book = read(MORE + "\n".join([*rows, "d,0,pick_1,drop_1,0.3,0.06,,,,,"]))
    assert [order.name for order in book.orders] == ["d"]
    assert [refusal.name for refusal in book.refused] == ["a", "b", "c"]
    assert book.refused[1].cause == "after is 'a', and 'a' was refused; valid: accepted orders"
    assert book.refused[2].cause == "after is 'b;d', and 'a' was refused; valid: accepted orders"


def test_circles_and_those_who_wait_for_them() -> None:
    why = broken({"a": ["c"], "b": ["a"], "c": ["b"], "d": ["c"], "e": [], "f": ["e"]})
    assert sorted(why) == ["a", "b", "c", "d"]
    assert all("circle of a, b, c" in why[name] for name in "abc")
    assert "was refused" in why["d"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [("{", "no JSON"), ("{}", "holds dict"), ("[]", "no orders"), (f"[{'9' * 5000}]", "no JSON")],
    ids=["cut off", "no list", "empty", "a number too long"],
)
def test_json_that_holds_no_orders(read: Read, text: str, expected: str) -> None:
    with pytest.raises(OrdersError, match=expected):
        read(text, "json")


@pytest.mark.parametrize("header", [HEADER.replace("id", "name"), HEADER.replace("id", "id,id"), "id,colour\n"])
def test_a_header_that_is_not_understood(read: Read, header: str) -> None:
    with pytest.raises(OrdersError, match="line 1: header is"):
        read(header + GOOD)


def test_every_column_of_a_delivery_is_read(read: Read) -> None:
    header = "id,release_s,pick,drop,mass_kg,size_m,due_s,priority,after,picks,needs,batch\n"
    line = "b,5.5,pick_2,drop_1,0.5,0.06x0.07x0.08,90,emergency,a,pick_1,fragile,x\n"
    book = read(header + GOOD.strip() + ",,,,,,\n" + line)
    last = book.orders[-1]
    assert isinstance(last, Delivery)
    assert (last.name, last.release_s, last.pick, last.drop) == ("b", 5.5, "pick_2", "drop_1")
    assert (last.mass_kg, last.size_m, last.due_s, last.priority) == (0.5, (0.06, 0.07, 0.08), 90.0, Priority.EMERGENCY)
    assert (last.after, last.picks, last.needs, last.batch) == (("a",), ("pick_2", "pick_1"), ("fragile",), "x")
