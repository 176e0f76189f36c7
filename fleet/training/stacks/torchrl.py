"""TorchRL: a `fleet.envs.vector` environment as an `EnvBase`.

Needs `torchrl` (extra `torchrl`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Discrete
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from fleet.envs.vector.agent_slots import group_named
from fleet.envs.vector.vec_env import VecEnv, VecView


class VectorEnvBase(EnvBase):
    """Agents of one type, in B environments, in TorchRL's form: batch size (B,), and a group of that type's name.

    Group entries are `observation`, `action_mask` where there are masks, `action`, `reward`; `done`, `terminated` and
    `truncated` are of the environment. Episodes end and begin as TorchRL asks: the next of an environment begins with
    the `reset` that follows its end. Agents of other types do nothing.

    Args:
        vec: The environments; they are closed with this one.
        kind: Type of the agents, `car` of `car_0`.

    Raises:
        ConfigError: No agent is of that type.
    """

    def __init__(self, vec: VecEnv, kind: str = "car") -> None:
        n_envs = vec.n_envs
        super().__init__(device=torch.device("cpu"), batch_size=torch.Size([n_envs]))
        self.vec = vec
        self._group = group = group_named(vec, kind)
        shape = (n_envs, group.n)
        row, action = group.observation, group.action
        seen: dict[str, Any] = {
            "observation": Bounded(
                low=torch.from_numpy(row.low).expand(*shape, -1),
                high=torch.from_numpy(row.high).expand(*shape, -1),
                shape=(*shape, *row.shape),
                dtype=torch.float32,
            )
        }
        chosen: Any
        if isinstance(action, Discrete):
            if group.masked:
                seen["action_mask"] = Binary(n=int(action.n), shape=(*shape, int(action.n)), dtype=torch.bool)
            chosen = Categorical(n=int(action.n), shape=shape, dtype=torch.int64)
        else:
            chosen = Bounded(
                low=torch.from_numpy(action.low).expand(*shape, -1),
                high=torch.from_numpy(action.high).expand(*shape, -1),
                shape=(*shape, *action.shape),
                dtype=torch.float32,
            )
        name = group.name
        self.observation_spec = Composite({name: Composite(seen, shape=shape)}, shape=(n_envs,))
        self.action_spec = Composite({name: Composite({"action": chosen}, shape=shape)}, shape=(n_envs,))
        reward = Composite({"reward": Unbounded(shape=(*shape, 1), dtype=torch.float32)}, shape=shape)
        self.reward_spec = Composite({name: reward}, shape=(n_envs,))
        flag = Binary(n=1, shape=(n_envs, 1), dtype=torch.bool)
        self.done_spec = Composite({key: flag.clone() for key in ("done", "terminated", "truncated")}, shape=(n_envs,))
        self._began = np.zeros(n_envs, dtype=np.bool_)
        """Environments whose next episode has begun already, and which TorchRL has not asked for it."""
        self._next_seed: int | None = None
        self._view: VecView | None = None

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        del kwargs
        asked = tensordict.get("_reset", None) if tensordict is not None else None
        if asked is None or self._view is None:
            self._view = self.vec.reset(self._next_seed)
            self._next_seed = None
        else:
            wanted = asked.reshape(self.vec.n_envs, -1).any(dim=1).numpy()
            early = np.flatnonzero(wanted & ~self._began)
            if len(early):
                self._view = self.vec.restart(early.tolist())
        self._began[:] = False
        return self._told(self._view)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        group = self._group
        step = self.vec.step({group.name: tensordict.get((group.name, "action")).numpy()})
        told = self._told(step)
        if step.final is not None:
            # The last of an episode; the first of the next, which has begun, is told at the reset.
            ended = torch.from_numpy(step.ended)
            last = self._told(step.final)
            told = torch.where(ended, last, told)
        self._view, self._began = step, step.ended
        rewards = torch.from_numpy(step.rewards[group.name].astype(np.float32)).unsqueeze(-1)
        told.set((group.name, "reward"), rewards)
        for key, flags in (("done", step.ended), ("terminated", step.terminated), ("truncated", step.truncated)):
            told.set(key, torch.from_numpy(flags.copy()).unsqueeze(-1))
        return told

    def _set_seed(self, seed: int | None) -> None:
        self._next_seed = seed

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Close all environments."""
        self.vec.close()
        super().close(raise_if_closed=raise_if_closed)

    def _told(self, view: VecView) -> TensorDictBase:
        """Copies of what agents see."""
        name, shape = self._group.name, (self.vec.n_envs, self._group.n)
        seen = {"observation": torch.from_numpy(view.observations[name].copy())}
        if self._group.masked:
            seen["action_mask"] = torch.from_numpy(view.masks[name] == 1)
        return TensorDict({name: TensorDict(seen, batch_size=shape)}, batch_size=(self.vec.n_envs,))
