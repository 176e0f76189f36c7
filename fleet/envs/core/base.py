"""FleetEnv: what all environments of the fleet share - spaces, render modes, refusals, saving by seed and actions."""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Space
from gymnasium.utils import EzPickle
from pettingzoo.utils import ParallelEnv, parallel_to_aec
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from fleet.config.field_checks import is_whole
from fleet.envs.core.env_config import EnvConfig, require_seed
from fleet.envs.core.state_file import StateError, is_like, plain, read_state, write_state
from fleet.envs.core.window import PictureWindow
from fleet.errors import FleetError
from maps.reading.shown import named, shown

Picture = npt.NDArray[np.uint8]
_SEEDS = 2**31
"""Episodes that there are."""
Infos = dict[str, dict[str, Any]]
StepReturn = tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], Infos]
"""Observations, rewards, terminations, truncations and infos of all agents."""


class EpisodeError(FleetError):
    """The environment was asked for something that its episode does not allow now."""


class ActionError(FleetError):
    """Actions of an agent that is not in the team, or of the wrong shape or kind."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EnvState:
    """A moment of an episode: how it began, and all that agents did in it.

    The seed and the actions bring it back in any process, to the last bit, by running the episode again.
    """

    name: str
    """The environment's name."""
    arguments: dict[str, Any]
    """Settings it was made with, by name, but for how it is shown."""
    seed: int
    """Of the episode, as `FleetEnv._begin` takes it."""
    series: Mapping[str, Any]
    """Where the series of episodes goes on, as numpy tells the state of a generator."""
    actions: tuple[Any, ...]
    """What `FleetEnv._advance` was given so far."""
    agents: tuple[str, ...]
    """Agents that had not left."""
    quick: Any = None
    """What brings the moment back without running the episode again, in the environment that saved it."""

    def write(self, path: str | Path) -> None:
        """Write to a file, whole or not at all.

        Raises:
            StateError: The file cannot be written, or the state holds what no file can.
        """
        told = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "quick"}
        write_state(Path(path), told)

    @staticmethod
    def read(path: str | Path) -> EnvState:
        """Read what `write` wrote; nothing in the file is run as code.

        Raises:
            StateError: No such file, or it holds something else.
        """
        told = read_state(Path(path))
        if told.keys() != {field.name for field in fields(EnvState)} - {"quick"}:
            raise StateError(
                f"saved state {path} holds {shown(', '.join(told))}; valid: a file that EnvState.write wrote"
            )
        return EnvState(**told)


