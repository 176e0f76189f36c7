"""Nearest place: the first of some states that a car comes to, found from where it stands.

Where many places are free, a search from the car ends after a few cells; distances to each of the places would take a
search of the whole floor and a row of memory for every one of them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from maps.lane_graph import LaneGraph
from planners.mapf.options import open_moves

NOWHERE = -1


class PlaceSearch:
    """Searches on lanes with some cells blocked.

    Args:
        graph: The lanes.
        blocked: Cells nobody may enter, shape (n_cells,).
    """

    def __init__(self, graph: LaneGraph, blocked: npt.NDArray[np.bool_]) -> None:
        self._graph = graph
        self._is_open = open_moves(graph, blocked)
        self._queue = np.empty(graph.n_states, dtype=np.int64)

    def nearest(self, state: int, wanted: npt.NDArray[np.bool_]) -> int:
        """The wanted state with the fewest moves, of equally near ones the smallest; `NOWHERE` if there is no way.

        Args:
            state: Where the car stands; it may be wanted itself.
            wanted: Which states are, shape (n_states,) or longer.
        """
        graph = self._graph
        return int(_nearest(graph.out_ptr, graph.out_move, graph.move_to, self._is_open, wanted, state, self._queue))


@njit(cache=True)
def _nearest(
    out_ptr: npt.NDArray[np.integer],
    out_move: npt.NDArray[np.integer],
    move_to: npt.NDArray[np.integer],
    is_open: npt.NDArray[np.bool_],
    wanted: npt.NDArray[np.bool_],
    state: int,
    queue: npt.NDArray[np.int64],
) -> int:  # pragma: no cover - compiled
    """Breadth first, level by level."""
    seen = np.zeros(len(queue), dtype=np.bool_)
    seen[state] = True
    queue[0] = state
    begin, end = 0, 1
    while begin < end:
        best = NOWHERE
        for k in range(begin, end):
            if wanted[queue[k]] and (best == NOWHERE or queue[k] < best):
                best = queue[k]
        if best != NOWHERE:
            return best
        n = end
        for k in range(begin, end):
            for out in range(out_ptr[queue[k]], out_ptr[queue[k] + 1]):
                move = out_move[out]
                after = move_to[move]
                if is_open[move] and not seen[after]:
                    seen[after] = True
                    queue[n] = after
                    n += 1
        begin, end = end, n
    return NOWHERE
