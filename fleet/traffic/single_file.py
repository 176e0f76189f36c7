"""SingleFile: a dead end is driven into by one car at a time, since whoever is in it comes out the same way."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray, CellArray, FloatArray
from fleet.traffic.open_lanes import OpenLanes
from planners.mapf.distance_table import DistanceTable
from planners.mapf.problem import NO_GOAL

NEAR_MOVES = 8
"""A car that has so many moves left to its goal in a dead end waits until it is its turn; others drive on."""
ENTRY_MOVES = 4
"""So does one whose way leads within so many moves into a dead end in which nothing goes round, however deep in it its
goal lies: more than are granted before the next plan."""
PATIENCE_S = 10.0
"""The car whose turn it is has to make room for the next if it has not moved for so long [s]."""
_End = tuple[int, int]
"""A dead end: how deep it lies within others, and its number."""


class SingleFile:
    """Whose turn it is at each dead end.

    The nearest car goes first; at a dead end within another, the nearest of those that are in the outer one or whose
    turn it is there, since the others cannot come. One that cannot move lets the next one go: in a narrow place the
    nearest may be the one that is in the way.

    Attributes:
        first: The cars whose turn it is, as `goals` left it: all others make room for them.

    Args:
        lanes: Knows the dead ends.
    """

    def __init__(self, lanes: OpenLanes) -> None:
        self._lanes = lanes
        self.first: list[int] = []
        self._turn: dict[_End, int] = {}
        self._given_s: dict[_End, float] = {}
        self._n_changes = lanes.n_changes

    def goals(
        self,
        goals: CellArray,
        states: CellArray,
        stay: BoolArray,
        ways: DistanceTable,
        still_s: FloatArray,
        now_s: float,
    ) -> CellArray:
        """Where cars are to go for now: those whose turn it is not stay where they are, and make room.

        Args:
            goals: State that each is to go to in the end, -1 = none, shape (n_cars,).
            states: State in which the next plan finds each, shape (n_cars,).
            stay: Who does not make room once it is there, such as in a dock, shape (n_cars,).
            ways: Distances.
            still_s: Time since each was last granted a move or finished one, shape (n_cars,) [s].
            now_s: Simulated time [s].

        Returns:
            Shape (n_cars,).
        """
        self.first = []
        if self._n_changes != self._lanes.n_changes:  # dead ends have other numbers now
            self._n_changes = self._lanes.n_changes
            self._turn.clear()
            self._given_s.clear()
        goes = goals != NO_GOAL
        found = goals.copy() if self._lanes.dead_ends else goals
        waits = np.zeros(len(goals), dtype=np.bool_)  # outside an outer dead end: it is nobody's turn within it
        for depth, number in enumerate(self._lanes.dead_ends):
            bound_for = np.where(goes, number[np.where(goes, goals, 0)], -1)
            stands_in = number[states]
            # Who only parks there makes room; who stands in a dock will come out.
            narrow = depth == len(self._lanes.dead_ends) - 1
            busy = set(stands_in[(stands_in >= 0) & goes & ((goals != states) | (stay & narrow))].tolist())
            for end in np.unique(bound_for[bound_for >= 0]).tolist():
                inside = number == end
                cars = np.flatnonzero((bound_for == end) & (stands_in != end))
                left = np.array([int(ways.to(int(goals[car]))[states[car]]) for car in cars])
                order = cars[np.argsort(left, kind="stable")]
                queue = order[~waits[order]].tolist()
                first = NO_GOAL
                if queue and end not in busy:
                    first = self._first((depth, end), queue, still_s, now_s)
                    self.first.append(first)
                waits[cars[cars != first]] = True
                near = left <= NEAR_MOVES
                if narrow:
                    near |= np.array([_enters(ways, states[k], goals[k], inside) for k in cars], dtype=np.bool_)
                held = cars[near & (cars != first)]
                found[held] = states[held]
        return found

    def _first(self, end: _End, queue: list[int], still_s: FloatArray, now_s: float) -> int:
        """Whose turn it is."""
        now = self._turn.get(end, NO_GOAL)
        if now not in queue:
            turn = queue[0]
        elif min(float(still_s[now]), now_s - self._given_s[end]) > PATIENCE_S:
            turn = queue[(queue.index(now) + 1) % len(queue)]
        else:
            return now
        self._turn[end], self._given_s[end] = turn, now_s
        return turn


def _enters(ways: DistanceTable, state: int, goal: int, inside: BoolArray) -> bool:
    """Whether the shortest way from a state to a goal leads into a dead end with one of the next moves."""
    for _ in range(ENTRY_MOVES):
        state = ways.next_state(state, goal)
        if state < 0:
            return False
        if inside[state]:
            return True
    return False
