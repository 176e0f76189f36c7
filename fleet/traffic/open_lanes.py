"""OpenLanes: how lanes may be driven at present: backwards, too, where something has cut the floor for good."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.arrays import BoolArray
from fleet.traffic.reversed_lanes import both_ways, cut_moves, dead_ends, in_order, with_reversed
from maps.lane_graph import REVERSE, LaneGraph

States = npt.NDArray[np.int32] | npt.NDArray[np.int64]


class OpenLanes:
    """The lanes of a site past what blocks cells for good.

    Where a wreck stands in a lane, cars behind it can go neither on nor back, and what lies beyond it may be reached
    from the other end only. So every move that nothing leads back from past the wreck may be driven backwards. All
    else stays as it is: plans, grants and cells are those of any move.

    Args:
        graph: The lanes of the site.
    """

    def __init__(self, graph: LaneGraph) -> None:
        self._graph = graph
        self._reversed = np.empty(0, dtype=np.int32)
        self._blocked = np.zeros(graph.n_cells, dtype=np.bool_)
        self._parts = np.zeros(graph.n_states, dtype=np.int64)
        self._backs_up = bool((graph.move_kind == REVERSE).any())
        self.dead_ends = dead_ends(graph, self._blocked) if self._backs_up else ()
        """The dead end that each state is in, -1 where lanes go round, shape (n_states,): of the outer ones, then of
        those within them."""
        self.n_changes = 0
        """Grows whenever something blocks cells for good, or does not any more."""
        self.planned = graph
        """The lanes to plan on."""
        self.granted = graph
        """The same, with moves that keep their numbers as long as the run lasts: for moves that are in hand."""

    def block(self, blocked: BoolArray) -> bool:
        """Take note of what blocks cells for good.

        Args:
            blocked: Those cells, shape (n_cells,).

        Returns:
            Whether other moves are open now.
        """
        if np.array_equal(blocked, self._blocked):
            return False
        self._blocked = blocked.copy()
        self.n_changes += 1
        self._parts = both_ways(self._graph, blocked)
        cut = cut_moves(self._graph, blocked)
        self.dead_ends = dead_ends(self._graph, blocked) if len(cut) or self._backs_up else ()
        before = self.planned
        self._reversed = np.append(self._reversed, cut[~np.isin(cut, self._reversed)])
        self.granted = with_reversed(self._graph, self._reversed, np.isin(self._reversed, cut))
        self.planned = in_order(self.granted) if len(cut) else self._graph
        return self.planned is not before

    def leave(self, states: States, goals: States) -> list[BoolArray]:
        """Which ways lead out of dead ends.

        Args:
            states: Where each begins, shape (k,).
            goals: And ends, shape (k,).

        Returns:
            Shape (k,) each, as `dead_ends` has them.
        """
        return [(number[states] >= 0) & (number[states] != number[goals]) for number in self.dead_ends]

    def joins(self, states: States, goals: States) -> BoolArray:
        """Whether a way leads from each state to the goal beside it, whatever is blocked only for now.

        From a state in a blocked cell no way leads anywhere.

        Args:
            states: States, shape (k,).
            goals: States, shape (k,).

        Returns:
            Shape (k,).
        """
        joined: BoolArray = self._parts[goals] == self._parts[states]
        return joined
