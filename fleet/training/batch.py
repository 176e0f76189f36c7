"""EnvBatch: several environments stepped side by side in one process, with one array of observations per type."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Dict, Discrete, Space

from fleet.training.errors import TrainingError

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]


def type_of(agent: str) -> str:
    """Type of an agent: `car` of `car_3`."""
    return agent.rpartition("_")[0]


@dataclass(frozen=True, kw_only=True)
class ChoiceLayout:
    """How an observation is made up of which one among alike things is chosen: action 0 is none, k the k-th of them.

    None is chosen only where nothing is on offer: to wait costs nothing at once, which is easily mistaken for good.
    """

    n_own: int
    """Numbers that come first and are not about one of them."""
    n_each: int
    """Numbers about each; zeros are a thing that is not there. What follows is about none of them again."""


@dataclass(frozen=True, kw_only=True)
class AgentType:
    """Agents that share a network: all see and do the same kind of thing."""

    name: str
    agents: tuple[str, ...]
    n_observed: int
    action: Box | Discrete
    masked: bool
    """Whether observations carry an `action_mask`."""
    choice: ChoiceLayout | None = None
    """Set if actions are a choice among things that observations describe one after the other."""


@dataclass(kw_only=True)
class TypeView:
    """What the agents of one type see now, one row per agent, environment after environment."""

    rows: Floats
    """Observations, shape (n_envs * n_agents, n_observed)."""
    mask: Bools | None
    """Legal actions, shape (n_envs * n_agents, n_actions); None without masks."""

    def copy(self) -> TypeView:
        """A copy that later steps do not change."""
        return TypeView(rows=self.rows.copy(), mask=None if self.mask is None else self.mask.copy())


@dataclass(frozen=True, kw_only=True)
class EpisodeFigures:
    """Figures of a whole episode."""

    length: int
    returns: dict[str, float]
    """Mean return of an agent, by type."""
    figures: dict[str, float]
    """Sums over the team of what `infos` said, by name."""


@dataclass(kw_only=True)
class BatchStep:
    """What one step of all environments brought."""

    rewards: dict[str, Floats]
    """By type, shape (n_envs * n_agents,)."""
    ended: Bools
    """Environments whose episode ended, shape (n_envs,)."""
    truncated: Bools
    """Those of them that ran out of time, shape (n_envs,)."""
    last: dict[str, TypeView]
    """What agents saw at the end of truncated episodes, by type; other rows mean nothing. Empty if there is none."""
    episodes: list[EpisodeFigures] = field(default_factory=list)


class EnvBatch:
    """Steps several environments.

    Args:
        envs: Environments of the same agents; they are closed with the batch.
        figures: Names in `infos` whose sums over an episode are wanted.
        choice: How observations with a mask are made up, if they are.

    Raises:
        TrainingError: A space is of a kind that cannot be learned on.
    """

    def __init__(self, envs: Sequence[Any], figures: Sequence[str] = (), choice: ChoiceLayout | None = None) -> None:
        self._envs = list(envs)
        self._figures = tuple(figures)
        self.types = agent_types(self._envs[0], choice)
        self._n_agents = sum(len(kind.agents) for kind in self.types)
        self.views = {kind.name: self._blank(kind) for kind in self.types}
        """What is seen now, by type; changed in place."""
        self._lengths = [0] * len(self._envs)
        self._returns = [dict.fromkeys((kind.name for kind in self.types), 0.0) for _ in self._envs]
        self._sums = [dict.fromkeys(self._figures, 0.0) for _ in self._envs]

    @property
    def n_agents(self) -> int:
        """Agents of all environments."""
        return self._n_agents * len(self._envs)

    def reset(self, seeds: Sequence[int]) -> None:
        """Begin an episode in every environment, and the series of episodes that follow it."""
        for index, (env, seed) in enumerate(zip(self._envs, seeds, strict=True)):
            self._begin(index, env.reset(seed=seed)[0])

    def step(self, actions: Mapping[str, npt.NDArray[Any]]) -> BatchStep:
        """Step every environment; one whose episode ends begins the next at once.

        Args:
            actions: By type, one row per agent, in the order of the views.

        Raises:
            TrainingError: An agent has left before the others.
        """
        n_envs = len(self._envs)
        outcome = BatchStep(
            rewards={kind.name: np.zeros(n_envs * len(kind.agents), dtype=np.float32) for kind in self.types},
            ended=np.zeros(n_envs, dtype=np.bool_),
            truncated=np.zeros(n_envs, dtype=np.bool_),
            last={},
        )
        for index, env in enumerate(self._envs):
            chosen: dict[str, Any] = {}
            for kind in self.types:
                first = index * len(kind.agents)
                chosen.update(zip(kind.agents, actions[kind.name][first : first + len(kind.agents)], strict=True))
            observations, rewards, terminations, truncations, infos = env.step(chosen)
            if len(observations) != self._n_agents:
                raise TrainingError(f"{len(observations)} of {self._n_agents} agents are left; valid: all, to the end")
            self._lengths[index] += 1
            for kind in self.types:
                first = index * len(kind.agents)
                got = [rewards[agent] for agent in kind.agents]
                outcome.rewards[kind.name][first : first + len(got)] = got
                self._returns[index][kind.name] += sum(got) / len(got)
            for name in self._figures:
                self._sums[index][name] += sum(float(info.get(name, 0.0)) for info in infos.values())
            self._see(index, observations, self.views)
            if not env.agents:
                outcome.ended[index] = True
                outcome.truncated[index] = any(truncations.values()) and not any(terminations.values())
                if outcome.truncated[index]:
                    outcome.last = outcome.last or {kind.name: self._blank(kind) for kind in self.types}
                    self._see(index, observations, outcome.last)
                outcome.episodes.append(
                    EpisodeFigures(length=self._lengths[index], returns=self._returns[index], figures=self._sums[index])
                )
                self._begin(index, env.reset()[0])
        return outcome

    def close(self) -> None:
        """Close all environments."""
        for env in self._envs:
            env.close()

    def _begin(self, index: int, observations: Mapping[str, Any]) -> None:
        self._lengths[index] = 0
        self._returns[index] = dict.fromkeys((kind.name for kind in self.types), 0.0)
        self._sums[index] = dict.fromkeys(self._figures, 0.0)
        self._see(index, observations, self.views)

    def _blank(self, kind: AgentType) -> TypeView:
        n_rows = len(self._envs) * len(kind.agents)
        mask = np.ones((n_rows, int(kind.action.n)), dtype=np.bool_) if isinstance(kind.action, Discrete) else None
        rows = np.zeros((n_rows, kind.n_observed), dtype=np.float32)
        return TypeView(rows=rows, mask=mask if kind.masked else None)

    def _see(self, index: int, observations: Mapping[str, Any], views: dict[str, TypeView]) -> None:
        for kind in self.types:
            view = views[kind.name]
            for row, agent in enumerate(kind.agents, start=index * len(kind.agents)):
                seen = observations[agent]
                if view.mask is not None:
                    view.mask[row] = mask_of(seen, kind)
                view.rows[row] = vector(seen)


def agent_types(env: Any, choice: ChoiceLayout | None = None) -> tuple[AgentType, ...]:
    """Group the agents of an environment by the words before their numbers.

    Raises:
        TrainingError: A space is of a kind that cannot be learned on, or agents of a type differ.
    """
    names = dict.fromkeys(type_of(agent) for agent in env.possible_agents)
    kinds = []
    for name in names:
        agents = tuple(agent for agent in env.possible_agents if type_of(agent) == name)
        spaces = [(env.observation_space(agent), env.action_space(agent)) for agent in agents]
        if any(space != spaces[0] for space in spaces):
            raise TrainingError(f"agents {', '.join(agents)} have different spaces; valid: one for all of a type")
        seen, action = spaces[0]
        if not isinstance(action, Box | Discrete):
            raise TrainingError(f"action space of {name} is {action}; valid: Box, Discrete")
        masked = isinstance(seen, Dict)
        kinds.append(
            AgentType(
                name=name,
                agents=agents,
                n_observed=_width(name, seen),
                action=action,
                masked=masked,
                choice=choice if masked else None,
            )
        )
    return tuple(kinds)


def mask_of(observation: Mapping[str, Any], kind: AgentType) -> Bools:
    """The actions that an agent chooses among, shape (n_actions,)."""
    mask: Bools = np.asarray(observation["action_mask"]) == 1
    if kind.choice is not None and mask[1:].any():
        mask[0] = False
    return mask


def vector(observation: Any) -> Floats:
    """The numbers of an observation without its mask, shape (n_observed,)."""
    row: Floats = observation["observation"] if isinstance(observation, Mapping) else observation
    return row


def _width(name: str, space: Space[Any]) -> int:
    inner = space["observation"] if isinstance(space, Dict) and "observation" in space.spaces else space
    if not isinstance(inner, Box) or len(inner.shape) != 1:
        raise TrainingError(f"observation space of {name} is {space}; valid: a Box of one axis, or one with a mask")
    return int(inner.shape[0])
