"""Crowding: where cars wait in the lanes, learnt while they do, and what it costs others to pass there."""

from __future__ import annotations

import math

import numpy as np

from fleet.arrays import FloatArray, IntArray

WAITS_AFTER_S = 2.0
"""A car that has not moved for so long waits [s]; one that only lets another one cross does not stand longer."""
FORGET_S = 30.0
"""Time in which two thirds of what was seen is forgotten [s]: a queue of ten cars is gone then."""
CROWDED_COST = 8.0
"""What a cell costs in which somebody always waits, in moves beyond the one that it takes."""
MOST_COST = 6
"""The most that waiting adds to the cost of a cell, in moves: queues are gone round, not the whole site."""


class Crowding:
    """Learns where cars wait.

    Where several ways are equally short, nearly all cars may take the last turn that leads to where they go, and stand
    there while the turns before are empty. So cells in which cars wait cost more, and those that come later turn
    before.

    Args:
        n_cells: Cells of the floor.
    """

    def __init__(self, n_cells: int) -> None:
        self._share: FloatArray = np.zeros(n_cells)
        self._seen_s = 0.0

    def see(self, cells: IntArray, now_s: float) -> None:
        """Learn where cars wait now, and have since it was last asked.

        Args:
            cells: Cell of each car that waits, shape (n,).
            now_s: Simulated time [s].
        """
        kept = math.exp((self._seen_s - now_s) / FORGET_S)
        self._seen_s = now_s
        self._share *= kept
        self._share[cells] += 1.0 - kept

    def costs(self) -> IntArray:
        """What passing each cell costs beyond a move, in moves, shape (n_cells,)."""
        costs: IntArray = np.minimum(MOST_COST, np.rint(CROWDED_COST * self._share)).astype(np.int64)
        return costs
