"""Bookings: never more cars than a place takes, and nobody is forgotten."""

import numpy as np
import pytest

from fleet.stations.booking import Bookings


def booked(bookings: Bookings, car: int, place: int) -> bool:
    bookings.bind(car, place)
    return bookings.book(car)


def test_no_more_cars_than_a_place_takes() -> None:
    bookings = Bookings([2, 1], n_cars=4)
    assert [booked(bookings, car, 0) for car in (0, 1, 2)] == [True, True, False]
    assert bookings.cars(0) == [0, 1]
    assert bookings.bound(0) == (0, 1, 2), "who finds no room is bound for it all the same"
    assert bookings.waiting(0) == [2]
    assert (bookings.room(0), bookings.room(1)) == (0, 1)
    assert bookings.place_of.tolist() == [0, 0, 0, -1]
    assert bookings.book(1), "it has its booking already"
    assert bookings.most == [2, 0]


def test_a_place_is_free_when_its_car_has_driven_away() -> None:
    bookings = Bookings([1, 1], n_cars=2)
    booked(bookings, 0, 0)
    bookings.leave(0, stands_there=True)
    assert booked(bookings, 0, 1), "it may book where it goes next while it leaves"
    bookings.bind(1, 0)
    assert not bookings.book(1)
    assert not bookings.clear(lambda car, place: True)
    assert bookings.room(0) == 0
    assert bookings.clear(lambda car, place: False)
    assert bookings.book(1)


def test_a_car_that_turns_back_on_its_way_frees_its_place_at_once() -> None:
    bookings = Bookings([1], n_cars=2)
    booked(bookings, 0, 0)
    bookings.leave(0, stands_there=False)
    assert bookings.room(0) == 1
    assert bookings.bound(0) == ()


def test_a_car_that_stands_there_without_a_booking_is_not_counted() -> None:
    bookings = Bookings([1], n_cars=2)
    bookings.bind(0, 0)
    bookings.leave(0, stands_there=True)
    assert bookings.room(0) == 1


@pytest.mark.parametrize("seed", range(20))
def test_any_sequence_keeps_the_cap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    caps = rng.integers(1, 4, 3).tolist()
    bookings = Bookings(caps, n_cars=8)
    for _ in range(300):
        car, place = int(rng.integers(8)), int(rng.integers(3))
        if bookings.place_of[car] < 0:
            bookings.bind(car, place)
        elif rng.random() < 0.5:
            had_room = bookings.has(car) or bookings.room(int(bookings.place_of[car])) > 0
            assert bookings.book(car) == had_room
        else:
            bookings.leave(car, stands_there=bool(rng.random() < 0.5))
        if rng.random() < 0.2:
            gone = set(rng.integers(0, 8, 3).tolist())
            bookings.clear(lambda car, place, gone=gone: car not in gone)  # type: ignore[misc]
        for k, cap in enumerate(caps):
            assert len(bookings.cars(k)) <= cap
            assert set(bookings.bound(k)) == set(np.flatnonzero(bookings.place_of == k).tolist())
            assert all(bookings.has(car) != (car in bookings.waiting(k)) for car in bookings.bound(k))


def test_cars_in_line_are_those_that_are_bound_place_by_place() -> None:
    bookings = Bookings([1, 1, 1, 1], n_cars=5)
    for car, place in ((3, 2), (0, 0), (4, 2), (1, 3)):
        bookings.bind(car, place)
    cars, first = bookings.in_line(3)
    assert cars.tolist() == [0, 3, 4]
    assert first.tolist() == [0, 1, 1, 3]
