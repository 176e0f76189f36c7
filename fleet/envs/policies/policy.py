"""Policy: decides for all agents of an environment; and the one that knows nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Discrete


class Policy(Protocol):
    """Plays an environment."""

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """Actions of all agents that observe.

        Args:
            env: The environment that is played, not wrapped; a policy may look behind what agents see.
            observations: By agent.
        """


class Weighing(Protocol):
    """A policy that says what it thinks of what it did not do."""

    @property
    def worths(self) -> Mapping[str, npt.NDArray[np.float32]]:
        """What each action of an agent was worth in the latest `act`, more is better, shape (n_actions,); of the agents
        that had a choice, by name."""


class Random:
    """Any legal action, all alike.

    Args:
        seed: Source of chance.
    """

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        actions: dict[str, Any] = {}
        for agent, seen in observations.items():
            space = env.action_space(agent)
            if isinstance(space, Discrete):
                actions[agent] = int(self._rng.choice(np.flatnonzero(seen["action_mask"])))
            else:
                actions[agent] = self._rng.uniform(space.low, space.high).astype(np.float32)
        return actions
