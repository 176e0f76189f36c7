"""Generalised advantage estimation over arrays of steps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]


def advantages(
    rewards: Floats, values: Floats, after: Floats, ended: npt.NDArray[np.bool_], *, discount: float, gae: float
) -> Floats:
    """Advantages of the actions taken, one column per agent.

    Args:
        rewards: Shape (T, n).
        values: Value of the state each action was taken in, shape (T, n).
        after: Value of the state it led to, shape (T, n): zero where the episode terminated, that of the last state
            where it was truncated.
        ended: Whether the episode ended with the step, shape (T, n).
        discount: gamma.
        gae: lambda.

    Returns:
        Shape (T, n); plus `values` these are the targets of the value function.

    Source: J. Schulman et al., "High-Dimensional Continuous Control Using Generalized Advantage Estimation",
    arXiv:1506.02438, eq. (16); truncation: F. Pardo et al., "Time Limits in Reinforcement Learning", ICML 2018.
    """
    found = np.zeros_like(rewards)
    running = np.zeros(rewards.shape[1], dtype=np.float32)
    for t in range(len(rewards) - 1, -1, -1):
        error = rewards[t] + discount * after[t] - values[t]
        running = error + discount * gae * np.where(ended[t], 0.0, running)
        found[t] = running
    return found
