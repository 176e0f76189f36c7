"""VecEnv: several environments of one kind, stepped together; one array per type of agents instead of dictionaries."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Dict, Discrete

from fleet.config import require
from fleet.envs.core.base import ActionError, EpisodeError
from fleet.envs.core.env_config import require_seed
from fleet.errors import ConfigError

Array = npt.NDArray[Any]
Arrays = dict[str, Array]
"""By type of agents."""


@dataclass(frozen=True, kw_only=True)
class AgentGroup:
    """The agents of one type in an environment: all see and do the same kind of thing."""

    name: str
    """The type, `car` of `car_0`."""
    agents: tuple[str, ...]
    """In the order of their rows."""
    observation: Box
    """Space of an observation, without its mask, shape (n_numbers,)."""
    action: Box | Discrete
    masked: bool
    """Whether there are masks."""

    @property
    def n(self) -> int:
        """Agents of the type in one environment."""
        return len(self.agents)


@dataclass(frozen=True, kw_only=True)
class VecView:
    """What all agents see, by their type; B environments."""

    observations: Arrays
    """Shape (B, n, n_numbers), float32."""
    masks: Arrays
    """Legal actions, shape (B, n, n_actions), int8; only of types with masks."""

    def copy(self) -> VecView:
        """A view that later steps do not change."""
        return VecView(
            observations={name: array.copy() for name, array in self.observations.items()},
            masks={name: array.copy() for name, array in self.masks.items()},
        )


@dataclass(frozen=True, kw_only=True)
class VecStep(VecView):
    """What one step of B environments brought.

    Where an episode has ended, observations and masks are those of the next one, which has begun in the same step.
    """

    rewards: Arrays
    """By type, shape (B, n), float64."""
    terminated: npt.NDArray[np.bool_]
    """Environments whose work was done, shape (B,)."""
    truncated: npt.NDArray[np.bool_]
    """Environments that ran out of time, shape (B,)."""
    final: VecView | None
    """What was seen at the end of episodes that have ended; rows of other environments mean nothing. None if there is
    none."""
    final_state: npt.NDArray[np.float32] | None
    """What `VecEnv.state` said there, shape (B, n_numbers); None if no episode has ended, or environments have none."""
    infos: dict[str, Arrays]
    """By type and name, shape (B, n): the terms of the rewards and flags; of the episode that the actions were of."""

    @property
    def ended(self) -> npt.NDArray[np.bool_]:
        """Environments whose episode has ended, shape (B,)."""
        return self.terminated | self.truncated


class VecEnv(ABC):
    """B environments that are stepped together, each in a series of episodes of its own.

    An environment whose episode ends begins the next one in the same step (`AutoresetMode.SAME_STEP` of gymnasium).
    Seeds mean what they mean to the single environment: that of environment `i` goes the same way as one that was reset
    with the same seed and then without one.

    Arrays that are returned are changed in place by the next step; `copy` keeps them.

    Args:
        single: An environment of the kind, which tells agents and spaces.
        n_envs: B.

    Raises:
        ConfigError: B is less than 1, or a space is of a kind that fits in no array.
    """

    def __init__(self, single: Any, n_envs: int) -> None:
        self.single = single
        """An environment of the kind, for its settings and spaces; it is not played."""
        self.n_envs = n_envs
        self.groups = agent_groups(single)
        """The types of agents."""
        self._under_way = self._is_closed = False

    def reset(self, seeds: int | Sequence[int] | None = None) -> VecView:
        """Begin an episode in every environment.

        Args:
            seeds: One for each environment; a single one, `s`, means `s`, `s + 1`, ...; None = go on in the series that
                are under way, which begin with the seed of the settings.

        Raises:
            ConfigError: They are no integers >= 0, or not as many as environments; nothing has changed.
            EpisodeError: The environments are closed.
        """
        if self._is_closed:
            raise EpisodeError("reset: the environments are closed; valid: others, of make_vec")
        if seeds is None:
            wanted: list[int] = []
        elif isinstance(seeds, int | np.integer):
            require_seed(seeds)
            wanted = [int(seeds) + index for index in range(self.n_envs)]
        else:
            require(isinstance(seeds, Iterable), "seeds", seeds, "an integer >= 0, or one per environment")
            wanted = list(seeds)
            require(len(wanted) == self.n_envs, "number of seeds", len(wanted), f"{self.n_envs}, one per environment")
            for seed in wanted:
                require_seed(seed)
            wanted = [int(seed) for seed in wanted]
        view = self._reset(wanted)
        self._under_way = True
        return view

    def step(self, actions: Mapping[str, npt.ArrayLike] | npt.ArrayLike) -> VecStep:
        """Let all agents act.

        Args:
            actions: By type, shape (B, n) of whole numbers or (B, n, n_entries); the array itself where there is one
                type only. What is missing or illegal is made legal, and the flag `illegal` of `infos` says so, as the
                single environment has it.

        Raises:
            EpisodeError: There was no `reset` yet, or the environments are closed.
            ActionError: A type that is not there, or an array of the wrong shape or kind.
        """
        if not self._under_way:
            raise EpisodeError("step: no episodes are under way; valid: reset() first")
        return self._step(self._resolved(actions))

    def restart(self, indices: Sequence[int]) -> VecView:
        """Begin the next episode of some environments at once, as if time had run out.

        Args:
            indices: Which environments.

        Raises:
            EpisodeError: There was no `reset` yet, or the environments are closed.
        """
        if not self._under_way:
            raise EpisodeError("restart: no episodes are under way; valid: reset() first")
        return self._restart(indices)

    @abstractmethod
    def state(self) -> npt.NDArray[np.float32]:
        """What `state()` of each environment says, shape (B, n_numbers)."""

    def close(self) -> None:
        """Free what the environments hold; calling twice is harmless."""
        self._under_way, self._is_closed = False, True
        self.single.close()

    @abstractmethod
    def _reset(self, seeds: list[int]) -> VecView:
        """Begin an episode in every environment; without seeds in the series that are under way."""

    @abstractmethod
    def _restart(self, indices: Sequence[int]) -> VecView:
        """Begin the next episode of some environments."""

    @abstractmethod
    def _step(self, actions: Arrays) -> VecStep:
        """Make a step; actions by type, of the right shape, missing types left out."""

    def _resolved(self, actions: Mapping[str, npt.ArrayLike] | npt.ArrayLike) -> Arrays:
        groups = {group.name: group for group in self.groups}
        if not isinstance(actions, Mapping):
            if len(groups) > 1:
                raise ActionError(f"step: actions are one array; valid: a dictionary by type, {', '.join(groups)}")
            actions = {next(iter(groups)): actions}
        resolved = {}
        for name, given in actions.items():
            if name not in groups:
                raise ActionError(f"step: actions of type {name}; valid: {', '.join(groups)}")
            group, array = groups[name], _array(name, given)
            shape = (self.n_envs, group.n, *(() if isinstance(group.action, Discrete) else group.action.shape))
            if array.shape != shape:
                raise ActionError(f"step: actions of type {name} have shape {array.shape}; valid: {shape}")
            resolved[name] = array
        return resolved


def _array(name: str, given: npt.ArrayLike) -> Array:
    try:
        array = np.asarray(given)
    except ValueError as reason:  # of unequal lengths
        raise ActionError(f"step: actions of type {name}: {reason}; valid: an array of numbers") from reason
    if array.dtype.kind not in "biuf":
        raise ActionError(f"step: actions of type {name} are of kind {array.dtype}; valid: numbers")
    return array


def type_of(agent: str) -> str:
    """Type of an agent: `car` of `car_3`."""
    return agent.rpartition("_")[0]


def agent_groups(env: Any) -> tuple[AgentGroup, ...]:
    """Group the agents of an environment by the words before their numbers.

    Raises:
        ConfigError: An observation is more than one row of numbers and a mask, an action is neither one of a number nor
            a row of numbers, or agents of a type differ.
    """
    groups = []
    for name in dict.fromkeys(type_of(agent) for agent in env.possible_agents):
        agents = tuple(agent for agent in env.possible_agents if type_of(agent) == name)
        spaces = [(env.observation_space(agent), env.action_space(agent)) for agent in agents]
        if any(space != spaces[0] for space in spaces):
            raise ConfigError(f"agents of type {name} have different spaces; valid: one for all")
        seen, action = spaces[0]
        masked = isinstance(seen, Dict) and set(seen.spaces) == {"observation", "action_mask"}
        row = seen["observation"] if masked else seen
        if not isinstance(row, Box) or len(row.shape) != 1:
            raise ConfigError(f"observation space of {name} is {seen}; valid: a Box of one axis, or one with a mask")
        if not isinstance(action, Box | Discrete):
            raise ConfigError(f"action space of {name} is {action}; valid: Box, Discrete")
        groups.append(AgentGroup(name=name, agents=agents, observation=row, action=action, masked=masked))
    return tuple(groups)
