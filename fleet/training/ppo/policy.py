"""LearnedPolicy: plays what was learned; and a checkpoint as one."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from fleet.training.batch import AgentType, TypeView, agent_types, mask_of, type_of, vector
from fleet.training.errors import TrainingError
from fleet.training.ppo.checkpoint import read_checkpoint
from fleet.training.ppo.learner import Learner
from fleet.training.recipes import RECIPES
from fleet.training.recipes.recipe import Play
from fleet.training.results import CHECKPOINT
from fleet.training.settings import PpoConfig


class LearnedPolicy:
    """Does what was learned.

    Args:
        learners: By type.
        chance: Seed of the source of actions that are drawn from what was learned; None: always the likeliest ones.
    """

    def __init__(self, learners: Mapping[str, Learner], chance: int | None = None) -> None:
        self._learners = dict(learners)
        self._generator = None if chance is None else torch.Generator().manual_seed(chance % 2**63)

    def seeded(self, seed: int) -> LearnedPolicy:
        """The same policy; if it draws its actions, from a source of its own with this seed."""
        return LearnedPolicy(self._learners, None if self._generator is None else seed)

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """Actions of all agents that observe; `env` is not used.

        Raises:
            TrainingError: An agent is of a type that was not trained, or observes something else.
        """
        del env
        actions: dict[str, Any] = {}
        with _one_thread():
            for learner, agents, view in self._views(observations):
                actions.update(zip(agents, learner.act(view, self._generator), strict=True))
        return actions

    def scores(self, observations: Mapping[str, Any]) -> dict[str, npt.NDArray[np.float32]]:
        """Logarithms of the probabilities of discrete actions, or the middle of continuous ones, by agent.

        Raises:
            TrainingError: An agent is of a type that was not trained, or observes something else.
        """
        found: dict[str, npt.NDArray[np.float32]] = {}
        with _one_thread():
            for learner, agents, view in self._views(observations):
                found.update(zip(agents, learner.scores(view), strict=True))
        return found

    def check(self, env: Any) -> None:
        """Make sure that it can play an environment.

        Raises:
            TrainingError: Agents are of a type that was not trained, or see or do something else.
        """
        for kind in agent_types(env):
            known = self._known(kind.name).kind
            if (kind.n_observed, kind.action, kind.masked) != (known.n_observed, known.action, known.masked):
                raise TrainingError(
                    f"agents of type {kind.name} observe {kind.n_observed} numbers and do {kind.action}; "
                    f"valid: {known.n_observed} and {known.action}, on which the policy was trained"
                )

    def _views(self, observations: Mapping[str, Any]) -> list[tuple[Learner, list[str], TypeView]]:
        """What the agents of each type see."""
        teams: dict[str, list[str]] = {}
        for agent in observations:
            teams.setdefault(type_of(agent), []).append(agent)
        views = []
        for name, agents in teams.items():
            learner = self._known(name)
            kind = learner.kind
            seen = [observations[agent] for agent in agents]
            rows = np.stack([vector(one) for one in seen])
            if rows.shape[1] != kind.n_observed:
                raise TrainingError(
                    f"agents of type {name} observe {rows.shape[1]} numbers; "
                    f"valid: {kind.n_observed}, on which the policy was trained"
                )
            mask = np.stack([mask_of(one, kind) for one in seen]) if kind.masked else None
            views.append((learner, agents, TypeView(rows=rows, mask=mask, active=np.ones(len(rows), dtype=np.bool_))))
        return views

    def _known(self, name: str) -> Learner:
        if name not in self._learners:
            raise TrainingError(f"agents of type {name} were not trained; valid: {', '.join(self._learners)}")
        return self._learners[name]


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Let PyTorch compute with one thread: with a few rows, several threads wait for each other most of the time."""
    n_threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(n_threads)


def load_policy(folder: str | Path, *, play: Play | None = None, seed: int = 0) -> LearnedPolicy:
    """What a training run has learned.

    Args:
        folder: Where it wrote its checkpoint.
        play: Whether actions are the likeliest ones or drawn; None: as its recipe says.
        seed: Of the actions that are drawn.

    Raises:
        TrainingError: There is no checkpoint, it cannot be read, or it is of a recipe or an environment that is not the
            one of today.
    """
    path = Path(folder) / CHECKPOINT
    state = read_checkpoint(path)
    told = told_config(path, state)
    if told["env"] not in RECIPES:
        raise TrainingError(f"{path}: is of the recipe {told['env']}; valid: {', '.join(RECIPES)}")
    recipe = RECIPES[told["env"]]
    kinds, _ = recipe.survey(told["arguments"], told["held"])
    require_kinds(path, state["kinds"], kinds)
    ppo = told_settings(path, told)
    learners = {kind.name: Learner(kind, ppo, state["n_state"], torch.Generator()) for kind in kinds}
    for name, learner in learners.items():
        learner.recall(state["learners"][name])
    return LearnedPolicy(learners, seed if (play or recipe.plays[0]) == "drawn" else None)


def told_config(path: Path, state: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration in a checkpoint.

    Raises:
        TrainingError: It cannot be read.
    """
    try:
        told: dict[str, Any] = json.loads(state["config"])
        missing = [name for name in ("env", "arguments", "held", "ppo") if name not in told]
    except (ValueError, TypeError) as error:
        raise TrainingError(f"{path}: its config cannot be read; valid: what a training run wrote") from error
    if missing:
        raise TrainingError(f"{path}: its config has no {missing[0]}; valid: what a training run wrote")
    return told


def told_settings(path: Path, told: Mapping[str, Any]) -> PpoConfig:
    """Settings of the algorithm, as the configuration in a checkpoint tells them.

    Raises:
        TrainingError: They are of another version.
    """
    ppo = told["ppo"] if isinstance(told["ppo"], dict) else {}
    names = [one.name for one in dataclasses.fields(PpoConfig)]
    if not {"hidden"} <= set(ppo) <= set(names):
        other = sorted(set(ppo) - set(names)) or ["no hidden"]
        raise TrainingError(f"{path}: ppo has {', '.join(other)}; valid: settings of this version, {', '.join(names)}")
    return PpoConfig(**{**ppo, "hidden": tuple(ppo["hidden"])})


def described(kind: AgentType) -> dict[str, Any]:
    """What a policy of these agents depends on, as a checkpoint keeps it."""
    layout = json.loads(json.dumps(dataclasses.asdict(kind.layout)))
    unseen = layout.pop("unseen")
    numbers = {"observes": kind.n_observed, "does": str(kind.action), "masked": kind.masked}
    return {**numbers, "layout": layout, "unseen": unseen}


def require_kinds(
    path: Path, told: Mapping[str, Any], kinds: Sequence[AgentType], but: frozenset[str] = frozenset()
) -> None:
    """Make sure that a checkpoint is of these agents.

    Args:
        path: Of the checkpoint.
        told: What it says of its agents, by type.
        kinds: The agents.
        but: Names of what may differ.

    Raises:
        TrainingError: It is of others.
    """
    if set(told) != {kind.name for kind in kinds}:
        names = ", ".join(kind.name for kind in kinds)
        raise TrainingError(f"{path}: is of agents of the types {', '.join(told)}; valid: {names}")
    for kind in kinds:
        for name, value in described(kind).items():
            was = told[kind.name].get(name, [])  # checkpoints of before show all
            if name not in but and was != value:
                raise TrainingError(
                    f"{path}: agents of type {kind.name}: {name} was {was!r} and is {value!r} now; "
                    f"valid: a checkpoint of this version of the environment"
                )
