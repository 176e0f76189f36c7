"""Collector: steps environments by what was learned, or by a teacher, and keeps what happened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch

from fleet.training.batch import Batch, BatchStep, Bools, EnvBatch, EpisodeFigures, TypeView
from fleet.training.ppo.learner import Floats, Learner, Rollout


@dataclass(kw_only=True)
class _Taken:
    """What the agents of one type saw and did, step by step."""

    seen: Floats
    """Observations as they were, shape (T, n, n_observed)."""
    rows: Floats
    """The same, normalised."""
    masks: list[Bools] = field(default_factory=list)
    states: list[Floats] = field(default_factory=list)
    active: list[Bools] = field(default_factory=list)
    actions: list[Any] = field(default_factory=list)
    worths: list[Floats] = field(default_factory=list)
    log_shares: list[Floats] = field(default_factory=list)
    steps: list[BatchStep] = field(default_factory=list)

    def look(self, t: int, view: TypeView) -> None:
        """Keep what is seen in a step; the view changes in the next."""
        self.seen[t] = view.rows
        self.active.append(view.active.copy())
        if view.mask is not None:
            self.masks.append(view.mask.copy())
        if view.state is not None:
            self.states.append(view.state.copy())


class Collector:
    """Makes rollouts.

    Args:
        batch: The environments.
        learners: By type.
        discount: gamma, by which the spread of the rewards is measured.
        weighs: Whether teachers are also asked what each action is worth.
    """

    def __init__(self, batch: Batch, learners: dict[str, Learner], discount: float, *, weighs: bool = False) -> None:
        self._batch, self._discount, self._weighs = batch, discount, weighs
        self._learners = {kind.name: learners[kind.name] for kind in batch.types}
        self._running = {name: np.zeros(len(view.rows)) for name, view in batch.views.items()}

    def begin(self, seeds: Sequence[int], cuts: Sequence[int] | None) -> None:
        """Begin new episodes everywhere; see `Batch.reset`."""
        self._batch.reset(seeds, cuts)
        for running in self._running.values():
            running[:] = 0.0

    def roll(
        self, n_steps: int, generator: torch.Generator, teachers: Sequence[Any] = (), n_own: int = 0
    ) -> tuple[dict[str, Rollout], list[EpisodeFigures]]:
        """Step all environments.

        Args:
            n_steps: Of each.
            generator: Source of chance.
            teachers: One policy per environment; their actions are those of the rollout. None without.
            n_own: Environments, from the first, that follow what was learned although there are teachers.

        Returns:
            Rollouts by type, and the episodes that ended.
        """
        batch = self._batch
        shapes = {name: (n_steps, *batch.views[name].rows.shape) for name in self._learners}
        taken = {name: _Taken(seen=_floats(shape), rows=_floats(shape)) for name, shape in shapes.items()}
        episodes: list[EpisodeFigures] = []
        for t in range(n_steps):
            acts: dict[str, Any] = {}
            taught: dict[str, Any] = {}
            worths: dict[str, Floats] = {}
            if teachers and isinstance(batch, EnvBatch):
                taught = batch.ask(teachers)
                worths = batch.weigh(teachers, taught) if self._weighs else {}
            for name, learner in self._learners.items():
                view, one = batch.views[name], taken[name]
                actions, log_shares = learner.choose(view, one.rows[t], generator)
                acts[name] = learner.legal(actions)
                if taught:
                    led = (
                        batch.env_of[name] >= n_own
                        if isinstance(batch, EnvBatch)
                        else np.ones(len(view.rows), np.bool_)
                    )
                    acts[name] = np.where(led.reshape(-1, *[1] * (actions.ndim - 1)), taught[name], acts[name])
                    actions = learner.plain(taught[name])
                if name in worths:
                    one.worths.append(worths[name])
                one.look(t, view)
                one.actions.append(actions)
                one.log_shares.append(log_shares)
            outcome = batch.step(acts)
            episodes += outcome.episodes
            for name, learner in self._learners.items():
                taken[name].steps.append(outcome)
                self._earn(name, learner, outcome, taken[name].active[-1])
        return {name: self._rollout(name, one) for name, one in taken.items()}, episodes

    def _earn(self, name: str, learner: Learner, outcome: BatchStep, active: Any) -> None:
        """Follow the discounted sums of rewards, whose spread is their unit."""
        running = self._running[name] * self._discount + outcome.rewards[name]
        if active.any():
            learner.earned.update(running[active, None])
        self._running[name] = np.where(outcome.ended[name], 0.0, running)

    def _rollout(self, name: str, taken: _Taken) -> Rollout:
        """All steps of a type as arrays; values are asked for at once, for the network does not change meanwhile."""
        learner, now = self._learners[name], self._batch.views[name]
        rows, shape = taken.rows, taken.rows.shape[:2]
        ended = np.stack([step.ended[name] for step in taken.steps])
        truncated = np.stack([step.truncated[name] for step in taken.steps])
        states = taken.states
        state = None if not states else learner.told.apply(np.stack(states).reshape(-1, states[0].shape[1]))
        values = learner.values(rows.reshape(-1, rows.shape[2]), state).reshape(shape)
        after = np.concatenate((values[1:], self._values(learner, now)[None]))
        after[ended] = 0.0
        for t in np.flatnonzero(truncated.any(axis=1)).tolist():
            last = self._values(learner, taken.steps[t].last[name])
            after[t] = np.where(truncated[t], last, after[t])
        active = np.stack(taken.active)
        return Rollout(
            rows=rows,
            mask=np.stack(taken.masks) if taken.masks else None,
            state=None if state is None else state.reshape(*shape, -1),
            active=active,
            actions=np.stack(taken.actions),
            worths=np.stack(taken.worths) if taken.worths else None,
            log_shares=np.stack(taken.log_shares),
            values=values,
            after=after,
            rewards=(np.stack([s.rewards[name] for s in taken.steps]) / learner.earned.scale()).astype(np.float32),
            ended=ended,
            seen=taken.seen.reshape(-1, rows.shape[2]) if active.all() else taken.seen[active],
            told=np.stack(states)[active] if states else None,
        )

    def _values(self, learner: Learner, view: TypeView) -> Floats:
        state = None if view.state is None else learner.told.apply(view.state)
        return learner.values(learner.seen.apply(view.rows), state)


def _floats(shape: tuple[int, ...]) -> Floats:
    return np.empty(shape, dtype=np.float32)
