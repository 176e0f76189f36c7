"""Bookings: who is bound for a station, and who may be at it, so that its queue never grows into the aisles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain

import numpy as np

from fleet.arrays import BoolArray, IntArray


class Bookings:
    """Places where a limited number of cars may be at once, whoever else is on the way to them.

    Any number of cars may be bound for a place, in an order. A car that is near books it, if there is room; who finds
    none turns aside, where the caller says. A car keeps its booking until it has left the dock, and may be bound for
    where it goes next while it leaves. Stations and chargers are both places: a station has room for the car that is
    served and its buffer, a charger for one. A cap on work under way is what manufacturing calls CONWIP (Spearman,
    Woodruff, Hopp, "CONWIP: a pull alternative to kanban", International Journal of Production Research 28(5), 1990).

    Args:
        caps: Cars that may be at each place, its buffer and one, at least 1 each.
        n_cars: Number of cars.
    """

    def __init__(self, caps: Sequence[int], n_cars: int) -> None:
        self.caps = tuple(caps)
        self.closed: BoolArray = np.zeros(len(caps), dtype=np.bool_)
        """Places that take no more cars at present, shape (n_places,)."""
        self.place_of: IntArray = np.full(n_cars, -1, dtype=np.int64)
        """Place each car is bound for or at, -1 for none, shape (n_cars,)."""
        self.booked: BoolArray = np.zeros(n_cars, dtype=np.bool_)
        """Whether each car has booked the place it is bound for, shape (n_cars,)."""
        self.n_changes = 0
        """Grows whenever a car is bound for a place, books it, leaves it or has gone."""
        self.changed_at: IntArray = np.zeros(len(caps), dtype=np.int64)
        """What `n_changes` was when last a car was bound for each place, booked it or left it, shape (n_places,)."""
        self.most = [0] * len(caps)
        """Most cars each place ever had at once."""
        self._bound: list[list[int]] = [[] for _ in caps]
        self._booked: list[list[int]] = [[] for _ in caps]
        self._leaving: list[tuple[int, int]] = []
        self._n_leaving = [0] * len(caps)

    def bound(self, place: int) -> tuple[int, ...]:
        """Cars bound for a place or booked there, in the order in which they set out to go."""
        return tuple(self._bound[place])

    def in_line(self, n_places: int) -> tuple[IntArray, IntArray]:
        """What `bound` says of each of the first places.

        Returns:
            The cars of one place after the other, shape (n,), and where those of each begin, and the end, shape
            (n_places + 1,).
        """
        queues = self._bound[:n_places]
        first = np.zeros(n_places + 1, dtype=np.int64)
        np.cumsum([len(queue) for queue in queues], out=first[1:])
        return np.fromiter(chain.from_iterable(queues), np.int64, first[-1]), first

    def cars(self, place: int) -> list[int]:
        """Cars that have booked a place, or still stand there."""
        return self._booked[place] + [car for car, left in self._leaving if left == place]

    def room(self, place: int) -> int:
        """Cars a place still takes."""
        if self.closed[place]:
            return 0
        return self.caps[place] - len(self._booked[place]) - self._n_leaving[place]

    def full_words(self, place: int, name: str) -> str:
        """What to say to a car that finds no room at a place of a name."""
        if self.closed[place]:
            return f"{name} is closed"
        return f"{name} is full ({', '.join(f'car_{car}' for car in self.cars(place))})"

    def waiting(self, place: int) -> list[int]:
        """Cars that are bound for a place and have not booked it."""
        return [car for car in self._bound[place] if car not in self._booked[place]]

    def has(self, car: int) -> bool:
        """Whether a car has booked the place it is bound for."""
        return bool(self.booked[car])

    def bind(self, car: int, place: int) -> None:
        """Let a car be bound for a place, after all others; what it was bound for before must have been left."""
        self._count(place)
        self._bound[place].append(car)
        self.place_of[car] = place

    def book(self, car: int) -> bool:
        """Book for a car the place it is bound for, unless there is no room."""
        place = int(self.place_of[car])
        if self.booked[car]:
            return True
        if self.room(place) <= 0:
            return False
        self._count(place)
        self._booked[place].append(car)
        self.booked[car] = True
        self.most[place] = max(self.most[place], self.caps[place] - self.room(place))
        return True

    def leave(self, car: int, *, stands_there: bool) -> None:
        """Give up what a car is bound for; while it still stands there, nobody takes its place."""
        place = int(self.place_of[car])
        if place < 0:
            return
        self._count(place)
        self.place_of[car] = -1
        self._bound[place].remove(car)
        if self.booked[car]:
            self._booked[place].remove(car)
            self.booked[car] = False
            if stands_there:
                self._leaving.append((car, place))
                self._n_leaving[place] += 1

    def clear(self, stands_at: Callable[[int, int], bool]) -> bool:
        """Free the places of cars that have gone.

        Args:
            stands_at: Whether a car still stands at a place.

        Returns:
            True when a place became free.
        """
        if not self._leaving:
            return False
        staying = [(car, place) for car, place in self._leaving if stands_at(car, place)]
        if len(staying) == len(self._leaving):
            return False
        for _, place in self._leaving:
            self._n_leaving[place] = 0
        for _, place in staying:
            self._n_leaving[place] += 1
        self.n_changes += 1
        self._leaving = staying
        return True

    def _count(self, place: int) -> None:
        self.n_changes += 1
        self.changed_at[place] = self.n_changes
