"""Trainer: rollouts, updates and checkpoints, one network per type of agents."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fleet.training.batch import EnvBatch, EpisodeFigures, TypeView, agent_types, mask_of, type_of, vector
from fleet.training.errors import TrainingError
from fleet.training.ppo.checkpoint import read_checkpoint, write_checkpoint
from fleet.training.ppo.learner import Learner, Rollout
from fleet.training.recipes import RECIPES, Recipe
from fleet.training.results import CHECKPOINT
from fleet.training.settings import PpoConfig, TrainConfig

Row = dict[str, float]
"""Figures of one update, as they go into the table of progress."""
_WEIGHTS, _CHANCE, _EPISODES = 0, 1, 2
"""Branches of the seed."""


class Trainer:
    """One training run.

    The whole run follows from its settings: after every checkpoint the environments begin new episodes with seeds of
    that update, and every update has its own source of chance. So a run that is taken up from a checkpoint goes on to
    the last bit like one that was never stopped, on the same machine and versions.

    Args:
        config: Everything that decides the outcome.
        folder: Where the checkpoint is kept.
        resume: Go on from the checkpoint in the folder, if there is one.

    Raises:
        TrainingError: The checkpoint is of other settings, or cannot be read.
    """

    def __init__(self, config: TrainConfig, folder: Path, *, resume: bool = False) -> None:
        torch.set_num_threads(1)
        self.config = config
        self._path = folder / CHECKPOINT
        self.recipe = RECIPES[config.env]
        state = read_checkpoint(self._path) if resume and self._path.exists() else None
        if state is not None:
            _require_same(config, json.loads(state["config"]), self._path)
        ppo = config.ppo
        self._batch = EnvBatch(
            [self.recipe.make(**config.arguments) for _ in range(ppo.envs_n)],
            figures=self.recipe.figures,
            choice=self.recipe.choice,
        )
        generator = _generator(config.seed, _WEIGHTS, 0)
        self.learners = {kind.name: Learner(kind, ppo, generator) for kind in self._batch.types}
        self.n_per_update = ppo.horizon_n * self._batch.n_agents
        self.n_updates = math.ceil(config.steps_n / self.n_per_update)
        self.n_done = 0
        """Updates done."""
        self.rows: list[Row] = []
        """Figures of the updates done."""
        self.cpu_s = 0.0
        """Time of the processor spent on them, by the runs before this one too [s]."""
        if state is not None:
            self.n_done, self.rows, self.cpu_s = state["done_n"], state["rows"], state["cpu_s"]
            for name, learner in self.learners.items():
                learner.recall(state["learners"][name])

    def run(self, on_update: Callable[[Row], None], interrupted: list[int]) -> bool:
        """Train to the end.

        Args:
            on_update: Called with the figures of every update.
            interrupted: No longer empty when the run is to stop; what was learned since the last checkpoint is lost.

        Returns:
            Whether the end was reached.
        """
        since = time.process_time()
        while self.n_done < self.n_updates:
            if self.n_done % self.config.checkpoint_n == 0:
                self._begin()
            if interrupted:
                return False
            self.rows.append(self._update())
            self.n_done += 1
            now = time.process_time()
            self.cpu_s, since = self.cpu_s + now - since, now
            if self.n_done % self.config.checkpoint_n == 0 or self.n_done == self.n_updates:
                self._save()
            on_update(self.rows[-1])
        return True

    def close(self) -> None:
        """Close the environments."""
        self._batch.close()

    def policy(self) -> LearnedPolicy:
        """What was learned so far."""
        return LearnedPolicy(self.learners)

    def _begin(self) -> None:
        sequence = np.random.SeedSequence([self.config.seed, _EPISODES, self.n_done])
        seeds = sequence.generate_state(self.config.ppo.envs_n)
        self._batch.reset([int(seed) for seed in seeds // 2])  # seeds of numpy's legacy generators end at 2^31
        self._running = {name: np.zeros(len(view.rows)) for name, view in self._batch.views.items()}

    def _update(self) -> Row:
        generator = _generator(self.config.seed, _CHANCE, self.n_done)
        rollouts, seen, episodes = self._roll(generator)
        rate = self.config.ppo.learning_rate * (1.0 - self.n_done / self.n_updates)
        row: Row = {"update": self.n_done + 1, "steps": (self.n_done + 1) * self.n_per_update}
        row |= _means(episodes, self.recipe)
        for name, learner in self.learners.items():
            losses = learner.learn(rollouts[name], rate, generator)
            if learner.kind.choice is None:  # things of a kind have to be told in the same units
                learner.seen.update(seen[name])
            row |= {f"{name}_{loss}": value for loss, value in losses.items()}
        return row

    def _roll(
        self, generator: torch.Generator
    ) -> tuple[dict[str, Rollout], dict[str, np.ndarray[Any, Any]], list[EpisodeFigures]]:
        """Step all environments `horizon_n` times; returns samples, observations as they were seen, whole episodes."""
        ppo, batch = self.config.ppo, self._batch
        steps: dict[str, list[dict[str, Any]]] = {name: [] for name in self.learners}
        seen: dict[str, list[Any]] = {name: [] for name in self.learners}
        episodes: list[EpisodeFigures] = []
        for _ in range(ppo.horizon_n):
            acts = {}
            for name, learner in self.learners.items():
                view = batch.views[name].copy()
                rows, actions, log_shares, values = learner.choose(view, generator)
                steps[name].append(
                    {"rows": rows, "mask": view.mask, "actions": actions, "log_shares": log_shares, "values": values}
                )
                seen[name].append(view.rows)
                acts[name] = learner.legal(actions)
            outcome = batch.step(acts)
            episodes += outcome.episodes
            for kind in batch.types:
                ended = outcome.ended.repeat(len(kind.agents))
                running = self._running[kind.name] * ppo.discount + outcome.rewards[kind.name]
                learner = self.learners[kind.name]
                learner.earned.update(running[:, None])
                self._running[kind.name] = np.where(ended, 0.0, running)
                last = np.zeros(len(ended), dtype=np.float32)
                if outcome.last:
                    out_of_time = outcome.truncated.repeat(len(kind.agents))
                    last = np.where(out_of_time, learner.values(outcome.last[kind.name]), last)
                steps[kind.name][-1] |= {"rewards": outcome.rewards[kind.name], "ended": ended, "last": last}
        return (
            {name: self._rollout(name, taken) for name, taken in steps.items()},
            {name: np.concatenate(rows) for name, rows in seen.items()},
            episodes,
        )

    def _rollout(self, name: str, taken: list[dict[str, Any]]) -> Rollout:
        learner = self.learners[name]
        stacked = {key: np.stack([step[key] for step in taken]) for key in taken[0] if key != "mask"}
        mask = None if taken[0]["mask"] is None else np.stack([step["mask"] for step in taken])
        onward = np.concatenate((stacked["values"][1:], learner.values(self._batch.views[name])[None]))
        return Rollout(
            rows=stacked["rows"],
            mask=mask,
            actions=stacked["actions"],
            log_shares=stacked["log_shares"],
            values=stacked["values"],
            after=np.where(stacked["ended"], stacked["last"], onward),
            rewards=(stacked["rewards"] / learner.earned.scale()).astype(np.float32),
            ended=stacked["ended"],
        )

    def _save(self) -> None:
        content = {
            "config": json.dumps(dataclasses.asdict(self.config)),
            "done_n": self.n_done,
            "rows": self.rows,
            "cpu_s": self.cpu_s,
            "learners": {name: learner.state() for name, learner in self.learners.items()},
        }
        write_checkpoint(self._path, content)


class LearnedPolicy:
    """Does what was learned, without chance.

    Args:
        learners: By type.
    """

    def __init__(self, learners: dict[str, Learner]) -> None:
        self._learners = learners

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """Actions of all agents that observe; `env` is not used."""
        del env
        actions: dict[str, Any] = {}
        for name, learner in self._learners.items():
            agents = [agent for agent in observations if type_of(agent) == name]
            if not agents:
                continue
            view = TypeView(
                rows=np.stack([vector(observations[agent]) for agent in agents]),
                mask=np.stack([mask_of(observations[agent], learner.kind) for agent in agents])
                if learner.kind.masked
                else None,
            )
            actions.update(zip(agents, learner.best(view), strict=True))
        return actions


def load_policy(folder: Path) -> LearnedPolicy:
    """What a training run has learned.

    Args:
        folder: Where it wrote its checkpoint.

    Raises:
        TrainingError: There is no checkpoint, or it cannot be read.
    """
    state = read_checkpoint(folder / CHECKPOINT)
    told = json.loads(state["config"])
    env = RECIPES[told["env"]].make(**told["arguments"])
    kinds = agent_types(env, RECIPES[told["env"]].choice)
    env.close()
    ppo = PpoConfig(**{**told["ppo"], "hidden": tuple(told["ppo"]["hidden"])})
    learners = {kind.name: Learner(kind, ppo, torch.Generator()) for kind in kinds}
    for name, learner in learners.items():
        learner.recall(state["learners"][name])
    return LearnedPolicy(learners)


def _means(episodes: list[EpisodeFigures], recipe: Recipe) -> Row:
    """Means over the episodes that ended; not a number if there was none."""

    def mean(values: list[float]) -> float:
        return float(np.mean(values)) if values else math.nan

    row: Row = {"episodes": float(len(episodes)), "length": mean([float(one.length) for one in episodes])}
    row["return"] = mean([sum(one.returns.values()) for one in episodes])
    return row | {name: mean([one.figures[name] for one in episodes]) for name in recipe.figures}


def _generator(seed: int, branch: int, update: int) -> torch.Generator:
    state = np.random.SeedSequence([seed, branch, update]).generate_state(2, dtype=np.uint32)
    return torch.Generator().manual_seed(int(state[0]) << 31 | int(state[1]) >> 1)


def _require_same(config: TrainConfig, told: dict[str, Any], path: Path) -> None:
    wanted = json.loads(json.dumps(dataclasses.asdict(config)))
    for name, value in wanted.items():
        if told.get(name) != value:
            raise TrainingError(f"{path}: {name} was {told.get(name)!r} and is {value!r} now; valid: the same settings")
