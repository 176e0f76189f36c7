"""VisitRoutes: what is left of a visit, as moves and time, for those who decide which car makes it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fleet.missions.places import NOT_BOOKED, Place, Places
from fleet.missions.pods import Pods
from fleet.missions.ways import Ways
from fleet.robots.twist.pod import LIFT_S
from fleet.stations.booking import Bookings
from fleet.tasks.board import Task
from planners.mapf.distance_table import UNREACHABLE

Errand = tuple[Place, ...]
"""Places of which the nearest will do."""


class VisitRoutes:
    """Ways of visits. The way on from an errand for which several places will do is counted from the first of them,
    ways to and from a pod from beside it: nobody has a way to its cell before he is there.

    Args:
        places: Where cars can be sent.
        ways: How far they are.
        bookings: Room at the places.
        pods: Tells which pods other cars have.
    """

    def __init__(self, places: Places, ways: Ways, bookings: Bookings, pods: Pods) -> None:
        self._places = places
        self._ways = ways
        self._bookings = bookings
        self.pods = pods
        """Who has which pod."""

    def to_errand(self, task: Task, tails: npt.NDArray[np.int32]) -> npt.NDArray[np.float64]:
        """Moves of each car to where a visit goes on, `UNREACHABLE` where there is no way, shape (n_cars,)."""
        return self.moves_from(self.errands(task)[0], tails)

    def rest(self, task: Task) -> tuple[float, float]:
        """Moves of a visit from where it goes on to its end, at most `UNREACHABLE`, and how long it stands [s]."""
        errands = self.errands(task)
        moves = sum(self.moves(here, there) for here, there in pairwise(errands))
        return min(moves, float(UNREACHABLE)), sum(self.stands_s(task))

    def errands(self, task: Task) -> list[Errand]:
        """The errands that a visit has before it, at least one; of the next those places that have room, if any has."""
        errands = () if task.visit is None else task.visit.errands[task.n_errands_done :]
        if task.visit is not None and task.visit.pod:
            beside, home = task.visit.errands[:2]
            errands = tuple(beside if errand == home else errand for errand in errands)
        first, *rest = [tuple(map(self._places.named, errand)) for errand in errands]
        # Its car, if it has one, has room there already.
        free = tuple(place for place in first if place.name == task.place or self.room(place) > 0)
        return [free or first, *rest]

    def stands_s(self, task: Task) -> list[float]:
        """How long a visit stands at each errand before it [s]; with a pod it stands where that is wanted alone."""
        if task.visit is None:
            return []
        visit, before = task.visit, task.visit.errands[task.n_errands_done :]
        if not visit.pod:
            return [visit.stand_s for _ in before]
        # Beside the pod, below it, where it is wanted, and where it came from.
        return [0.0, LIFT_S, visit.stand_s, LIFT_S][-len(before) :]

    def moves(self, here: Errand, there: Errand) -> float:
        """Moves from one errand to another, `UNREACHABLE` if there is no way."""
        return float(self.moves_from(there, np.array(here[0].states[:1], dtype=np.int32))[0])

    def moves_from(self, errand: Errand, states: npt.NDArray[np.int32]) -> npt.NDArray[np.float64]:
        """Moves from each of some states to an errand, `UNREACHABLE` where there is no way, shape of `states`."""
        return np.asarray(np.minimum.reduce([self._ways.to_place(place, states) for place in errand]))

    def room(self, place: Place) -> int:
        """Cars a place still takes, at least 1 in a lane, where nobody books."""
        return 1 if place.number == NOT_BOOKED else self._bookings.room(place.number)

    def take_room(self, task: Task, rooms: dict[int, int]) -> bool:
        """Count a visit in at the first place it can go to next that has room; False if there is none.

        Args:
            task: The visit.
            rooms: Room left at places, by number; filled in for places that are asked for the first time. Pods are
                below `NOT_BOOKED`.
        """
        pod = self.pods.number(task)
        if pod >= 0:
            rooms[NOT_BOOKED - 1 - pod] = left = rooms.get(NOT_BOOKED - 1 - pod, int(self.pods.is_free_for(task))) - 1
            return left >= 0
        for place in map(self._places.named, task.next_errand):
            if place.number == NOT_BOOKED:
                return True
            if rooms.setdefault(place.number, self.room(place)) > 0:
                rooms[place.number] -= 1
                return True
        return False
