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

    def send(self, tick: int) -> None:
        """Send every car that waits to the nearest parking place that no other such car has, or visits."""
        waiting = self._missions.parked()
        if not waiting.size:
            return
        goals, tails = self._ways.goals[waiting], self._ways.tails[waiting]
        visited = self._ways.goals[self._missions.cars_in(*ON_VISIT)]
        has_place = np.isin(goals, self._sorted) & ~np.isin(goals, visited)
        has_place[has_place] = self._ways.moves_each(tails[has_place], goals[has_place]) < UNREACHABLE
        # After a visit to its place a car stays no longer than it likes.
        self._ways.let_push(waiting[has_place])
        without = np.flatnonzero(~has_place)
        if not without.size:
            return
        free = self._sorted[~np.isin(self._sorted, np.concatenate((goals, visited)))]
        for k in without.tolist():
            moves = self._ways.moves_each(np.full(len(free), tails[k], dtype=np.int32), free)
            if not free.size or moves.min() >= UNREACHABLE:
                continue
            # Of equally near ones, the one with the smallest number.
            nearest = int(moves.argmin())
            self._ways.send(int(waiting[k]), int(free[nearest]), rank_s=0.0, stay=False, tick=tick)
            free = np.delete(free, nearest)
