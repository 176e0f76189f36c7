"""Policies: what plays an environment, and the one that knows nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from fleet.training.batch import vector


class Policy(Protocol):
    """Decides for all agents of an environment."""

    def act(self, env: Any, observations: dict[str, Any]) -> Mapping[str, Any]:
        """Actions of all agents that observe.

        Args:
            env: The environment that is played; a policy may look behind what agents see.
            observations: By agent.
        """


class RandomPolicy:
    """Any legal action.

    Args:
        seed: Source of chance.
    """

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def act(self, env: Any, observations: dict[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        actions: dict[str, Any] = {}
        for agent, seen in observations.items():
            space = env.action_space(agent)
            if isinstance(space, Box):
                actions[agent] = self._rng.uniform(space.low, space.high).astype(space.dtype)
            elif isinstance(seen, Mapping):
                actions[agent] = int(self._rng.choice(np.flatnonzero(seen["action_mask"])))
            else:
                actions[agent] = int(self._rng.integers(space.n))
        return actions


class RowPolicy:
    """A function from rows of observations to rows of actions, for teams of one type.

    Args:
        actions: Takes shape (n, observation_n), gives one row per agent.
    """

    def __init__(self, actions: Callable[[npt.NDArray[np.float32]], npt.NDArray[Any]]) -> None:
        self._actions = actions

    def act(self, env: Any, observations: dict[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del env
        rows = np.stack([vector(seen) for seen in observations.values()])
        return dict(zip(observations, self._actions(rows), strict=True))
