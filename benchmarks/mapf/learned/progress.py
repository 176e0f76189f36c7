"""Progress: for how long agents have come no nearer to their goals."""

from __future__ import annotations

import numpy as np

from planners.mapf.arrays import IntArray

_NEVER = 2**30


class Progress:
    """Since when each agent has not been nearer to its goal than ever before.

    Args:
        n: Number of agents.
    """

    def __init__(self, n: int) -> None:
        self._goal = np.full(n, -1, dtype=np.int32)
        self._least = np.full(n, _NEVER, dtype=np.int32)
        self.waited: IntArray = np.zeros(n, dtype=np.int32)
        """Timesteps, shape (n,)."""

    def look(self, left: IntArray, goals: IntArray) -> IntArray:
        """Count a timestep.

        Args:
            left: What is left to each agent's goal, shape (n,).
            goals: The goals; an agent that has got another one begins anew, shape (n,).

        Returns:
            `waited`.
        """
        least = np.where(goals == self._goal, self._least, _NEVER)
        nearer = left < least
        self.waited[:] = np.where(nearer, 0, self.waited + 1)
        self._least[:] = np.minimum(left, least)
        self._goal[:] = goals
        return self.waited
