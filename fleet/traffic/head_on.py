"""HeadOn: of two cars that each stand where the other wants to go next, the one that cannot step aside goes first."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray, CellArray, FloatArray
from fleet.traffic.open_lanes import OpenLanes
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.mapf.problem import NO_GOAL

PATIENCE_S = 10.0
"""Two cars that have not moved for so long do not part by themselves [s]."""


class HeadOn:
    """Who goes first where lanes are driven both ways and two cars have met.

    Priority inheritance leaves a car where it is rather than let it drive away from its goal, so the one that ranks
    higher waits for a lower one whose only way out it is itself. The one with fewer other moves goes before all others
    until it has come to its goal or has another; priority inheritance then makes the other one step aside.

    Args:
        lanes: Knows whether any lane is driven both ways: where none is, cars do not meet head on.
    """

    def __init__(self, lanes: OpenLanes) -> None:
        self._lanes = lanes
        self._goal_of: dict[int, int] = {}  # of cars that go first

    def first(
        self, goals: CellArray, states: CellArray, ways: DistanceTable, still_s: FloatArray, fixed: BoolArray
    ) -> list[int]:
        """Cars that go before all others at present.

        Args:
            goals: State that each is to go to, -1 = none, shape (n_cars,).
            states: State in which the next plan finds each, shape (n_cars,).
            ways: Distances.
            still_s: Time since each was last granted a move or finished one, shape (n_cars,) [s].
            fixed: Cars that cannot move, shape (n_cars,).

        Returns:
            Their numbers, ascending.
        """
        if not self._lanes.dead_ends:
            self._goal_of.clear()
            return []
        under_way = (goals != NO_GOAL) & (goals != states) & ~fixed
        self._goal_of = {car: goal for car, goal in self._goal_of.items() if under_way[car] and goals[car] == goal}
        waits = np.flatnonzero(under_way & (still_s > PATIENCE_S)).tolist()
        cells = ways.graph.state_cell[states]
        ahead = ways.next_states(states[waits], goals[waits])
        wants = dict(zip(waits, np.where(ahead < 0, -1, ways.graph.state_cell[ahead]).tolist(), strict=True))
        for car in waits:
            for other in waits:
                if car < other and wants[car] == cells[other] and wants[other] == cells[car]:
                    aside, others = (
                        _n_aside(ways, int(states[a]), int(goals[a]), int(cells[b]))
                        for a, b in ((car, other), (other, car))
                    )
                    goes = car if aside <= others else other
                    self._goal_of[goes] = int(goals[goes])
        return sorted(self._goal_of)


def _n_aside(ways: DistanceTable, state: int, goal: int, cell: int) -> int:
    """How many moves lead from a state to other cells than one, with a way on from there to its goal."""
    states = ways.after(state)
    return int(((ways.graph.state_cell[states] != cell) & (ways.to(goal)[states] < UNREACHABLE)).sum())
