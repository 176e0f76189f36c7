"""AgentSlots: a `VecEnv` as a vector environment of gymnasium, in which every agent is an environment of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Dict, Discrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from fleet.config import require
from fleet.envs.vector.vec_env import AgentGroup, VecEnv, VecView

Told = npt.NDArray[np.float32] | dict[str, npt.NDArray[Any]]
"""Observations of all slots; with their `action_mask` where there are masks."""


class AgentSlots(VectorEnv[Any, Any, Any]):
    """All agents of one type, in all environments, as slots that share a policy: slot `i * n + k` is agent `k` of
    environment `i`.

    Slots of one environment begin and end their episodes together. The next episode begins in the same step
    (`AutoresetMode.SAME_STEP`); `infos["final_obs"]` holds what each slot saw at the end of its own, None for others.

    Args:
        vec: The environments; they are closed with the slots.
        kind: Type of the agents that are slots, `car` of `car_0`; agents of other types do nothing.

    Raises:
        ConfigError: No agent is of that type.
    """

    def __init__(self, vec: VecEnv, kind: str = "car") -> None:
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.vec = vec
        """The environments."""
        self._group = group_named(vec, kind)
        self.num_envs = vec.n_envs * self._group.n
        action = self._group.action
        # Spaces of their own: seeding one must not seed another.
        row = Box(self._group.observation.low, self._group.observation.high, dtype=np.float32)
        self.single_observation_space = (
            Dict({"observation": row, "action_mask": Box(0, 1, (int(action.n),), np.int8)})
            if self._group.masked and isinstance(action, Discrete)
            else row
        )
        self.single_action_space = (
            Discrete(int(action.n)) if isinstance(action, Discrete) else Box(action.low, action.high, dtype=np.float32)
        )
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Told, dict[str, Any]]:
        """Begin an episode in every environment; environment `i` with the seed `seed + i`.

        Raises:
            ConfigError: The seed is no integer >= 0.
        """
        del options
        return self._told(self.vec.reset(seed)), {}

    def step(
        self, actions: npt.ArrayLike
    ) -> tuple[Told, npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Let all slots act; see `VecEnv.step`.

        Args:
            actions: Shape (num_envs,) or (num_envs, n_entries).

        Raises:
            EpisodeError: There was no `reset` yet, or the slots are closed.
            ActionError: The array has the wrong shape or kind.
        """
        group, n_envs = self._group, self.vec.n_envs
        given = np.asarray(actions)
        fits = given.ndim > 0 and len(given) == self.num_envs
        shaped = given.reshape(n_envs, group.n, *given.shape[1:]) if fits else given
        step = self.vec.step({group.name: shaped})
        infos: dict[str, Any] = {name: array.ravel().copy() for name, array in step.infos[group.name].items()}
        everybody = np.ones(self.num_envs, dtype=np.bool_)
        infos |= {f"_{name}": everybody for name in infos}
        if step.final is not None:
            ended = step.ended.repeat(group.n)
            final, last = np.full(self.num_envs, None, dtype=object), self._told(step.final)
            for slot in np.flatnonzero(ended).tolist():
                final[slot] = {key: rows[slot] for key, rows in last.items()} if isinstance(last, dict) else last[slot]
            infos |= {"final_obs": final, "_final_obs": ended}
        rewards = step.rewards[group.name].ravel().copy()
        return self._told(step), rewards, step.terminated.repeat(group.n), step.truncated.repeat(group.n), infos

    def close_extras(self, **kwargs: Any) -> None:
        """See `VectorEnv`."""
        del kwargs
        self.vec.close()

    def _told(self, view: VecView) -> Told:
        """Copies, one row per slot."""
        name = self._group.name
        rows = view.observations[name].reshape(self.num_envs, -1).copy()
        if not self._group.masked:
            return rows
        return {"observation": rows, "action_mask": view.masks[name].reshape(self.num_envs, -1).copy()}


def group_named(vec: VecEnv, kind: str) -> AgentGroup:
    """The agents of a type.

    Raises:
        ConfigError: No agent is of that type.
    """
    groups = {group.name: group for group in vec.groups}
    require(kind in groups, "kind", kind, ", ".join(groups))
    return groups[kind]
