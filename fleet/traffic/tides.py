"""Tides: an aisle in which cars cannot pass each other is entered by one direction at a time."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from fleet.arrays import BoolArray, CellArray
from fleet.traffic.narrow_aisles import narrow_aisles
from maps.lane_graph import REVERSE, LaneGraph
from planners.mapf.distance_table import DistanceTable
from planners.mapf.problem import NO_GOAL

ENTRY_MOVES = 4
"""A car whose way leads into an aisle within so many moves waits for its direction: more than are granted before the
next plan."""
TIDE_S = 40.0
"""Time after which the direction changes if somebody waits for the other one [s]; else it does when nobody comes any
more. Each change costs the time in which the aisle empties, so a short tide lets fewer cars pass."""
NOWHERE = -1


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """A car that is about to drive into an aisle."""

    car: int
    end: int
    """Cell in which it will come out."""
    nearness: tuple[int, int, int]
    """Moves to the aisle, then cost of its way, then its number: the least comes first."""


class Tides:
    """Which way each narrow aisle is driven at present.

    Priority inheritance lets two cars that meet in a narrow aisle push each other to and fro. So an aisle has an end
    that cars drive to. Those that come out elsewhere wait before it and make room, and nobody follows while one stands
    in it to be served. Who is in an aisle goes first until it has left the cell before it: else those that wait there
    would push it back.

    Attributes:
        first: Cars in the aisles that drive, as `goals` left it: all others make room for them.

    Args:
        graph: The lanes of the site.
    """

    def __init__(self, graph: LaneGraph) -> None:
        backs_up = bool((graph.move_kind == REVERSE).any())
        self._aisle = narrow_aisles(graph) if backs_up else np.full(graph.n_cells, NOWHERE, dtype=np.int64)
        self._cell = graph.state_cell
        came_from = np.full(graph.n_states, NOWHERE, dtype=np.int64)
        forwards = graph.move_kind != REVERSE
        came_from[graph.move_to[forwards]] = self._aisle[self._cell[graph.move_from[forwards]]]
        here = self._aisle[self._cell]
        self._of_state = np.where(here == NOWHERE, came_from, here)
        n_aisles = int(self._aisle.max(initial=NOWHERE)) + 1
        self._end = [NOWHERE] * n_aisles
        self._since_s = [0.0] * n_aisles
        self.first: list[int] = []

    def goals(
        self,
        goals: CellArray,
        states: CellArray,
        stay: BoolArray,
        fixed: BoolArray,
        ways: DistanceTable,
        now_s: float,
    ) -> CellArray:
        """Where cars are to go for now: those whose direction it is not stay where they are, and make room.

        Args:
            goals: State that each is to go to, -1 = none, shape (n_cars,).
            states: State in which the next plan finds each, shape (n_cars,).
            stay: Who does not make room once it is there, such as in a dock, shape (n_cars,).
            fixed: Cars that cannot move, shape (n_cars,).
            ways: Distances.
            now_s: Simulated time [s].

        Returns:
            Shape (n_cars,).
        """
        self.first = []
        if not self._end:
            return goals
        goes = (goals != NO_GOAL) & (goals != states)
        aisle = self._of_state[states]
        inside = (aisle != NOWHERE) & (goals != NO_GOAL)
        shut = set(aisle[inside & (fixed | (stay & ~goes))].tolist())
        ends = defaultdict(set)
        for car in np.flatnonzero(inside & goes & ~fixed).tolist():
            ends[int(aisle[car])].add(self._way_out(ways, int(states[car]), int(goals[car])))
            self.first.append(car)
        entries = defaultdict(list)
        for car in np.flatnonzero(goes & (aisle == NOWHERE)).tolist():
            entered = self._entry(ways, int(states[car]), int(goals[car]), car)
            if entered is not None:
                entries[entered[0]].append(entered[1])
        found = goals.copy()
        for number, waiting in entries.items():
            is_open = self._turn(number, ends[number], waiting, now_s) and number not in shut
            held = [entry.car for entry in waiting if not is_open or entry.end != self._end[number]]
            found[held] = states[held]
        return found

    def _turn(self, number: int, ends: set[int], waiting: list[_Entry], now_s: float) -> bool:
        """Set the end that an aisle is driven to; returns whether cars that go there may enter.

        Args:
            number: The aisle.
            ends: Where cars come out that are in it.
            waiting: Cars that are about to enter it, at least one.
            now_s: Simulated time [s].
        """
        end = self._end[number]
        others = [entry for entry in waiting if entry.end != end]
        over = bool(others) and now_s - self._since_s[number] > TIDE_S
        turned = end
        if ends:
            turned = end if end in ends else min(ends)
        elif over or len(others) == len(waiting):
            turned = min(others, key=lambda entry: entry.nearness).end
        if turned != end:
            self._end[number], self._since_s[number] = turned, now_s
        return not ends or (len(ends) == 1 and not (over and turned == end))

    def _entry(self, ways: DistanceTable, state: int, goal: int, car: int) -> tuple[int, _Entry] | None:
        """The aisle that a car's shortest way leads into with one of the next moves, if it does."""
        left = ways.to(goal)
        cost = int(left[state])
        for moves in range(ENTRY_MOVES):
            state = _next(ways, state, goal)
            if state == NOWHERE:
                return None
            number = int(self._aisle[self._cell[state]])
            if number != NOWHERE:
                end = self._way_out(ways, state, goal)
                return number, _Entry(car=car, end=end, nearness=(moves, cost, car))
        return None

    def _way_out(self, ways: DistanceTable, state: int, goal: int) -> int:
        """Cell in which a car comes out of the aisle that it is in, or its goal in it."""
        number = int(self._aisle[self._cell[state]])
        cell = int(self._cell[state])
        while number != NOWHERE and self._aisle[cell] == number:
            state = _next(ways, state, goal)
            if state == NOWHERE:
                break
            cell = int(self._cell[state])
        return cell


def _next(ways: DistanceTable, state: int, goal: int) -> int:
    """The state that comes next on the shortest way, `NOWHERE` at its end or if there is none."""
    return NOWHERE if state == goal else ways.next_state(state, goal)
