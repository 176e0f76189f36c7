"""FloorDistances: how far all is from where cars are sent, and how far on ways that go round docks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fleet.arrays import BoolArray
from maps.lane_graph import LaneGraph
from planners.mapf.distance_table import DistanceTable


class FloorDistances:
    """Distances past all that is blocked.

    Cars that only pass go round docks where there is a way: they would stand behind those that are served, and in the
    way of those that come next.

    Args:
        graph: Lane graph of the site.
        docks: Cells of the docks.
        blocked: Cells nobody may enter, shape (n_cells,); None = none.
    """

    def __init__(self, graph: LaneGraph, docks: Sequence[int], blocked: BoolArray | None = None) -> None:
        self._graph = graph
        self._docks = docks
        is_blocked = np.zeros(graph.n_cells, dtype=np.bool_) if blocked is None else blocked
        is_dock = np.zeros(graph.n_cells, dtype=np.bool_)
        is_dock[list(docks)] = True
        self.exact = DistanceTable(graph, is_blocked)
        """As far as it is."""
        self.around = DistanceTable(graph, is_blocked, avoid=is_dock) if len(docks) else self.exact
        """As plans are made; see `DistanceTable` for what counts more than it is away."""

    def past(self, blocked: BoolArray) -> FloorDistances:
        """Those past other blocked cells; of a floor without any, these."""
        return FloorDistances(self._graph, self._docks, blocked) if blocked.any() else self
