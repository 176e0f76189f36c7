"""FloorDistances: how far all is from where cars are sent, and what ways there cost that go round docks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fleet.arrays import BoolArray, CellArray, IntArray
from maps.lane_graph import REVERSE, LaneGraph
from planners.mapf.distance_table import DistanceTable

DOCK_COST = 200
"""What a dock costs a car that only passes, in moves: it would stand behind the one that is served, and in the way of
those that come next."""
AGAINST_COST = 3
"""What a lane costs beyond a move that leads against the street of a two-way aisle: where another aisle leads the right
way, opposing cars part; where none does nearby, or nobody is about, the shorter way is taken."""
BACKWARDS_COST = 8
"""What a move backwards costs beyond one forwards, on a site whose cars may back up: it is for stepping aside and for
leaving dead ends, and lanes of one direction stay that."""

KEPT_BYTES = 600_000_000
"""Memory beyond which places where nobody goes at present make room in a table: all places of a floor for 1,000 cars
take less, and on one for 10,000 it is 2,000 places, three times its docks."""


class FloorDistances:
    """Distances past all that is blocked.

    Args:
        graph: Lane graph of the site.
        docks: Cells of the docks.
        blocked: Cells nobody may enter, shape (n_cells,); None = none.
        against: States of lanes that lead against a street, shape (k,), of a site whose cars may back up; None = they
            may not, and if a wreck makes them, it costs nothing.
    """

    def __init__(
        self,
        graph: LaneGraph,
        docks: Sequence[int],
        blocked: BoolArray | None = None,
        against: CellArray | None = None,
    ) -> None:
        self._graph = graph
        self._docks = docks
        self._against = against
        self._blocked = np.zeros(graph.n_cells, dtype=np.bool_) if blocked is None else blocked
        self.costs: IntArray = np.ones(graph.n_cells, dtype=np.int64)
        """What it costs to pass each cell, in moves, shape (n_cells,)."""
        self.costs[list(docks)] = DOCK_COST
        self.exact = DistanceTable(graph, self._blocked, memory_kept=KEPT_BYTES)
        """As far as it is."""
        self.around = self.ways() if len(docks) or against is not None else self.exact
        """What ways cost."""

    def ways(self) -> DistanceTable:
        """What ways cost, in a table of the caller's own."""
        surcharges = None if self._against is None else _surcharges(self._graph, self._against)
        return DistanceTable(
            self._graph, self._blocked, memory_kept=KEPT_BYTES, costs=self.costs, surcharges=surcharges
        )

    def past(self, blocked: BoolArray, graph: LaneGraph) -> FloorDistances:
        """Those past other blocked cells, on the same lanes or others of the same states; without any, these."""
        same = graph is self._graph and not blocked.any()
        return self if same else FloorDistances(graph, self._docks, blocked, self._against)


def _surcharges(graph: LaneGraph, against: CellArray) -> IntArray:
    """What each move costs beyond the usual.

    A lane against a street costs where it is left: whoever chooses the move that leaves least to go, as planners of
    one timestep do, would not see what it costs to enter it.
    """
    leads_against = np.zeros(graph.n_states, dtype=np.int64)
    leads_against[against] = AGAINST_COST
    return np.where(graph.move_kind == REVERSE, BACKWARDS_COST, leads_against[graph.move_from])
