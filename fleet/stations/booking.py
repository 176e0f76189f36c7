"""Bookings: who may be under way to a station, or stand there, so that its queue never grows into the aisles."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt


class Bookings:
    """Places that take a limited number of cars: those bound for it and those that stand at it.

    A car keeps its booking until it has left the dock, and may hold one for where it goes next while it leaves. Who
    finds no room waits in order of asking; the caller decides where it waits meanwhile. Stations and chargers are both
    places: a station takes the car that is served and its buffer, a charger takes one. A cap on work under way is what
    manufacturing calls CONWIP (Spearman, Woodruff, Hopp, "CONWIP: a pull alternative to kanban", International
    Journal of Production Research 28(5), 1990).

    Args:
        caps: Cars each place takes, its buffer and one, at least 1 each.
        n_cars: Number of cars.
    """

    def __init__(self, caps: Sequence[int], n_cars: int) -> None:
        self.caps = tuple(caps)
        self.place_of: npt.NDArray[np.int64] = np.full(n_cars, -1, dtype=np.int64)
        """Place each car is bound for, stands at, or waits for, -1 for none, shape (n_cars,)."""
        self._booked: list[list[int]] = [[] for _ in caps]
        self._leaving: list[tuple[int, int]] = []
        self._waiting: list[deque[int]] = [deque() for _ in caps]

    def cars(self, place: int) -> list[int]:
        """Cars bound for a place or standing at it."""
        return self._booked[place] + [car for car, left in self._leaving if left == place]

    def room(self, place: int) -> int:
        """Cars a place still takes."""
        return self.caps[place] - len(self.cars(place))

    def waiting(self, place: int) -> tuple[int, ...]:
        """Cars that wait for room, first come first."""
        return tuple(self._waiting[place])

    def has(self, car: int) -> bool:
        """Whether a car has a place, and does not only wait for one."""
        place = int(self.place_of[car])
        return place >= 0 and car in self._booked[place]

    def book(self, car: int, place: int) -> bool:
        """Take a place for a car, unless there is no room; what it had booked before must have been left."""
        if self.room(place) <= 0:
            return False
        if car in self._waiting[place]:
            self._waiting[place].remove(car)
        self._booked[place].append(car)
        self.place_of[car] = place
        return True

    def wait(self, car: int, place: int) -> None:
        """Ask for room as soon as there is some."""
        self._waiting[place].append(car)
        self.place_of[car] = place

    def leave(self, car: int, *, stands_there: bool) -> None:
        """Give up what a car has booked or waits for; while it still stands there, nobody takes its place."""
        place = int(self.place_of[car])
        if place < 0:
            return
        self.place_of[car] = -1
        if car in self._waiting[place]:
            self._waiting[place].remove(car)
            return
        self._booked[place].remove(car)
        if stands_there:
            self._leaving.append((car, place))

    def clear(self, stands_at: Callable[[int, int], bool]) -> bool:
        """Free the places of cars that have gone.

        Args:
            stands_at: Whether a car still stands at a place.

        Returns:
            True when a place became free.
        """
        staying = [(car, place) for car, place in self._leaving if stands_at(car, place)]
        cleared = len(staying) < len(self._leaving)
        self._leaving = staying
        return cleared

    def callable_cars(self) -> list[tuple[int, int]]:
        """Cars that wait for a place which has room, first come first, each with its place."""
        return [
            (car, place)
            for place, queue in enumerate(self._waiting)
            if queue and (room := self.room(place)) > 0
            for car in list(queue)[:room]
        ]
