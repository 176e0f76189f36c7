"""Trainer: rollouts, updates and checkpoints, one network per type of agents."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fleet.training.batch import Batch, EnvBatch, EpisodeFigures
from fleet.training.curriculum import Curriculum
from fleet.training.demonstrations import Demonstration, read_demonstrations
from fleet.training.errors import TrainingError
from fleet.training.ppo.checkpoint import read_checkpoint, write_checkpoint
from fleet.training.ppo.collector import Collector
from fleet.training.ppo.learner import LOSSES, Learner
from fleet.training.ppo.policy import LearnedPolicy, described, require_kinds, told_config, told_settings
from fleet.training.recipes import RECIPES
from fleet.training.results import CHECKPOINT
from fleet.training.settings import TrainConfig, told_ppo

Row = dict[str, float]
"""Figures of one update, as they go into the table of progress."""
_WEIGHTS, _CHANCE, _EPISODES, _DEMONSTRATIONS, _TEACHERS = 0, 1, 2, 4, 5
"""Branches of the seed; 3 is that of the evaluation."""


class Trainer:
    """One training run.

    The whole run follows from its settings: after every checkpoint the environments begin new episodes with seeds of
    that update, their teachers are made anew, and every update has its own source of chance. So a run that is taken up
    from a checkpoint goes on to the last bit like one that was never stopped, on the same machine and versions. Stages
    change at checkpoints.

    After a checkpoint the first episode of each environment is cut off after a time of its own, so that from then on
    episodes end all the time.

    Args:
        config: Everything that decides the outcome.
        folder: Where the checkpoint is kept.
        resume: Go on from the checkpoint in the folder, if there is one.

    Raises:
        TrainingError: The checkpoint is of other settings, or cannot be read; the recipe has no teacher to clone, or an
            environment no state for a central critic; a run to start from, or a file of demonstrations, has other
            agents or networks, or cannot be read.
    """

    def __init__(self, config: TrainConfig, folder: Path, *, resume: bool = False) -> None:
        torch.set_num_threads(1)
        self.config = config
        self._path = folder / CHECKPOINT
        self.recipe = RECIPES[config.env]
        state = read_checkpoint(self._path) if resume and self._path.exists() else None
        if state is not None:
            _require_same(config, told_config(self._path, state), self._path)
        ppo, teacher = config.ppo, self.recipe.teacher
        if ppo.clone_n and teacher is None:
            raise TrainingError(f"ppo.clone_n is {ppo.clone_n}, and {config.env} has no teacher; valid: 0")
        if ppo.clone_n and ppo.clone_temperature and not (teacher and hasattr(teacher(0), "worths")):
            raise TrainingError(
                f"ppo.clone_temperature is {ppo.clone_temperature}, and {config.env} has no teacher that says what "
                f"each action is worth; valid: 0"
            )
        kinds, n_state = self.recipe.survey(config.arguments, config.held)
        self._n_state = n_state if ppo.critic == "central" else 0
        if ppo.critic == "central" and not n_state:
            raise TrainingError(f"ppo.critic is central, and {config.env} has no state(); valid: own")
        generator = _generator(config.seed, _WEIGHTS, 0)
        self.learners = {kind.name: Learner(kind, ppo, self._n_state, generator) for kind in kinds}
        self.n_done = 0
        """Updates done."""
        self.n_steps = 0
        """Steps of agents done."""
        self.rows: list[Row] = []
        """Figures of the updates done."""
        self.cpu_s = 0.0
        """Time of the processor spent on them, by the runs before this one too [s]."""
        self._curriculum = Curriculum(self.recipe.stages, config.steps_n)
        self._recent: deque[Row] = deque(maxlen=ppo.envs_n)
        """Figures of the latest episodes of the stage."""
        self._cloning = ppo.clone_n > 0
        self._demonstrations: dict[str, Demonstration] = {}
        if state is not None:
            self._recall(state)
        else:
            for other in config.start_from:
                self._start_from(Path(other))
            if config.demonstrations is not None:
                self._demonstrations = self._read_demonstrations(Path(config.demonstrations))
        self._batch: Batch | None = None

    def run(self, on_update: Callable[[Row], None], interrupted: list[int]) -> bool:
        """Train to the end.

        Args:
            on_update: Called with the figures of every update.
            interrupted: No longer empty when the run is to stop; what was learned since the last checkpoint is lost.

        Returns:
            Whether the end was reached.

        Raises:
            TrainingError: What was learned is no longer made up of finite numbers.
        """
        since = time.process_time()
        self._clone_demonstrations()
        while self.n_steps < self.config.steps_n:
            if self.n_done % self.config.checkpoint_n == 0:
                self._begin()
            if interrupted:
                return False
            self.rows.append(self._update())
            now = time.process_time()
            self.cpu_s, since = self.cpu_s + now - since, now
            if self._is_checkpoint:
                self._save()
            on_update(self.rows[-1])
        return True

    def close(self) -> None:
        """Close the environments."""
        if self._batch is not None:
            self._batch.close()
            self._batch = None

    def policy(self, chance: int | None = None) -> LearnedPolicy:
        """What was learned so far; see `LearnedPolicy`."""
        return LearnedPolicy(self.learners, chance)

    def _begin(self) -> None:
        """Begin new episodes, in the environments of this stage."""
        ppo = self.config.ppo
        advanced = self._curriculum.advance()
        cloning = self.n_steps < ppo.clone_n
        if advanced:
            self._recent.clear()
        if advanced or cloning != self._cloning or self._batch is None:
            self.close()
            self._cloning = cloning
            self._batch = self._make_batch()
            weighs = ppo.clone_temperature > 0.0
            self._collector = Collector(self._batch, self.learners, ppo.discount, weighs=weighs)
        self._teachers = []
        if cloning and self.recipe.teacher is not None:
            self._teachers = [self.recipe.teacher(seed) for seed in self._seeds(_TEACHERS)]
        cuts = None
        if self._recent:
            length = float(np.mean([one["length"] for one in self._recent]))
            cuts = [round(length * (k + 1) / ppo.envs_n) for k in range(ppo.envs_n - 1)] + [0]
        self._collector.begin(self._seeds(_EPISODES), cuts)

    def _seeds(self, branch: int) -> list[int]:
        """One per environment, for what begins at this update; seeds of numpy's legacy generators end at 2^31."""
        sequence = np.random.SeedSequence([self.config.seed, branch, self.n_done])
        return [int(seed) for seed in sequence.generate_state(self.config.ppo.envs_n) // 2]

    def _make_batch(self) -> Batch:
        recipe, config = self.recipe, self.config
        mixed = recipe.environments(self._curriculum.stage, config.arguments, config.held)
        dealt = [mixed[k % len(mixed)] for k in range(config.ppo.envs_n)]
        told: dict[str, Any] = {"figures": recipe.figures, "layouts": recipe.layouts, "n_state": self._n_state}
        if recipe.batch is not None and not self._cloning:
            return recipe.batch(dealt, **told)
        return EnvBatch([recipe.make(**one) for one in dealt], **told)

    def _update(self) -> Row:
        assert self._batch is not None
        ppo, recent = self.config.ppo, self._recent
        generator = _generator(self.config.seed, _CHANCE, self.n_done)
        n_own = round(ppo.clone_own * ppo.envs_n) if self.n_done else 0  # what knows nothing yet shows nothing
        rollouts, episodes = self._collector.roll(ppo.horizon_n, generator, self._teachers, n_own)
        left = 1.0 - self.n_steps / self.config.steps_n
        rate = ppo.learning_rate_end + (ppo.learning_rate - ppo.learning_rate_end) * left
        n_steps = ppo.horizon_n * self._batch.n_agents
        stage = self._curriculum.index + 1
        self.n_done += 1
        self.n_steps += n_steps
        figures = [_figures(one) for one in episodes]
        recent.extend(figures)
        self._curriculum.note(n_steps, figures)
        row: Row = {"update": self.n_done, "steps": self.n_steps, "stage": stage, "episodes": len(episodes)}
        for name in ("length", "return", *self.recipe.figures):
            row[name] = float(np.mean([one[name] for one in recent])) if recent else math.nan
        for name, learner in self.learners.items():
            losses = dict.fromkeys(LOSSES, math.nan)
            if name in rollouts and rollouts[name].active.any():
                if self._teachers:
                    losses = learner.clone(rollouts[name], rate, generator)
                else:
                    if ppo.anchor and learner.anchor is None and self._knows_something:
                        learner.keep_anchor()
                    losses = learner.learn(rollouts[name], rate, ppo.anchor * left, generator)
            if self.n_steps >= ppo.clone_n and self._is_checkpoint:
                learner.forget_teacher()  # nobody asks it any more from the checkpoint on
            self._require_finite(name, f"update {self.n_done}")
            row |= {f"{name}_{loss}": value for loss, value in losses.items()}
        return row

    @property
    def _is_checkpoint(self) -> bool:
        """Whether a checkpoint follows the last update: there stages and teachers change."""
        return self.n_done % self.config.checkpoint_n == 0 or self.n_steps >= self.config.steps_n

    def _require_finite(self, name: str, when: str) -> None:
        if not self.learners[name].is_finite:
            raise TrainingError(
                f"{when}: what agents of type {name} have learned is no longer finite, "
                f"ppo.learning_rate is {self.config.ppo.learning_rate!r}; valid: a smaller one"
            )

    @property
    def _knows_something(self) -> bool:
        """Whether there is a policy before PPO that is worth to be kept."""
        config = self.config
        return bool(config.ppo.clone_n or config.demonstrations or config.start_from)

    def _start_from(self, folder: Path) -> None:
        """Begin with what agents learned in another run."""
        path = folder / CHECKPOINT
        state = read_checkpoint(path)
        ppo = told_settings(path, told_config(path, state))
        known = [name for name in state["kinds"] if name in self.learners]
        if not known:
            told = ", ".join(state["kinds"])
            raise TrainingError(f"{path}: is of agents of the types {told}; valid: {', '.join(self.learners)}")
        for name in ("network", "hidden", "critic"):
            was, wanted = getattr(ppo, name), getattr(self.config.ppo, name)
            if was != wanted:
                raise TrainingError(f"{path}: ppo.{name} is {was!r}; valid: {wanted!r}, as in this run")
        if ppo.critic == "central" and state["n_state"] != self._n_state:
            raise TrainingError(f"{path}: states have {state['n_state']} numbers; valid: {self._n_state}")
        learners = [self.learners[name] for name in known]
        kinds = [learner.kind for learner in learners]
        # What was learned with all numbers goes on without some of them.
        require_kinds(path, {name: state["kinds"][name] for name in known}, kinds, but=frozenset({"unseen"}))
        for name, learner in zip(known, learners, strict=True):
            learner.begin_with(state["learners"][name])

    def _read_demonstrations(self, path: Path) -> dict[str, Demonstration]:
        """What a file says that is cloned before the first step, by type."""
        told = read_demonstrations(path)
        for name, one in told.items():
            if name not in self.learners:
                raise TrainingError(f"{path}: is of agents of type {name}; valid: {', '.join(self.learners)}")
            one.require(self.learners[name].kind, path)
        return told

    def _clone_demonstrations(self) -> None:
        """Clone what the file of demonstrations says, once."""
        ppo = self.config.ppo
        generator = _generator(self.config.seed, _DEMONSTRATIONS, 0)
        for name, one in self._demonstrations.items():
            self.learners[name].clone_samples(one, ppo.clone_epochs_n, ppo.learning_rate, generator)
            self._require_finite(name, f"demonstrations {self.config.demonstrations}")
        self._demonstrations = {}

    def _save(self) -> None:
        content = {
            "config": json.dumps(dataclasses.asdict(self.config)),
            "kinds": {name: described(learner.kind) for name, learner in self.learners.items()},
            "n_state": self._n_state,
            "done": self.n_done,
            "steps": self.n_steps,
            "rows": self.rows,
            "recent": list(self._recent),
            "cpu_s": self.cpu_s,
            "curriculum": self._curriculum.state(),
            "learners": {name: learner.state() for name, learner in self.learners.items()},
        }
        write_checkpoint(self._path, content)

    def _recall(self, state: Mapping[str, Any]) -> None:
        require_kinds(self._path, state["kinds"], [learner.kind for learner in self.learners.values()])
        untold = [name for row in state["rows"][-1:] for name in self.recipe.figures if name not in row]
        if untold:
            raise TrainingError(f"{self._path}: has no figure {untold[0]}; valid: a run of this version, begin it anew")
        self.n_done, self.n_steps = state["done"], state["steps"]
        self.rows, self.cpu_s = state["rows"], state["cpu_s"]
        self._recent.extend(state["recent"])
        self._curriculum.recall(state["curriculum"])
        for name, learner in self.learners.items():
            learner.recall(state["learners"][name])


def _figures(episode: EpisodeFigures) -> Row:
    """Figures of an episode as they go into a row."""
    return {"length": float(episode.length), "return": sum(episode.returns.values()), **episode.figures}


def _generator(seed: int, branch: int, update: int) -> torch.Generator:
    state = np.random.SeedSequence([seed, branch, update]).generate_state(2, dtype=np.uint32)
    return torch.Generator().manual_seed(int(state[0]) << 31 | int(state[1]) >> 1)


def _require_same(config: TrainConfig, told: dict[str, Any], path: Path) -> None:
    wanted = json.loads(json.dumps(dataclasses.asdict(config)))
    for name, value in wanted.items():
        was = told.get(name, [])  # runs of before `start_from` started from nothing
        if name == "ppo" and isinstance(was, dict):
            was = told_ppo(was)
        if isinstance(was, dict) and isinstance(value, dict):
            pairs = {f"{name}.{key}": (was.get(key), value.get(key)) for key in (*was, *value)}
        else:
            pairs = {name: (was, value)}
        for key, (before, now) in pairs.items():
            if before != now:
                raise TrainingError(f"{path}: {key} was {before!r} and is {now!r} now; valid: the same settings")
