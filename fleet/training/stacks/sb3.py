"""Stable-Baselines3: the agents of one type as a `VecEnv`, the others scripted or as they were trained.

Needs `stable-baselines3`, and `sb3-contrib` for its `MaskablePPO`, which heeds masks (extra `sb3`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Discrete
from stable_baselines3.common.vec_env import VecEnv

from fleet.config import require
from fleet.envs.policies.policy import Policy
from fleet.training.batch import agent_types, team_of, type_of, vector
from fleet.training.errors import TrainingError

_MASKS = "action_masks"


class TypeVecEnv(VecEnv):
    """Every agent of one type, in every environment, is one of the vector's slots: they share a policy.

    Discrete actions stay discrete. Which of them are legal is what `action_masks` says, slot by slot, as `MaskablePPO`
    of sb3-contrib asks for it; an algorithm that does not ask chooses illegal ones too, which the environment takes
    for none.

    The slot of an agent that is not there, because the team is smaller or it left early, sees zeros, earns nothing and
    may choose action 0 only, until the episode ends.

    Args:
        makers: Make the parallel environments, all alike.
        kind: Type of the agents that learn, `car` of `car_0`.
        others: Decides for the agents of other types; None if there are none, or if they should do nothing.

    Raises:
        ConfigError: No agent is of that type.
        TrainingError: A space is of a kind that cannot be learned on.
    """

    def __init__(self, makers: Sequence[Callable[[], Any]], kind: str = "car", others: Policy | None = None) -> None:
        self.envs = [make() for make in makers]
        types = {one.name: one for one in agent_types(self.envs[0])}
        require(kind in types, "kind", kind, ", ".join(types))
        self._kind = types[kind]
        self._agents = team_of(self.envs[0])[kind]
        self._others = others
        self._observations: list[dict[str, Any]] = [{} for _ in self.envs]
        self._actions: npt.NDArray[Any] | None = None
        observation = Box(-1.0, 1.0, (self._kind.n_observed,), np.float32)
        super().__init__(len(self.envs) * len(self._agents), observation, self._kind.action)

    def reset(self) -> npt.NDArray[np.float32]:
        """Begin an episode in every environment; seeds that `seed` gave are used once."""
        for index, env in enumerate(self.envs):
            self._observations[index] = env.reset(seed=self._seeds[index * len(self._agents)])[0]
        self._reset_seeds()
        return self._rows()

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.bool_], list[Any]]:
        """Step every environment; one whose episode ends begins the next at once."""
        n = len(self._agents)
        rewards = np.zeros(self.num_envs, dtype=np.float32)
        dones = np.zeros(self.num_envs, dtype=np.bool_)
        told: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        assert self._actions is not None
        for index, env in enumerate(self.envs):
            slots = slice(index * n, (index + 1) * n)
            observations, got, _, truncations, infos = env.step(self._decided(index, self._actions[slots]))
            for slot, agent in enumerate(self._agents, start=index * n):
                rewards[slot], told[slot] = got.get(agent, 0.0), dict(infos.get(agent, {}))
                dones[slot] = not env.agents or (agent in observations and agent not in env.agents)
                if dones[slot]:
                    told[slot]["terminal_observation"] = self._row(observations, agent)
                    told[slot]["TimeLimit.truncated"] = bool(truncations.get(agent, False))
            self._observations[index] = (
                {agent: observations[agent] for agent in env.agents} if env.agents else env.reset()[0]
            )
        return self._rows(), rewards, dones, told

    def close(self) -> None:
        """Close all environments."""
        for env in self.envs:
            env.close()

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Legal actions of every slot, shape (num_envs, n_actions).

        Raises:
            TrainingError: Actions are continuous.
        """
        if not isinstance(self._kind.action, Discrete):
            raise TrainingError(f"actions of {self._kind.name} are {self._kind.action}; valid with masks: Discrete")
        if not self._kind.masked:
            return np.ones((self.num_envs, int(self._kind.action.n)), dtype=np.bool_)
        masks = np.zeros((self.num_envs, int(self._kind.action.n)), dtype=np.bool_)
        masks[:, 0] = True
        slots = ((seen, agent) for seen in self._observations for agent in self._agents)
        for mask, (seen, agent) in zip(masks, slots, strict=True):
            if agent in seen:
                mask[:] = seen[agent]["action_mask"] == 1
        return masks

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """See `VecEnv`; `action_masks` is one of this class, for every slot."""
        if attr_name == _MASKS:
            masks = self.action_masks()
            return [partial(masks.__getitem__, slot) for slot in self._get_indices(indices)]
        return [getattr(env, attr_name) for env in self._of(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """See `VecEnv`."""
        for env in self._of(indices):
            setattr(env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """See `VecEnv`; `action_masks` is one of this class, for every slot."""
        if method_name == _MASKS:
            return list(self.action_masks()[list(self._get_indices(indices))])
        return [getattr(env, method_name)(*args, **kwargs) for env in self._of(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """See `VecEnv`; nothing is."""
        del wrapper_class
        return [False for _ in self._of(indices)]

    def _of(self, indices: Any) -> list[Any]:
        """The environment of each slot."""
        return [self.envs[slot // len(self._agents)] for slot in self._get_indices(indices)]

    def _decided(self, index: int, rows: npt.NDArray[Any]) -> dict[str, Any]:
        """Actions of all agents of an environment."""
        seen = self._observations[index]
        rest = {agent: what for agent, what in seen.items() if type_of(agent) != self._kind.name}
        actions = dict(self._others.act(self.envs[index], rest)) if rest and self._others is not None else {}
        for agent, row in zip(self._agents, rows, strict=True):
            if agent in seen:
                actions[agent] = int(row) if isinstance(self._kind.action, Discrete) else row
        return actions

    def _rows(self) -> npt.NDArray[np.float32]:
        return np.stack([self._row(seen, agent) for seen in self._observations for agent in self._agents])

    def _row(self, seen: Mapping[str, Any], agent: str) -> npt.NDArray[np.float32]:
        """What an agent sees as a row of its own."""
        return vector(seen[agent]).copy() if agent in seen else np.zeros(self._kind.n_observed, dtype=np.float32)
