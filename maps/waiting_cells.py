"""Cells of lanes in which vehicles may wait when every parking place is taken."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from maps.site import Site


def waiting_cells(site: Site, graph: LaneGraph) -> npt.NDArray[np.intp]:
    """Cells that nobody drives through to enter or leave a bay, and that are driven one way only, ascending.

    Args:
        site: The site.
        graph: Its lane graph.
    """
    may_wait = np.zeros(graph.n_cells, dtype=np.bool_)
    may_wait[graph.state_cell] = True
    is_bay = np.zeros(graph.n_cells, dtype=np.bool_)
    is_bay[list(site.bays().values())] = True
    of_bay = is_bay[graph.state_cell[graph.move_from]] | is_bay[graph.state_cell[graph.move_to]]
    may_wait[graph.swept_cell[np.repeat(of_bay, np.diff(graph.swept_ptr))]] = False
    start, end = site.lanes.astype(np.int64).T
    # A dead end, and what leads to it, is driven both ways: whoever waited there would have to reverse out of it.
    both_ways = np.isin(start * graph.n_cells + end, end * graph.n_cells + start)
    may_wait[site.lanes[both_ways]] = False
    return np.flatnonzero(may_wait)
