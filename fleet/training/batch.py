"""EnvBatch: several environments stepped side by side in one process, with one array of observations per type."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Dict, Discrete, Space

from fleet.envs.policies.policy import Policy, Weighing
from fleet.training.errors import TrainingError
from fleet.training.layout import RowLayout

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]


def type_of(agent: str) -> str:
    """Type of an agent: `car` of `car_3`."""
    return agent.rpartition("_")[0]


@dataclass(frozen=True, kw_only=True)
class AgentType:
    """Agents that share a network: all see and do the same kind of thing."""

    name: str
    n_observed: int
    action: Box | Discrete
    masked: bool
    """Whether observations carry an `action_mask`."""
    layout: RowLayout = RowLayout()  # noqa: RUF009 - frozen
    """How observations are made up, with all sizes known."""


@dataclass(kw_only=True)
class TypeView:
    """What the agents of one type see now: n rows, one per possible agent, environment after environment."""

    rows: Floats
    """Observations, shape (n, n_observed)."""
    mask: Bools | None
    """Legal actions, shape (n, n_actions); None without masks."""
    active: Bools
    """Which agents there are now, shape (n,); the numbers of the others mean nothing."""
    state: Floats | None = None
    """`state()` of each agent's environment, filled up with zeros, shape (n, n_state); None if nobody asks for it."""


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
    """What one step of all environments brought; arrays by type, one entry per row of its view, shape (n,)."""

    rewards: dict[str, Floats]
    ended: dict[str, Bools]
    """Agents whose episode ended."""
    truncated: dict[str, Bools]
    """Those of them that ran out of time."""
    last: dict[str, TypeView]
    """What truncated agents saw at the end; other rows mean nothing. Empty if there is none."""
    episodes: list[EpisodeFigures] = field(default_factory=list)
    """Episodes that ended as the environment ends them."""

    @classmethod
    def of(cls, n_rows: Mapping[str, int]) -> BatchStep:
        """One in which nothing has happened yet, for so many agents of each type."""
        return cls(
            rewards={name: np.zeros(n, dtype=np.float32) for name, n in n_rows.items()},
            ended={name: np.zeros(n, dtype=np.bool_) for name, n in n_rows.items()},
            truncated={name: np.zeros(n, dtype=np.bool_) for name, n in n_rows.items()},
            last={},
        )


class Batch(Protocol):
    """Environments that are stepped side by side, whatever they are made of."""

    types: tuple[AgentType, ...]
    views: dict[str, TypeView]
    """What is seen now, by type; changed in place."""

    @property
    def n_agents(self) -> int:
        """Possible agents of all environments."""

    def reset(self, seeds: Sequence[int], cuts: Sequence[int] | None = None) -> None:
        """Begin an episode in every environment, and the series of episodes that follow it.

        Args:
            seeds: One per environment.
            cuts: Steps after which the first episode of each is cut off for all as if time had run out, and is no
                episode of `BatchStep.episodes`; 0 = never. So that environments do not all begin and end together.
        """

    def step(self, actions: Mapping[str, npt.NDArray[Any]]) -> BatchStep:
        """Step every environment; one whose episode ends begins the next at once.

        Args:
            actions: By type, one row per row of the views.
        """

    def close(self) -> None:
        """Close all environments."""


