"""Tides: an aisle in which cars cannot pass is entered by one direction at a time."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray, CellArray, FloatArray
from fleet.traffic.narrow_aisles import narrow_aisles
from maps.lane_graph import REVERSE, LaneGraph
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.mapf.problem import NO_GOAL

ENTRY_MOVES = 4
TIDE_S = 40.0


class Tides:
    def __init__(self, graph: LaneGraph) -> None:
        self._aisle = narrow_aisles(graph)
        self._cell = graph.state_cell
        self._of_state = self._aisle[self._cell]
        forwards = graph.move_kind != REVERSE
        out = np.full(graph.n_states, -1)
        out[graph.move_to[forwards]] = self._aisle[self._cell[graph.move_from[forwards]]]
        self._of_state = np.where(self._of_state >= 0, self._of_state, out)
        n = int(self._aisle.max(initial=-1)) + 1
        self._ends = [-1] * n
        self._since_s = [0.0] * n
        self.inside = []

    def goals(self, goals, states, stay, fixed, ways, now_s):
        self.inside = []
        if not self._ends:
            return goals
        found = goals.copy()
        aisle_now = self._of_state[states]
        goes = (goals != NO_GOAL) & (goals != states)
        n = len(self._ends)
        inside = [[] for _ in range(n)]
        wants = [[] for _ in range(n)]
        shut = [False] * n
        for car in range(len(goals)):
            aisle = int(aisle_now[car])
            if aisle >= 0:
                if fixed[car] or (stay[car] and goals[car] == states[car]):
                    shut[aisle] = True
                elif goes[car]:
                    inside[aisle].append((car, self._end(ways, int(states[car]), int(goals[car]), aisle)))
            elif goes[car]:
                state, left = int(states[car]), ways.to(int(goals[car]))
                for k in range(ENTRY_MOVES):
                    nxt = ways.after(state)
                    if not nxt.size or left[state] >= UNREACHABLE:
                        break
                    state = int(nxt[left[nxt].argmin()])
                    aisle = int(self._aisle[self._cell[state]])
                    if aisle >= 0:
                        wants[aisle].append((k, int(left[states[car]]), car, self._end(ways, state, int(goals[car]), aisle)))
                        break
                    if state == goals[car]:
                        break
        for aisle in range(n):
            ends = {end for _, end in inside[aisle]}
            wants[aisle].sort()
            now = self._ends[aisle]
            others = any(w[3] != now for w in wants[aisle])
            if ends:
                if now not in ends:
                    now = sorted(ends)[0]
                    self._since_s[aisle] = now_s
                late = others and now_s - self._since_s[aisle] > TIDE_S
                is_open = not late and not shut[aisle] and len(ends) == 1
            else:
                mine = [w for w in wants[aisle] if w[3] == now]
                if wants[aisle] and (not mine or (others and now_s - self._since_s[aisle] > TIDE_S)):
                    now = next(w[3] for w in wants[aisle] if w[3] != now)
                    self._since_s[aisle] = now_s
                is_open = not shut[aisle]
            self._ends[aisle] = now
            self.inside += [car for car, _ in inside[aisle]]
            for _, _, car, end in wants[aisle]:
                if not is_open or end != now:
                    found[car] = states[car]
        return found

    def _end(self, ways, state, goal, aisle):
        """Cell in which a car comes out of the aisle, or its goal in it."""
        left = ways.to(goal)
        for _ in range(200):
            if state == goal or self._aisle[self._cell[state]] != aisle:
                break
            nxt = ways.after(state)
            if not nxt.size or left[state] >= UNREACHABLE:
                break
            state = int(nxt[left[nxt].argmin()])
        return int(self._cell[state])
