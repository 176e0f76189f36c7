"""CrowdCosts: what it costs more to be where many are, so that crowds grow no denser than they flow."""

from __future__ import annotations

import numpy as np

from maps.grid import GridMap
from planners.mapf.arrays import BoolArray, IntArray
from planners.mapf.kernel import Int, kernel


class CrowdCosts:
    """Costs of all cells: nothing where there is room, up to the most where every free cell around is taken.

    Of ways that cost the same, the one with more room is taken. A crowd is entered later and left sooner, as its robots
    gain more by a move that leads out of it.

    Args:
        grid: The floor.
        most: Cost of a cell in the midst of a crowd.
        reach: Cells to each side that count as around a cell.
        roomy: Share of the free cells around that may be taken at no cost, < 1.
    """

    def __init__(self, grid: GridMap, most: int, *, reach: int = 3, roomy: float = 0.4) -> None:
        self._most, self._reach, self._roomy = most, reach, roomy
        rows, cols = grid.free.shape
        self._taken = np.zeros((rows, cols), dtype=np.bool_)
        self._sums = np.zeros((rows + 1, cols + 1), dtype=np.int32)
        self._room = np.empty((rows, cols), dtype=np.int32)
        self._n_taken = np.empty_like(self._room)
        self._costs = np.zeros((rows, cols), dtype=np.int32)
        _count_around(grid.free, reach, self._sums, self._room)

    def of(self, cells: IntArray) -> IntArray:
        """Costs while agents stand in `cells`, shape (n,); the array, shape (n_cells,), holds until the next call."""
        self._taken[:] = False
        self._taken.ravel()[cells] = True
        _count_around(self._taken, self._reach, self._sums, self._n_taken)
        _weigh(self._n_taken, self._room, self._most, self._roomy, self._costs)
        return self._costs.ravel()


@kernel
def _count_around(marked: BoolArray, reach: Int, sums: IntArray, out: IntArray) -> None:  # pragma: no cover - compiled
    """Marked cells in the square around each cell, by sums over all rectangles that begin in the first cell."""
    rows, cols = marked.shape
    for row in range(rows):
        in_row = 0
        for col in range(cols):
            in_row += marked[row, col]
            sums[row + 1, col + 1] = sums[row, col + 1] + in_row
    for row in range(rows):
        top, bottom = max(row - reach, 0), min(row + reach + 1, rows)
        for col in range(cols):
            left, right = max(col - reach, 0), min(col + reach + 1, cols)
            out[row, col] = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]


@kernel
def _weigh(
    taken: IntArray, room: IntArray, most: Int, roomy: float, costs: IntArray
) -> None:  # pragma: no cover - compiled
    for row in range(taken.shape[0]):
        for col in range(taken.shape[1]):
            share = taken[row, col] / max(room[row, col], 1)
            costs[row, col] = np.int32(most * max(share - roomy, 0.0) / (1.0 - roomy) + 0.5)
