"""The order of a vehicle as its master keeps it."""

from typing import Any

from fleet.vda5050.growing_order import RESEND_S, GrowingOrder, Waypoint
from fleet.vda5050.order import order_of


def point(number: int) -> Waypoint:
    return Waypoint(name=f"n{number}", x=float(number), y=0.0, map_id="hall")


def told(
    book: GrowingOrder, update: int, passed: int, order_id: str = "", errors: tuple[Any, ...] = ()
) -> dict[str, Any]:
    return {
        "orderId": order_id or book.order_id,
        "orderUpdateId": update,
        "lastNodeSequenceId": 2 * passed,
        "errors": list(errors),
    }


def ids(message: dict[str, Any] | None) -> list[tuple[str, int]]:
    assert message is not None
    made = order_of(message)  # well formed
    return [(node.id, node.sequence) for node in made.nodes]


def test_an_order_grows_by_what_was_released_and_begins_where_the_base_ends() -> None:
    book = GrowingOrder("o", point(0))
    assert book.message(0.0) is None
    book.extend(point(1))
    assert ids(book.message(0.0)) == [("n0", 0), ("n1", 2)]
    book.extend(point(2))
    book.extend(point(3))
    assert book.message(0.1) is None  # the first is not known yet
    book.heard(told(book, 0, 0))
    assert ids(book.message(0.2)) == [("n1", 2), ("n2", 4), ("n3", 6)]
    book.heard(told(book, 1, 3))
    assert book.n_passed == 3
    assert book.n_updates == 2
    assert book.message(9.0) is None


def test_what_is_not_answered_is_sent_again_as_it_was() -> None:
    book = GrowingOrder("o", point(0))
    book.extend(point(1))
    first = book.message(0.0)
    book.extend(point(2))
    assert book.message(RESEND_S - 0.1) is None
    assert book.message(RESEND_S) == first
    book.heard(told(book, 0, 0))
    again = book.message(RESEND_S + 0.1)
    assert again is not None
    assert again["orderUpdateId"] == 1


def test_an_old_state_takes_nothing_back() -> None:
    book = GrowingOrder("o", point(0))
    for number in (1, 2):
        book.extend(point(number))
    book.message(0.0)
    book.heard(told(book, 0, 2))
    book.heard(told(book, 0, 1))
    assert book.n_passed == 2


def test_a_vehicle_that_has_forgotten_its_order_gets_a_new_one_from_where_it_passed_last() -> None:
    book = GrowingOrder("o", point(0))
    for number in (1, 2, 3):
        book.extend(point(number))
    book.message(0.0)
    book.heard(told(book, 0, 2))
    old = book.order_id
    book.heard({"orderId": " ", "orderUpdateId": 0, "lastNodeSequenceId": 0, "errors": []})
    assert book.order_id != old
    assert ids(book.message(1.0)) == [("n2", 0), ("n3", 2)]
    book.heard(told(book, 0, 1))
    assert book.n_passed == 3


def test_why_an_order_was_refused_is_kept_until_one_is_taken() -> None:
    book = GrowingOrder("o", point(0))
    book.extend(point(1))
    book.message(0.0)
    references = [{"referenceKey": "orderId", "referenceValue": book.order_id}]
    error = {"errorType": "noRouteError", "errorDescription": "a wall", "errorReferences": references}
    book.heard(told(book, 0, 0, order_id="another", errors=(error,)))
    assert book.refusal == "noRouteError: a wall"
    book.heard(told(book, 0, 0))
    assert book.refusal == ""
