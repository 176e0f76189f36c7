"""Parking: where cars wait."""

from __future__ import annotations

import numpy as np

from fleet.missions.phases import ON_VISIT
from fleet.missions.state import Missions
from fleet.missions.ways import Ways
from planners.mapf.distance_table import UNREACHABLE


class Parking:
    """Parking places and who is bound for them.

    Args:
        states: Lane-graph state of each parking place.
        missions: Tells which cars wait.
        ways: How far cars are from parking places.
    """

    def __init__(self, states: tuple[int, ...], missions: Missions, ways: Ways) -> None:
        self.states = states
        self._missions = missions
        self._ways = ways
        self._sorted = np.sort(np.array(states, dtype=np.int32))
        # By state; the entry behind the last state is for cars that were sent nowhere.
        self._nowhere = np.zeros(ways.n_states + 1, dtype=np.bool_)
        self._is_place = self._nowhere.copy()
        self._is_place[self._sorted] = True

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
        has_place[bound] = self._ways.moves_each(tails[bound], goals[bound]) < UNREACHABLE
        # After a visit to its place a car stays no longer than it likes.
        self._ways.let_push(waiting[has_place])
        without = np.flatnonzero(~has_place)
        if not without.size:
            return
        taken[goals] = True
        free = self._sorted[~taken[self._sorted]]
        for k in without.tolist():
            moves = self._ways.moves_each(np.full(len(free), tails[k], dtype=np.int32), free)
            if not free.size or moves.min() >= UNREACHABLE:
                continue
            # Of equally near ones, the one with the smallest number.
            nearest = int(moves.argmin())
            self._ways.send(int(waiting[k]), int(free[nearest]), rank_s=0.0, stay=False, tick=tick)
            free = np.delete(free, nearest)
