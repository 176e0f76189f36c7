"""SoloEnv: a gymnasium environment as a team of one agent."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any, Self

import gymnasium
from pettingzoo.utils import ParallelEnv

from fleet.envs.core.base import ActionError
from fleet.envs.core.env_config import UnknownSetting
from maps.reading.shown import named


class SoloEnv(ParallelEnv[str, Any, Any]):
    """A single robot's environment in the form of all others.

    Args:
        env: The environment.
        agent: Name of its only agent, `<type>_0`.
        name: Of the environment, with its version: `kuka_reach_v0`.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], agent: str, name: str) -> None:
        self.env = env
        self.metadata = {**env.metadata, "name": name}
        self.render_mode = env.render_mode
        self.possible_agents = [agent]
        self.agents: list[str] = []

    @classmethod
    def of(
        cls, kind: Callable[..., gymnasium.Env[Any, Any]], agent: str, name: str, settings: Mapping[str, Any]
    ) -> Self:
        """Make a single robot's environment.

        Args:
            kind: Its class.
            agent: See `SoloEnv`.
            name: See `SoloEnv`.
            settings: Of the environment, by name.

        Raises:
            UnknownSetting: A name is that of no setting.
            ConfigError: A setting is outside its valid range.
        """
        valid = list(inspect.signature(kind).parameters)
        for setting in settings:
            if setting not in valid:
                raise UnknownSetting(f"{name}: unknown setting {named(setting)}; valid: {', '.join(valid)}")
        return cls(kind(**settings), agent, name)

    def observation_space(self, agent: str) -> gymnasium.Space[Any]:
        """See `ParallelEnv`."""
        del agent
        return self.env.observation_space

    def action_space(self, agent: str) -> gymnasium.Space[Any]:
        """See `ParallelEnv`."""
        del agent
        return self.env.action_space

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """See `ParallelEnv`."""
        observation, info = self.env.reset(seed=seed, options=options)
        self.agents = self.possible_agents[:]
        agent = self.agents[0]
        return {agent: observation}, {agent: info}

    def step(self, actions: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
        """See `ParallelEnv`.

        Raises:
            ActionError: There is no action of the agent.
        """
        agent = self.possible_agents[0]
        if agent not in actions:
            told = ", ".join(map(str, actions)) or "nothing"
            raise ActionError(f"actions: of {told}, and not of {agent}; valid: one of {agent}")
        observation, reward, terminated, truncated, info = self.env.step(actions[agent])
        if terminated or truncated:
            self.agents = []
        return {agent: observation}, {agent: reward}, {agent: terminated}, {agent: truncated}, {agent: info}

    def close(self) -> None:
        """See `ParallelEnv`."""
        self.env.close()
