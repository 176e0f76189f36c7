"""Bookings: never more cars than a place takes, and nobody is forgotten."""

import numpy as np
import pytest

from fleet.stations.booking import Bookings


def test_no_more_cars_than_a_place_takes() -> None:
    bookings = Bookings([2, 1], n_cars=4)
    assert [bookings.book(car, 0) for car in (0, 1, 2)] == [True, True, False]
    assert bookings.cars(0) == [0, 1]
    assert (bookings.room(0), bookings.room(1)) == (0, 1)
    assert bookings.place_of.tolist() == [0, 0, -1, -1]


def test_a_place_is_free_when_its_car_has_driven_away() -> None:
    bookings = Bookings([1, 1], n_cars=2)
    bookings.book(0, 0)
    bookings.leave(0, stands_there=True)
    assert bookings.book(0, 1), "it may book where it goes next while it leaves"
    assert not bookings.book(1, 0)
    assert not bookings.clear(lambda car, place: True)
    assert bookings.room(0) == 0
    assert bookings.clear(lambda car, place: False)
    assert bookings.book(1, 0)


def test_a_car_that_turns_back_on_its_way_frees_its_place_at_once() -> None:
    bookings = Bookings([1], n_cars=2)
    bookings.book(0, 0)
    bookings.leave(0, stands_there=False)
    assert bookings.room(0) == 1


def test_who_waits_is_called_in_order_of_asking() -> None:
    bookings = Bookings([1], n_cars=4)
    bookings.book(0, 0)
    for car in (3, 1, 2):
        bookings.wait(car, 0)
    assert bookings.callable_cars() == []
    bookings.leave(3, stands_there=False)
    bookings.leave(0, stands_there=False)
    assert bookings.callable_cars() == [(1, 0)]
    assert bookings.book(1, 0)
    assert bookings.waiting(0) == (2,)


@pytest.mark.parametrize("seed", range(20))
def test_any_sequence_keeps_the_cap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    caps = rng.integers(1, 4, 3).tolist()
    bookings = Bookings(caps, n_cars=8)
    for _ in range(300):
        car, place = int(rng.integers(8)), int(rng.integers(3))
        if bookings.place_of[car] < 0:
            if not bookings.book(car, place):
                bookings.wait(car, place)
        elif rng.random() < 0.5:
            bookings.leave(car, stands_there=bool(rng.random() < 0.5))
        if rng.random() < 0.2:
            gone = set(rng.integers(0, 8, 3).tolist())
            bookings.clear(lambda car, place, gone=gone: car not in gone)  # type: ignore[misc]
        for called, where in bookings.callable_cars():
            assert bookings.book(called, where)
        assert all(len(bookings.cars(k)) <= cap for k, cap in enumerate(caps))
        assert all(not bookings.waiting(k) or bookings.room(k) == 0 for k in range(3))
