"""FloorDistances: how far all is from where cars are sent, and what ways there cost that go round docks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fleet.arrays import BoolArray, IntArray
from maps.lane_graph import LaneGraph
from planners.mapf.distance_table import DistanceTable

DOCK_COST = 200
"""What a dock costs a car that only passes, in moves: it would stand behind the one that is served, and in the way of
those that come next."""


class FloorDistances:
    """Distances past all that is blocked.

    Args:
        graph: Lane graph of the site.
        docks: Cells of the docks.
        blocked: Cells nobody may enter, shape (n_cells,); None = none.
    """

    def __init__(self, graph: LaneGraph, docks: Sequence[int], blocked: BoolArray | None = None, against=None) -> None:
        self._graph = graph
        self._docks = docks
        self._against = against
        self._surcharges = None if against is None else surcharges(graph, against)
        self._blocked = np.zeros(graph.n_cells, dtype=np.bool_) if blocked is None else blocked
        self.costs: IntArray = np.ones(graph.n_cells, dtype=np.int64)
        """What it costs to pass each cell, in moves, shape (n_cells,)."""
        self.costs[list(docks)] = DOCK_COST
        self.exact = DistanceTable(graph, self._blocked)
        """As far as it is."""
        self.around = self.ways() if len(docks) or against is not None else self.exact
        """What ways cost."""

    def ways(self) -> DistanceTable:
        """What ways cost, in a table of the caller's own."""
        return DistanceTable(self._graph, self._blocked, costs=self.costs, surcharges=self._surcharges)

    def past(self, blocked: BoolArray, graph: LaneGraph) -> FloorDistances:
        """Those past other blocked cells, on the same lanes or others of the same states; without any, these."""
        same = graph is self._graph and not blocked.any()
        return self if same else FloorDistances(graph, self._docks, blocked, self._against)


import os
A=int(os.environ.get("AG","8")); R=int(os.environ.get("RV","8"))
def surcharges(graph, against):
    back = graph.move_kind == 3
    return np.where(back, R, A * against[graph.move_to])
