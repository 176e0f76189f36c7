"""LoopVec: a `VecEnv` of environments that have no kernel of their own: their dictionaries, put into arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Discrete

from fleet.envs.vector.vec_env import AgentGroup, Arrays, VecEnv, VecStep, VecView


class LoopVec(VecEnv):
    """Steps one environment after the other.

    Args:
        envs: Environments of the same agents and settings; they are closed with the vector.
    """

    def __init__(self, envs: Sequence[Any]) -> None:
        super().__init__(envs[0], len(envs))
        self.envs = list(envs)
        self._seen = self._blank()

    def state(self) -> npt.NDArray[np.float32]:
        """See `VecEnv`."""
        return np.stack([env.state() for env in self.envs])

    def close(self) -> None:
        """See `VecEnv`."""
        super().close()
        for env in self.envs:
            env.close()

    def _reset(self, seeds: list[int]) -> VecView:
        if not seeds and not self._under_way:
            # Environments of the same settings have the same series; these are to differ.
            seeds = [self.single.config.seed + index for index in range(self.n_envs)]
        for index, env in enumerate(self.envs):
            self._put(index, env.reset(seed=seeds[index] if seeds else None)[0], self._seen)
        return self._seen

    def _restart(self, indices: Sequence[int]) -> VecView:
        for index in indices:
            self._put(index, self.envs[index].reset()[0], self._seen)
        return self._seen

    def _step(self, actions: Arrays) -> VecStep:
        rewards = {group.name: np.zeros((self.n_envs, group.n)) for group in self.groups}
        terminated, truncated = np.zeros((2, self.n_envs), dtype=np.bool_)
        final: VecView | None = None
        final_state: npt.NDArray[np.float32] | None = None
        told: list[dict[str, dict[str, Any]]] = []
        for index, env in enumerate(self.envs):
            seen, got, terminations, truncations, infos = env.step(self._chosen(index, actions))
            for group in self.groups:
                rewards[group.name][index] = [got[agent] for agent in group.agents]
            told.append(infos)
            if not env.agents:
                terminated[index] = any(terminations.values())
                truncated[index] = not terminated[index] and any(truncations.values())
                final = final or self._blank()
                self._put(index, seen, final)
                if hasattr(env, "state_space"):
                    if final_state is None:
                        final_state = np.zeros((self.n_envs, *env.state_space.shape), dtype=np.float32)
                    final_state[index] = env.state()
                seen = env.reset()[0]
            self._put(index, seen, self._seen)
        return VecStep(
            observations=self._seen.observations,
            masks=self._seen.masks,
            rewards=rewards,
            terminated=terminated,
            truncated=truncated,
            final=final,
            final_state=final_state,
            infos={group.name: _stacked(group, told) for group in self.groups},
        )

    def _chosen(self, index: int, actions: Arrays) -> dict[str, Any]:
        """Actions of one environment, by agent."""
        chosen: dict[str, Any] = {}
        for group in self.groups:
            if group.name in actions:
                rows = actions[group.name][index]
                chosen.update(zip(group.agents, rows.tolist() if rows.ndim == 1 else rows, strict=True))
        return chosen

    def _blank(self) -> VecView:
        n = self.n_envs
        return VecView(
            observations={
                group.name: np.zeros((n, group.n, *group.observation.shape), dtype=np.float32) for group in self.groups
            },
            masks={
                group.name: np.zeros((n, group.n, int(group.action.n)), dtype=np.int8)
                for group in self.groups
                if group.masked and isinstance(group.action, Discrete)
            },
        )

    def _put(self, index: int, seen: Mapping[str, Any], view: VecView) -> None:
        for group in self.groups:
            rows = view.observations[group.name][index]
            for row, agent in zip(rows, group.agents, strict=True):
                row[:] = seen[agent]["observation"] if group.masked else seen[agent]
            if group.masked:
                view.masks[group.name][index] = [seen[agent]["action_mask"] for agent in group.agents]


def _stacked(group: AgentGroup, told: Sequence[Mapping[str, Mapping[str, Any]]]) -> Arrays:
    """What infos say in numbers or flags, by name, shape (B, n)."""
    first = told[0][group.agents[0]]
    names = [name for name, value in first.items() if isinstance(value, bool | int | float | np.number | np.bool_)]
    return {name: np.array([[infos[agent][name] for agent in group.agents] for infos in told]) for name in names}