class FleetEnv(ParallelEnv[str, Any, Any], EzPickle):
    """A PettingZoo environment over a fleet: the part that does not depend on what agents decide.

    A subclass writes `_begin`, `_advance`, `_resolved` and `_picture`. It is pickled and copied by its settings: a copy
    begins before its first episode.

    Who takes part is decided when an episode begins (`_team`, by default everybody). An agent that is out for good
    (`_gone`) is terminated and leaves `agents`; it is back in the next episode. Who plays may take agents out of
    `agents`: they have left for the rest of the episode, nothing is told of them any more, and their robots do what
    they do without an action. All others end together.

    Args:
        config: All settings.
        observation_spaces: By agent; the order is that of the agents.
        action_spaces: By agent.
    """

    def __init__(
        self,
        config: EnvConfig,
        observation_spaces: Mapping[str, Space[Any]],
        action_spaces: Mapping[str, Space[Any]],
    ) -> None:
        EzPickle.__init__(self, config)
        self.config = config
        """All settings."""
        self.metadata: dict[str, Any] = {
            "name": config.NAME,
            "render_modes": list(config.RENDER_MODES),
            "render_fps": config.render_fps,
            "is_parallelizable": True,
        }
        self.max_cycles = config.max_cycles
        self.render_mode = config.render_mode
        self.observation_spaces = dict(observation_spaces)
        self.action_spaces = dict(action_spaces)
        self.possible_agents = list(observation_spaces)
        self.agents: list[str] = []
        self._roster: list[str] = []
        """The agents as this class left them: others may take some out of `agents`."""
        self._playing: frozenset[str] = frozenset()
        """The same, as a set."""
        self.n_steps = 0
        """Steps of the episode so far."""
        self._series = np.random.default_rng(config.seed)
        self._seed = -1
        self._log: list[Any] = []
        self._window: PictureWindow | None = None
        self._is_closed = False

    def observation_space(self, agent: str) -> Space[Any]:
        """Space of an agent's observations; the same object every time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[Any]:
        """Space of an agent's actions; the same object every time."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin an episode.

        Args:
            seed: Decides this episode and those that follow without a seed; None = go on in the present series.
            options: Not used.

        Returns:
            Observations and infos of all agents.

        Raises:
            ConfigError: The seed is no integer >= 0; nothing has changed.
            EpisodeError: The environment is closed.
        """
        del options
        self._require_open("reset")
        if seed is not None:
            require_seed(seed)
            self._series = np.random.default_rng(seed)
        self._seed = int(self._series.integers(_SEEDS))
        told = self._start()
        self._show()
        return told

    def step(self, actions: Mapping[str, Any]) -> StepReturn:
        """Let every agent act.

        Args:
            actions: By agent; what is missing, None or illegal is made legal, and `infos[agent]["illegal"]`, a truth
                value, says so.

        Returns:
            Observations, rewards, terminations, truncations and infos of all agents.

        Raises:
            EpisodeError: No episode is under way.
            ActionError: An agent is not one of the team or has left, or an action has the wrong shape or kind.
        """
        if not self.agents:
            raise EpisodeError("step: no episode is under way; valid: reset() first")
        if self.agents != self._roster:
            self._let_leave()
        if not isinstance(actions, dict | Mapping):  # nearly always a dict, which is known at once
            raise ActionError(f"step: actions are a {type(actions).__name__}; valid: a dictionary by agent")
        if not actions.keys() <= self._playing:
            unknown = sorted(map(str, actions.keys() - self._playing))
            raise ActionError(f"step: actions of {named(', '.join(unknown))}; valid: {_listed(self.agents)}")
        resolved = self._resolved(actions)
        told = self._do(resolved)
        self._show()
        return told

    def save_state(self) -> EnvState:
        """Keep this moment; the environment and its later episodes do not change it.

        Raises:
            EpisodeError: No episode is under way.
        """
        if not self.agents:
            raise EpisodeError("save_state: no episode is under way; valid: reset() first")
        return EnvState(
            name=self.metadata["name"],
            arguments=copy.deepcopy(self.config.deciding()),
            seed=self._seed,
            series=self._series.bit_generator.state,
            actions=tuple(self._log),
            agents=tuple(self.agents),
            quick=self._quick(),
        )

    def load_state(self, state: EnvState) -> dict[str, Any]:
        """Return to a moment, exactly: what follows, later episodes included, is what followed then.

        Args:
            state: From `save_state` of this environment, or of any other that was made with the same settings.

        Returns:
            Observations of all agents, as they were.

        Raises:
            StateError: It was saved by an environment with other settings, or holds what no moment does; nothing has
                changed, or no episode is under way.
            EpisodeError: The environment is closed.
        """
        self._require_open("load_state")
        if not isinstance(state, EnvState):
            raise StateError(f"load_state: the state is a {type(state).__name__}; valid: an EnvState")
        if state.name != self.metadata["name"]:
            raise StateError(f"load_state: the state is one of {state.name}; valid: one of {self.metadata['name']}")
        self._require_fits(state)
        self._seed = state.seed
        if state.quick is not None and self._restore(state.quick):
            self._log, self.n_steps = list(state.actions), len(state.actions)
        else:
            self._start()
            for resolved in state.actions:
                if not self.agents:
                    raise StateError(
                        f"load_state: the episode ends after {self.n_steps} steps; valid: that many, not "
                        f"{len(state.actions)}"
                    )
                self._do(resolved)
        self._play_on(state.agents)
        self._series = _generator(state.series)
        return self._of_players(self._observations())

    def render(self) -> Picture | None:
        """Draw this moment: an array (height, width, 3) in mode `rgb_array`, None in the others, which show it."""
        if self._seed < 0:
            return None
        if self.render_mode == "rgb_array":
            return self._picture()
        if self.render_mode == "human":
            self._window = self._window or PictureWindow("fleet")
            self._window.show(self._picture())
        elif self.render_mode == "rerun":
            self._record()
        return None

    def close(self) -> None:
        """Free what the environment holds, for good; calling twice is harmless."""
        self.agents = []
        self._seed = -1
        self._is_closed = True
        if self._window is not None:
            self._window.close()
            self._window = None

    @abstractmethod
    def _begin(self, seed: int) -> Infos:
        """Begin the episode of a seed; returns all possible agents' infos."""

    @abstractmethod
    def _resolved(self, actions: Mapping[str, Any]) -> Any:
        """Legal decisions of all agents, as `_advance` takes them; nothing changes them later.

        Raises:
            ActionError: An action has the wrong shape or kind.
        """

    @abstractmethod
    def _advance(self, resolved: Any) -> tuple[dict[str, float], bool, Infos]:
        """Make one step; returns rewards, whether the work is done, and infos, all of all possible agents."""

    @abstractmethod
    def _observations(self) -> dict[str, Any]:
        """Observations of all possible agents now, in arrays that are the caller's own."""

    def _team(self) -> list[str]:
        """Agents of the episode that begins, in the order of `possible_agents`."""
        return self.possible_agents[:]

    def _gone(self) -> frozenset[str]:
        """Agents that are out for the rest of the episode."""
        return frozenset()

    @abstractmethod
    def _picture(self) -> Picture:
        """Draw this moment, shape (height, width, 3)."""

    def _record(self) -> None:
        """Write this moment to a recording."""

    def _quick(self) -> Any:
        """What `_restore` needs to return to this moment at once; None if only running again is exact."""
        return None

    def _restore(self, quick: Any) -> bool:
        """Return to a moment at once; False, with nothing changed, if that is not exact any more."""
        del quick
        return False

    def _require_open(self, what: str) -> None:
        if self._is_closed:
            raise EpisodeError(f"{what}: the environment is closed; valid: another one")

    def _start(self) -> tuple[dict[str, Any], Infos]:
        # Should the beginning fail, no episode is under way.
        self.agents, self._log, self.n_steps = [], [], 0
        seed, self._seed = self._seed, -1
        infos = self._begin(seed)
        self._seed = seed
        self._play_on(self._team())
        return self._observations(), infos

    def _let_leave(self) -> None:
        """Take note of who was taken out of `agents`; whatever else was done to the list is undone."""
        left = self._playing & frozenset(self.agents)
        self._play_on([agent for agent in self.possible_agents if agent in left])

    def _play_on(self, agents: Sequence[str]) -> None:
        self.agents, self._roster, self._playing = list(agents), list(agents), frozenset(agents)

    def _of_players(self, told: dict[str, Any]) -> dict[str, Any]:
        """What is told of agents that have not left."""
        if len(self._playing) == len(told):
            return told
        return {agent: of_agent for agent, of_agent in told.items() if agent in self._playing}

    def _do(self, resolved: Any) -> StepReturn:
        rewards, done, infos = self._advance(resolved)
        self._log.append(resolved)
        self.n_steps += 1
        out_of_time = not done and self.n_steps >= self.max_cycles
        agents, gone = self.agents, self._gone()
        terminations, truncations = dict.fromkeys(agents, done), dict.fromkeys(agents, out_of_time)
        if done or out_of_time:
            self.agents = []
        told = self._of_players(self._observations()), self._of_players(rewards), self._of_players(infos)
        if gone:
            for agent in gone.intersection(agents):
                terminations[agent], truncations[agent] = True, False
            self._play_on([agent for agent in self.agents if agent not in gone])
        return told[0], told[1], terminations, truncations, told[2]

    def _require_fits(self, state: EnvState) -> None:
        """Refuse a state of an environment with other settings, and one that no environment has saved.

        Whoever changes a file can write anything into it: what is not legal must not come to where actions are taken.
        """
        if not isinstance(state.arguments, Mapping):
            raise StateError(f"load_state: arguments are {shown(state.arguments)}; valid: settings by name")
        for key, value in self.config.deciding().items():
            # As files have them: dataclasses of weights and the like come from another process.
            if plain(state.arguments.get(key)) != plain(value):
                was = shown(state.arguments.get(key))
                raise StateError(f"load_state: saved with {key} = {was}; valid: {shown(value)}")
        if not is_whole(state.seed) or not 0 <= state.seed < _SEEDS:
            raise StateError(f"load_state: seed is {shown(state.seed)}; valid: an integer from 0 to {_SEEDS - 1}")
        if not isinstance(state.actions, tuple) or len(state.actions) >= self.max_cycles:
            found = f"{len(state.actions)} steps" if isinstance(state.actions, tuple) else shown(state.actions)
            raise StateError(f"load_state: actions are {found}; valid: fewer than max_cycles = {self.max_cycles} steps")
        if state.actions:
            example = self._example(state.seed)
            wrong = next((k for k, resolved in enumerate(state.actions) if not is_like(resolved, example)), None)
            if wrong is not None:
                found = shown(state.actions[wrong])
                raise StateError(f"load_state: actions of step {wrong} are {found}; valid: those of this team")
        agents = state.agents
        known = isinstance(agents, tuple) and all(isinstance(agent, str) for agent in agents)
        if not known or not agents or list(agents) != [agent for agent in self.possible_agents if agent in agents]:
            raise StateError(f"load_state: agents are {shown(agents)}; valid: of {_listed(self.possible_agents)}")
        _generator(state.series)

    def _example(self, seed: int) -> Any:
        """Actions as they are kept, of the team that a seed begins an episode with."""
        del seed
        return self._resolved({})

    def _show(self) -> None:
        if self.render_mode in ("human", "rerun"):
            self.render()


def _generator(series: Mapping[str, Any]) -> np.random.Generator:
    """A generator where a series goes on.

    Raises:
        StateError: The state is none of this kind of generators.
    """
    generator = np.random.default_rng()
    try:
        generator.bit_generator.state = series
    except (TypeError, ValueError, LookupError, OverflowError) as reason:
        raise StateError(
            f"load_state: series is {shown(series)} ({reason}); valid: the state of a {type(generator).__name__}"
        ) from reason
    return generator


def turn_based(env: FleetEnv) -> Any:
    """The turn-based (AEC) form of an environment."""
    return parallel_to_aec(env)


def in_order(env: Any) -> Any:
    """A turn-based environment that complains about calls in a wrong order."""
    return OrderEnforcingWrapper(env)


def _listed(agents: Sequence[str]) -> str:
    return ", ".join(agents) if len(agents) <= 6 else f"{agents[0]}, ..., {agents[-1]}"
