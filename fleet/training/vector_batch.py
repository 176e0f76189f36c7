"""VectorBatch: environments that kernels step together, as the trainer takes them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.envs.vector.make import vec_of
from fleet.envs.vector.vec_env import VecEnv, VecView
from fleet.training.batch import (
    BatchStep,
    EpisodeFigures,
    Floats,
    TypeView,
    agent_types,
    blank_views,
    masks_of,
    team_of,
    types_of,
)
from fleet.training.layout import RowLayout


class VectorBatch:
    """Steps several environments; a `Batch` that says what an `EnvBatch` of the same environments says.

    For environments whose agents stay to the end. Those with the same arguments are one `VecEnv`.

    Args:
        make: Makes an environment from its arguments.
        dealt: Arguments of each environment; agents of one type are alike in all, but there may be more or fewer.
        figures: Names in `infos` whose sums over an episode are wanted.
        layouts: How observations are made up, by type.
        n_state: Numbers that `state()` is filled up to; 0: nobody asks for it.

    Raises:
        TrainingError: A space is of a kind that cannot be learned on, or agents of a type differ.
    """

    def __init__(
        self,
        make: Callable[..., Any],
        dealt: Sequence[Mapping[str, Any]],
        figures: Sequence[str] = (),
        layouts: Mapping[str, RowLayout] | None = None,
        n_state: int = 0,
    ) -> None:
        self._figures, self._n_state = tuple(figures), n_state
        self._members = _alike(dealt)
        self._vecs = [_vec(make, dealt[members[0]], len(members)) for members in self._members]
        self.types = types_of([agent_types(vec.single, layouts) for vec in self._vecs])
        self._kinds = {kind.name: kind for kind in self.types}
        teams = {index: team_of(vec.single) for vec, members in self._pairs() for index in members}
        n_rows = dict.fromkeys(self._kinds, 0)
        first: dict[tuple[int, str], int] = {}
        for index in range(len(dealt)):
            for name, agents in teams[index].items():
                first[index, name] = n_rows[name]
                n_rows[name] += len(agents)
        self._n_rows = n_rows
        self._rows = [
            {
                name: np.concatenate([first[index, name] + np.arange(len(agents)) for index in members])
                for name, agents in teams[members[0]].items()
            }
            for members in self._members
        ]
        """By `VecEnv` and type: the row of each agent, environment after environment."""
        self.views = blank_views(self.types, self._n_rows, self._n_state)
        """What is seen now, by type; changed in place."""
        self._lengths = np.zeros(len(dealt), dtype=np.int64)
        self._cuts = np.zeros(len(dealt), dtype=np.int64)
        self._returns = {name: np.zeros(len(dealt)) for name in self._kinds}
        self._sums = {name: np.zeros(len(dealt)) for name in self._figures}

    @property
    def n_agents(self) -> int:
        """See `Batch`."""
        return sum(self._n_rows.values())

    def reset(self, seeds: Sequence[int], cuts: Sequence[int] | None = None) -> None:
        """See `Batch`."""
        self._cuts[:] = 0 if cuts is None else cuts
        for k, (vec, members) in enumerate(self._pairs()):
            view = vec.reset([seeds[index] for index in members])
            self._see(k, view, self._state(vec), self.views)
            self._forget(members)

    def step(self, actions: Mapping[str, npt.NDArray[Any]]) -> BatchStep:
        """See `Batch`."""
        outcome = BatchStep.of(self._n_rows)
        for k in range(len(self._vecs)):
            self._step(k, actions, outcome)
        return outcome

    def close(self) -> None:
        """See `Batch`."""
        for vec in self._vecs:
            vec.close()

    def _step(self, k: int, actions: Mapping[str, npt.NDArray[Any]], outcome: BatchStep) -> None:
        vec, members, rows = self._vecs[k], self._members[k], self._rows[k]
        shaped = {name: actions[name][row] for name, row in rows.items()}
        step = vec.step({name: one.reshape(len(members), -1, *one.shape[1:]) for name, one in shaped.items()})
        self._lengths[members] += 1
        over = step.ended
        cut = ~over & (self._lengths[members] == self._cuts[members])
        for name, row in rows.items():
            rewards, n = step.rewards[name], step.rewards[name].shape[1]
            outcome.rewards[name][row] = rewards.ravel()
            self._returns[name][members] += rewards.mean(axis=1)
            outcome.ended[name][row] = (over | cut).repeat(n)
            outcome.truncated[name][row] = (step.truncated | cut).repeat(n)
        for figure, sums in self._sums.items():
            for infos in step.infos.values():
                if figure in infos:
                    sums[members] += infos[figure].sum(axis=1)
        if (step.truncated | cut).any():
            # Of those that were cut off it is what is seen now, of the others what was seen before the next began.
            outcome.last = outcome.last or blank_views(self.types, self._n_rows, self._n_state)
            self._see(k, step, self._state(vec), outcome.last)
            if step.final is not None:
                self._see(k, step.final, step.final_state, outcome.last, step.ended)
        outcome.episodes += [self._told(k, index) for index in members[over].tolist()]
        view: VecView = vec.restart(np.flatnonzero(cut).tolist()) if cut.any() else step
        self._cuts[members[over | cut]] = 0
        self._forget(members[over | cut])
        self._see(k, view, self._state(vec), self.views)

    def _told(self, k: int, index: int) -> EpisodeFigures:
        return EpisodeFigures(
            length=int(self._lengths[index]),
            returns={name: float(self._returns[name][index]) for name in self._rows[k]},
            figures={name: float(sums[index]) for name, sums in self._sums.items()},
        )

    def _forget(self, members: npt.NDArray[np.int64]) -> None:
        self._lengths[members] = 0
        for sums in (*self._returns.values(), *self._sums.values()):
            sums[members] = 0.0

    def _pairs(self) -> list[tuple[VecEnv, npt.NDArray[np.int64]]]:
        return list(zip(self._vecs, self._members, strict=True))

    def _state(self, vec: VecEnv) -> Floats | None:
        return vec.state() if self._n_state else None

    def _see(
        self,
        k: int,
        view: VecView,
        state: Floats | None,
        views: dict[str, TypeView],
        which: npt.NDArray[np.bool_] | None = None,
    ) -> None:
        """Put what agents of a `VecEnv` see in views, of all its environments or of some."""
        for name, rows in self._rows[k].items():
            seen, told = view.observations[name], views[name]
            n = seen.shape[1]
            use = slice(None) if which is None else which.repeat(n)
            told.rows[rows[use]] = seen.reshape(-1, seen.shape[2])[use]
            told.active[rows[use]] = True
            if told.mask is not None:
                masks = view.masks[name]
                told.mask[rows[use]] = masks_of(masks.reshape(-1, masks.shape[2])[use], self._kinds[name])
            if told.state is not None and state is not None:
                told.state[rows[use], : state.shape[1]] = state.repeat(n, axis=0)[use]


def _vec(make: Callable[..., Any], arguments: Mapping[str, Any], n_envs: int) -> VecEnv:
    return vec_of(lambda: make(**arguments), n_envs)


def _alike(dealt: Sequence[Mapping[str, Any]]) -> list[npt.NDArray[np.int64]]:
    """Indices of those that are alike, ascending."""
    found: list[tuple[Mapping[str, Any], list[int]]] = []
    for index, arguments in enumerate(dealt):
        members = next((members for one, members in found if one == arguments), None)
        if members is None:
            found.append((arguments, [index]))
        else:
            members.append(index)
    return [np.array(members) for _, members in found]
