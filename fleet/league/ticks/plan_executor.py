"""PlanExecutor: carries plans out in ticks, in the order that they have in each cell, however late some robots are."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray
from fleet.league.rules import move_actions
from maps.formats.lorr import WAIT, Actions, Ints
from maps.lane_graph import LaneGraph
from planners.mapf.problem import Plan
from planners.precedence.dependency_graph import DependencyGraph
from planners.status import Status


class PlanExecutor:
    """Moves of plans wait in queues, and start when their turn has come in the cells they need.

    A robot may set out for a cell while whoever is in it drives on straight ahead.

    Args:
        graph: The `rotating` lane graph.
        states: Where the robots are, shape (n,).
        window: Moves of a robot that may wait when a plan has come in; the rest of it is dropped.
    """

    def __init__(self, graph: LaneGraph, states: Ints, window: int) -> None:
        self._order = DependencyGraph(graph, states)
        self._actions = move_actions(graph)
        self._window = window
        self._closed = np.zeros(graph.n_cells, dtype=np.bool_)

    def tail_states(self) -> Ints:
        """Where the robots are when all that waits is done, and the next plan begins, shape (n,)."""
        return self._order.tail_states().copy()

    def take(self, states: Ints) -> None:
        """Queue a plan, and drop what is too far ahead.

        What waits for each robot is then the beginning of what waited and of the plan, as the League demands.

        Args:
            states: State of each robot at each timestep of the plan, shape (T + 1, n); row 0 is `tail_states()`.
        """
        self._order.extend(Plan(states=states, status=Status.FEASIBLE, iterations=0))
        self._order.commit_cut(self._window)

    def actions(self) -> Actions:
        """What each robot shall do in the next tick, shape (n,)."""
        self._order.grant_all(1, self._closed)
        self._order.grant_behind()
        q = self._order.queues
        number = q.finished & (q.moves.shape[1] - 1)
        move = q.moves[np.arange(len(number)), number]
        return np.where(q.granted > q.finished, self._actions[move], np.int8(WAIT))

    def ended(self, robots: BoolArray) -> None:
        """Take note of who came to the end of its action, shape (n,)."""
        self._order.finish_all(np.flatnonzero(robots))

    def cells_ahead(self) -> tuple[Ints, Ints]:
        """Cells of each robot from here to `tail_states()`, both included, as CSR, shapes (n + 1,) and (k,)."""
        q = self._order.queues
        counts = q.queued - q.finished + 1
        ptr = np.concatenate(([0], np.cumsum(counts)))
        robot = np.repeat(np.arange(len(counts)), counts)
        place = np.arange(ptr[-1]) - ptr[robot]
        move = q.moves[robot, (q.finished[robot] + place - 1) & (q.moves.shape[1] - 1)]
        return ptr.astype(np.int32), q.state_cell[np.where(place == 0, q.state[robot], q.move_to[move])]
