"""Parking: where cars wait, in parking places and, when these are taken, on lanes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.missions.nearest_place import NOWHERE, PlaceSearch
from fleet.missions.phases import ON_VISIT
from fleet.missions.state import Missions
from fleet.missions.ways import Ways


class Parking:
    """Parking places and who is bound for them.

    A car that finds all of them taken waits where it is, without a goal: whoever wants to pass pushes it on. Only where
    others come to a bay or leave it does it not wait, but goes on to the first cell behind.

    Args:
        states: Lane-graph state of each parking place.
        lane_states: Lane-graph states in which cars may wait when all are taken.
        missions: Tells which cars wait.
        ways: How far cars are from parking places.
    """

    def __init__(
        self, states: tuple[int, ...], lane_states: npt.NDArray[np.intp], missions: Missions, ways: Ways
    ) -> None:
        self.states = states
        self._missions = missions
        self._ways = ways
        # By state; the entry behind the last state is for cars that were sent nowhere.
        self._nowhere = np.zeros(ways.n_states + 1, dtype=np.bool_)
        self._is_place = self._nowhere.copy()
        self._is_place[list(states)] = True
        self._may_wait = self._nowhere.copy()
        self._may_wait[lane_states] = True

    def send(self, tick: int) -> None:
        """Send every car that waits to the nearest parking place that no other such car has, or visits."""
        waiting = self._missions.parked()
        if not waiting.size:
            return
        goals, tails = self._ways.goals[waiting], self._ways.tails[waiting]
        taken = self._nowhere.copy()
        taken[self._ways.goals[self._missions.cars_in(*ON_VISIT)]] = True
        has_place = self._is_place[goals] & ~taken[goals]
        bound = (has_place & (tails != goals)).nonzero()[0]
        has_place[bound] = self._ways.reaches_each(tails[bound], goals[bound])
        # After a visit to its place a car stays no longer than it likes.
        self._ways.let_push(waiting[has_place])
        without = np.flatnonzero(~has_place)
        if not without.size:
            return
        taken[goals] = True
        free = self._is_place & ~taken
        n_free, search = int(free.sum()), self._ways.place_search()
        for k in without.tolist():
            if not n_free:
                self._wait_on_lane(int(waiting[k]), int(tails[k]), int(goals[k]), search, tick)
                continue
            place = search.nearest(int(tails[k]), free)
            if place == NOWHERE:
                continue
            self._ways.send(int(waiting[k]), place, rank_s=0.0, stay=False, tick=tick)
            free[place] = False
            n_free -= 1

    def _wait_on_lane(self, car: int, tail: int, goal: int, search: PlaceSearch, tick: int) -> None:
        """Let a car wait where it is, or at the first cell where it may."""
        if self._may_wait[tail]:
            self._ways.wait(car)
        elif not self._may_wait[goal] and (place := search.nearest(tail, self._may_wait)) != NOWHERE:
            self._ways.send(car, place, rank_s=0.0, stay=False, tick=tick)