class EnvBatch:
    """Steps several dictionary environments; a `Batch`.

    Args:
        envs: Agents of one type are alike in all of them, but there may be more or fewer; they are closed with the
            batch.
        figures: Names in `infos` whose sums over an episode are wanted.
        layouts: How observations are made up, by type.
        n_state: Numbers that `state()` is filled up to; 0: nobody asks for it.

    Raises:
        TrainingError: A space is of a kind that cannot be learned on, or agents of a type differ.
    """

    def __init__(
        self,
        envs: Sequence[Any],
        figures: Sequence[str] = (),
        layouts: Mapping[str, RowLayout] | None = None,
        n_state: int = 0,
    ) -> None:
        self.envs = list(envs)
        """The environments."""
        self._figures = tuple(figures)
        self.types = types_of([agent_types(env, layouts) for env in self.envs])
        self._rows: list[dict[str, dict[str, int]]] = []
        """By environment, type and agent: the row."""
        n_rows = dict.fromkeys((kind.name for kind in self.types), 0)
        for env in self.envs:
            team: dict[str, dict[str, int]] = {}
            for name, agents in team_of(env).items():
                team[name] = {agent: row for row, agent in enumerate(agents, start=n_rows[name])}
                n_rows[name] += len(agents)
            self._rows.append(team)
        self._n_rows = n_rows
        self.env_of = {name: np.zeros(n, dtype=np.int64) for name, n in n_rows.items()}
        """By type: index of the environment of each row."""
        for index, rows in enumerate(self._rows):
            for name in rows:
                self.env_of[name][list(rows[name].values())] = index
        self._n_state = n_state
        self.views = blank_views(self.types, self._n_rows, self._n_state)
        """What is seen now, by type; changed in place."""
        n_envs = len(self.envs)
        self._lengths, self._cuts = [0] * n_envs, [0] * n_envs
        self._returns: list[dict[str, float]] = [{}] * n_envs
        self._sums: list[dict[str, float]] = [{}] * n_envs
        self.observations: list[dict[str, Any]] = [{}] * n_envs
        """What agents see now, by environment, as a policy takes it."""

    @property
    def n_agents(self) -> int:
        """See `Batch`."""
        return sum(self._n_rows.values())

    def reset(self, seeds: Sequence[int], cuts: Sequence[int] | None = None) -> None:
        """See `Batch`."""
        self._cuts = [0] * len(self.envs) if cuts is None else list(cuts)
        for index, (env, seed) in enumerate(zip(self.envs, seeds, strict=True)):
            self._begin(index, env.reset(seed=seed)[0])

    def step(self, actions: Mapping[str, npt.NDArray[Any]]) -> BatchStep:
        """See `Batch`."""
        outcome = BatchStep.of(self._n_rows)
        for index in range(len(self.envs)):
            self._step(index, actions, outcome)
        return outcome

    def ask(self, policies: Sequence[Policy]) -> dict[str, npt.NDArray[Any]]:
        """What policies would do now.

        Args:
            policies: One per environment.

        Returns:
            Actions by type, one row per row of the views; zero where there is no agent.
        """
        found: dict[str, npt.NDArray[Any]] = {}
        for kind in self.types:
            shape = (self._n_rows[kind.name], *(kind.action.shape or ()))
            found[kind.name] = np.zeros(shape, dtype=kind.action.dtype)
        for env, policy, team, seen in zip(self.envs, policies, self._rows, self.observations, strict=True):
            told = policy.act(env, seen)
            for name, rows in team.items():
                for agent in rows.keys() & told.keys():
                    found[name][rows[agent]] = told[agent]
        return found

    def weigh(self, policies: Sequence[Weighing], taught: Mapping[str, npt.NDArray[Any]]) -> dict[str, Floats]:
        """What policies think of each action now, after they were asked.

        Args:
            policies: One per environment.
            taught: What they said, as `ask` tells it.

        Returns:
            Worths by type of discrete actions, shape (n_rows, n_actions); where a policy does not tell them, those of
            what it said (`worths_of_done`).
        """
        found: dict[str, Floats] = {}
        for kind in self.types:
            if isinstance(kind.action, Discrete):
                found[kind.name] = worths_of_done(taught[kind.name], int(kind.action.n))
        for policy, team in zip(policies, self._rows, strict=True):
            for name in team.keys() & found.keys():
                rows = team[name]
                for agent in rows.keys() & policy.worths.keys():
                    found[name][rows[agent]] = policy.worths[agent]
        return found

    def close(self) -> None:
        """See `Batch`."""
        for env in self.envs:
            env.close()

    def _step(self, index: int, actions: Mapping[str, npt.NDArray[Any]], outcome: BatchStep) -> None:
        env, team = self.envs[index], self._rows[index]
        playing = self.observations[index]
        chosen = {
            agent: actions[name][row] for name, rows in team.items() for agent, row in rows.items() if agent in playing
        }
        observations, rewards, terminations, truncations, infos = env.step(chosen)
        self._lengths[index] += 1
        for name in self._figures:
            self._sums[index][name] += sum(float(info.get(name, 0.0)) for info in infos.values())
        over = not env.agents
        cut = not over and self._lengths[index] == self._cuts[index]
        for name, rows in team.items():
            total = 0.0
            for agent, row in rows.items():
                if agent not in rewards:
                    continue
                outcome.rewards[name][row] = rewards[agent]
                total += rewards[agent]
                if terminations[agent] or truncations[agent] or cut:
                    outcome.ended[name][row] = True
                    outcome.truncated[name][row] = not terminations[agent]
            self._returns[index][name] += total / len(rows)
            if outcome.truncated[name].any():
                outcome.last = outcome.last or blank_views(self.types, self._n_rows, self._n_state)
        if outcome.last and (over or cut or any(truncations.values())):
            self._see(index, observations, outcome.last)
        if over:
            outcome.episodes.append(
                EpisodeFigures(length=self._lengths[index], returns=self._returns[index], figures=self._sums[index])
            )
        if over or cut:
            self._cuts[index] = 0
            self._begin(index, env.reset()[0])
        else:
            self.observations[index] = {agent: observations[agent] for agent in env.agents}
            self._see(index, self.observations[index], self.views)

    def _begin(self, index: int, observations: Mapping[str, Any]) -> None:
        self._lengths[index] = 0
        self._returns[index] = dict.fromkeys(self._rows[index], 0.0)
        self._sums[index] = dict.fromkeys(self._figures, 0.0)
        self.observations[index] = dict(observations)
        self._see(index, observations, self.views)

    def _see(self, index: int, observations: Mapping[str, Any], views: dict[str, TypeView]) -> None:
        state = self.envs[index].state() if self._n_state else None
        for kind in self.types:
            view = views[kind.name]
            for agent, row in self._rows[index].get(kind.name, {}).items():
                view.active[row] = agent in observations
                if view.active[row]:
                    seen = observations[agent]
                    view.rows[row] = vector(seen)
                    if view.mask is not None:
                        view.mask[row] = mask_of(seen, kind)
                else:
                    view.rows[row] = 0.0
                    if view.mask is not None:
                        view.mask[row] = True
                if view.state is not None and state is not None:
                    view.state[row, : len(state)] = state


