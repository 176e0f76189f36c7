"""Stagnation: for how long agents have come no nearer to their goals."""

from __future__ import annotations

import numpy as np

from planners.mapf.arrays import BoolArray, IntArray

_NEVER = 2**30


class Stagnation:
    """Since when each agent has not been nearer to its goal than ever before.

    Args:
        n: Number of agents.
    """

    def __init__(self, n: int) -> None:
        self._goals = np.full(n, -1, dtype=np.int32)
        self._least = np.full(n, _NEVER, dtype=np.int32)
        self._waited: IntArray = np.zeros(n, dtype=np.int32)

    def __len__(self) -> int:
        """Number of agents."""
        return len(self._goals)

    def look(self, left: IntArray, goals: IntArray, *, excused: BoolArray | None = None) -> IntArray:
        """Look once more.

        Args:
            left: What is left to each agent's goal, shape (n,).
            goals: The goals; an agent that has got another one begins anew, shape (n,).
            excused: Agents that begin anew all the same, shape (n,); None = nobody.

        Returns:
            Looks since each agent was last nearer than before, shape (n,); holds until the next call.
        """
        nearer = (goals != self._goals) | (left < self._least)
        if excused is not None:
            nearer |= excused
        self._waited[:] = np.where(nearer, 0, self._waited + 1)
        self._least[:] = np.where(nearer, left, self._least)
        self._goals[:] = goals
        return self._waited
