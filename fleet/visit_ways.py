"""VisitWays: what is left of a visit, as moves and time, for those who decide which car makes it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fleet.places import NOT_BOOKED, Place, Places
from fleet.stations.booking import Bookings
from fleet.tasks.board import Task
from planners.mapf.distance_table import UNREACHABLE


class VisitWays:
    """Ways of visits. At a stop for which several places will do, the first stands for all when the way on is counted.

    Args:
        places: Where cars can be sent.
        bookings: Room at the places.
    """

    def __init__(self, places: Places, bookings: Bookings) -> None:
        self._places = places
        self._bookings = bookings

    def to_stop(self, task: Task, tails: npt.NDArray[np.int32]) -> npt.NDArray[np.float64]:
        """Moves of each car to where a visit goes on, `UNREACHABLE` where there is no way, shape (n_cars,)."""
        places = [self._places.named(name) for name in task.next_stop]
        # Of several the nearest that has room, or that its car has already.
        free = [place for place in places if place.name == task.place or self.room(place) > 0]
        return np.asarray(np.minimum.reduce([self._places.moves(place, tails) for place in free or places]))

    def rest(self, task: Task) -> tuple[float, float]:
        """Moves of a visit from where it goes on to its end, at most `UNREACHABLE`, and how long it stands [s]."""
        stops = self.stops(task)
        moves = sum(self.moves(here, there) for here, there in pairwise(stops))
        return min(moves, float(UNREACHABLE)), self.stand_s(task) * len(stops)

    def stops(self, task: Task) -> list[Place]:
        """The stops that a visit has before it."""
        stops = task.visit.stops[task.stops_n :] if task.visit is not None else ()
        return [self._places.named(stop[0]) for stop in stops]

    def stand_s(self, task: Task) -> float:
        """How long a visit stands at each stop [s]."""
        return task.visit.stand_s if task.visit is not None else 0.0

    def moves(self, here: Place, there: Place) -> float:
        """Moves from one place to another, `UNREACHABLE` if there is no way."""
        return float(self._places.moves(there, np.array(here.states[:1], dtype=np.int32))[0])

    def moves_from(self, place: Place, states: npt.NDArray[np.int32]) -> npt.NDArray[np.float64]:
        """Moves from each of some states to a place, `UNREACHABLE` where there is no way, shape of `states`."""
        return self._places.moves(place, states)

    def room(self, place: Place) -> int:
        """Cars a place still takes, at least 1 in a lane, where nobody books."""
        return 1 if place.number == NOT_BOOKED else self._bookings.room(place.number)

    def take_room(self, task: Task, rooms: dict[int, int]) -> bool:
        """Count a visit in at the first place it can go to next that has room; False if there is none.

        Args:
            task: The visit.
            rooms: Room left at places, by number; filled in for places that are asked for the first time.
        """
        for place in map(self._places.named, task.next_stop):
            if place.number == NOT_BOOKED:
                return True
            if rooms.setdefault(place.number, self.room(place)) > 0:
                rooms[place.number] -= 1
                return True
        return False