def blank_views(types: Sequence[AgentType], n_rows: Mapping[str, int], n_state: int) -> dict[str, TypeView]:
    """Views by type, of so many rows, in which nobody sees anything."""
    return {kind.name: _blank_view(kind, n_rows[kind.name], n_state) for kind in types}


def _blank_view(kind: AgentType, n_rows: int, n_state: int) -> TypeView:
    mask = np.ones((n_rows, int(kind.action.n)), dtype=np.bool_) if isinstance(kind.action, Discrete) else None
    return TypeView(
        rows=np.zeros((n_rows, kind.n_observed), dtype=np.float32),
        mask=mask if kind.masked else None,
        active=np.zeros(n_rows, dtype=np.bool_),
        state=np.zeros((n_rows, n_state), dtype=np.float32) if n_state else None,
    )


def team_of(env: Any) -> dict[str, tuple[str, ...]]:
    """Possible agents of an environment by type."""
    names = dict.fromkeys(type_of(agent) for agent in env.possible_agents)
    return {name: tuple(agent for agent in env.possible_agents if type_of(agent) == name) for name in names}


def agent_types(env: Any, layouts: Mapping[str, RowLayout] | None = None) -> tuple[AgentType, ...]:
    """Types of the agents of an environment: the words before their numbers.

    Raises:
        TrainingError: A space is of a kind that cannot be learned on, agents of a type differ, or a layout does not
            fit.
    """
    kinds = []
    for name, agents in team_of(env).items():
        spaces = [(env.observation_space(agent), env.action_space(agent)) for agent in agents]
        if any(space != spaces[0] for space in spaces):
            raise TrainingError(f"agents {', '.join(agents)} have different spaces; valid: one for all of a type")
        seen, action = spaces[0]
        if not isinstance(action, Box | Discrete):
            raise TrainingError(f"action space of {name} is {action}; valid: Box, Discrete")
        n_observed = _width(name, seen)
        kinds.append(
            AgentType(
                name=name,
                n_observed=n_observed,
                action=action,
                masked=isinstance(seen, Dict) and "action_mask" in seen.spaces,
                layout=(layouts or {}).get(name, RowLayout()).sized(name, n_observed, action),
            )
        )
    return tuple(kinds)


def types_of(found: Sequence[Sequence[AgentType]]) -> tuple[AgentType, ...]:
    """All types of several environments.

    Raises:
        TrainingError: Agents of a type differ between two of them.
    """
    known: dict[str, AgentType] = {}
    for kind in (kind for kinds in found for kind in kinds):
        first = known.setdefault(kind.name, kind)
        if kind != first:
            raise TrainingError(
                f"agents of type {kind.name} observe {first.n_observed} numbers and do {first.action} in one "
                f"environment, {kind.n_observed} and {kind.action} in another; valid: the same in all"
            )
    return tuple(known.values())


def mask_of(observation: Mapping[str, Any], kind: AgentType) -> Bools:
    """The actions that an agent chooses among, shape (n_actions,)."""
    return masks_of(np.asarray(observation["action_mask"])[None], kind)[0]


def masks_of(masks: npt.NDArray[np.int8] | Bools, kind: AgentType) -> Bools:
    """The actions that several agents of a type choose among, shape (n, n_actions), from their masks."""
    mask: Bools = masks == 1
    layout = kind.layout
    if layout.chosen is None or not layout.takes or layout.groups[layout.chosen].n_things == mask.shape[1]:
        return mask
    mask[mask[:, 1:].any(axis=1), 0] = False
    return mask


def worths_of_done(done: npt.NDArray[Any], n_actions: int) -> Floats:
    """What actions are worth to those who only say what they did: all others as little as can be; see `Weighing`.

    Args:
        done: Actions, shape (n,).
        n_actions: That there are.

    Returns:
        Worths, shape (n, n_actions).
    """
    return np.where(np.arange(n_actions) == done[:, None], 0.0, np.finfo(np.float32).min).astype(np.float32)


def vector(observation: Any) -> Floats:
    """The numbers of an observation without its mask, shape (n_observed,)."""
    row: Floats = observation["observation"] if isinstance(observation, Mapping) else observation
    return row


def _width(name: str, space: Space[Any]) -> int:
    inner = space["observation"] if isinstance(space, Dict) and "observation" in space.spaces else space
    if not isinstance(inner, Box) or len(inner.shape) != 1:
        raise TrainingError(f"observation space of {name} is {space}; valid: a Box of one axis, or one with a mask")
    return int(inner.shape[0])
