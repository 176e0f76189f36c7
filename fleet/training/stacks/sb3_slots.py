"""Stable-Baselines3: a `fleet.envs.vector` environment as a `VecEnv`, every agent of a type one of its slots.

Needs `stable-baselines3` (extra `sb3`). What `TypeVecEnv` does for dictionaries this does for arrays: steps take no
Python for each agent but that of the infos.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Discrete
from stable_baselines3.common.vec_env import VecEnv as SlotVecEnv

from fleet.envs.vector.agent_slots import group_named
from fleet.envs.vector.vec_env import VecEnv, VecView


class VectorSlots(SlotVecEnv):
    """All agents of one type, in all environments, share a policy; agents of other types do nothing.

    Discrete actions stay discrete; `env_method("action_masks")` tells which are legal, as the algorithms with masks of
    `sb3-contrib` ask for them. Others may choose what is illegal, which counts as 0.

    Args:
        vec: The environments; they are closed with the slots.
        kind: Type of the agents that learn, `car` of `car_0`.

    Raises:
        ConfigError: No agent is of that type.
    """

    def __init__(self, vec: VecEnv, kind: str = "car") -> None:
        self.vec = vec
        self._group = group_named(vec, kind)
        self._masks: npt.NDArray[np.bool_] | None = None
        self._actions: npt.NDArray[Any] | None = None
        row, action = self._group.observation, self._group.action
        super().__init__(
            vec.n_envs * self._group.n,
            Box(row.low, row.high, dtype=np.float32),
            Discrete(int(action.n)) if isinstance(action, Discrete) else Box(action.low, action.high, dtype=np.float32),
        )

    def reset(self) -> npt.NDArray[np.float32]:
        """Begin an episode in every environment; seeds that `seed` gave are used once."""
        seeds = self._seeds[:: self._group.n]
        view = self.vec.reset(None if None in seeds else [int(seed) for seed in seeds if seed is not None])
        self._reset_seeds()
        return self._seen(view)

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.bool_], list[Any]]:
        """Step every environment; one whose episode ends begins the next at once."""
        group, n_envs = self._group, self.vec.n_envs
        assert self._actions is not None
        step = self.vec.step({group.name: self._actions.reshape(n_envs, group.n, *self._actions.shape[1:])})
        names, columns = list(step.infos[group.name]), step.infos[group.name].values()
        told = zip(*(column.ravel().tolist() for column in columns), strict=True)
        infos: list[dict[str, Any]] = [dict(zip(names, own, strict=True)) for own in told]
        dones = step.ended.repeat(group.n)
        if step.final is not None:
            last = step.final.observations[group.name].reshape(self.num_envs, -1)
            for slot in np.flatnonzero(dones).tolist():
                infos[slot]["terminal_observation"] = last[slot].copy()
                infos[slot]["TimeLimit.truncated"] = bool(step.truncated[slot // group.n])
        return self._seen(step), step.rewards[group.name].ravel().astype(np.float32), dones, infos

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Legal actions of all slots, shape (num_envs, n_actions)."""
        assert self._masks is not None
        return self._masks

    def close(self) -> None:
        """Close all environments."""
        self.vec.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """See `VecEnv`; of masks there is one for each slot, all else is the same for all."""
        if attr_name == "action_masks" and self._group.masked:
            return [lambda slot=slot: self.action_masks()[slot] for slot in self._get_indices(indices)]
        return [getattr(self.vec.single, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """See `VecEnv`; slots have no attributes of their own."""
        raise AttributeError(f"{attr_name} cannot be set: slots share their environments")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """See `VecEnv`; slots have `action_masks` only."""
        if method_name != "action_masks":
            raise AttributeError(f"slots have no method {method_name}; valid: action_masks")
        return [self.action_masks()[slot] for slot in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """See `VecEnv`; nothing is."""
        del wrapper_class
        return [False for _ in self._get_indices(indices)]

    def _seen(self, view: VecView) -> npt.NDArray[np.float32]:
        name = self._group.name
        if self._group.masked:
            self._masks = view.masks[name].reshape(self.num_envs, -1) == 1
        return view.observations[name].reshape(self.num_envs, -1).copy()
