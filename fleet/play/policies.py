"""Policies that play a layer: scripted ones by their names, learned ones by the folders of their training runs."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fleet.envs.policies import POLICIES, Policy, make_policy
from fleet.errors import ConfigError
from fleet.play.decisions import Decisions
from fleet.training.errors import TrainingError
from fleet.training.recipes import RECIPES
from fleet.training.results import CHECKPOINT, CONFIG
from maps.errors import MapsError
from maps.reading.text_file import read_json

LAYERS = {"dispatch": "dispatch", "traffic": "traffic", "docking": "warehouse"}
"""Parts of a fleet that policies can play, and the environments in which such policies are learned."""
_OF_THE_RUN = frozenset(
    (
        "site",
        "n_cars",
        "n_arms",
        "classical_cars",
        "fidelity",
        "load",
        "max_cycles",
        "weights",
        "tasks",
        "team_share",
        "level",
        "start",
        "breakdowns",
        "ramp",
        "grants_hold",
    )
)
"""Settings of environments that a run has of its own, or that mean nothing in one."""


@dataclass(frozen=True, kw_only=True)
class LearnedRun:
    """A folder in which a training run has left what it learned."""

    folder: Path
    recipe: str
    """Name of the recipe."""
    arguments: Mapping[str, Any]
    """Of its environment."""
    environment: str
    """Name of the environment, with its version: `dispatch_v0`."""
    render_modes: tuple[str, ...]
    """Ways to show it."""

    @property
    def layer(self) -> str:
        """The environment without its version."""
        return self.environment.rpartition("_v")[0]

    def policy(self, seed: int) -> Policy:
        """What was learned.

        Args:
            seed: Of the actions that are drawn, if it plays so.

        Raises:
            TrainingError: PyTorch is not installed, or the checkpoint cannot be read.
        """
        if importlib.util.find_spec("torch") is None:
            raise TrainingError(
                f"{self.folder}: a learned policy needs PyTorch, which is not installed; valid: pip install '.[train]'"
            )
        from fleet.training.ppo.policy import load_policy

        policy: Policy = load_policy(self.folder, seed=seed)
        return policy

    def require_fits(self, policy: Any, env: Any) -> None:
        """Refuse an environment whose agents see or do something else than was learned.

        Args:
            policy: What was learned here.
            env: The environment that it is to play.

        Raises:
            TrainingError: They do.
        """
        try:
            policy.check(env)
        except TrainingError as error:
            raise TrainingError(f"{self.folder}, in {env.metadata['name']}: {error}") from error


@dataclass(frozen=True, kw_only=True)
class PlayedPolicy:
    """A policy that plays one layer of a run."""

    policy: Policy
    """Decides."""
    decisions: Decisions
    """Counts what it decides."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the layer's environment that it knows the fleet by."""
    learned: LearnedRun | None = None
    """Where it was learned; None = scripted."""

    def require_fits(self, env: Any) -> None:
        """Refuse an environment whose agents see or do something else than the policy has learned.

        Raises:
            TrainingError: They do.
        """
        if self.learned is not None:
            self.learned.require_fits(self.policy, env)


def learned_run(folder: Path) -> LearnedRun:
    """Look at a folder of a training run.

    Raises:
        TrainingError: There is no checkpoint in it, or its recipe or environment is none of this version.
    """
    if not (folder / CHECKPOINT).is_file():
        raise TrainingError(f"{folder}: there is no {CHECKPOINT}; valid: a folder of fleet train")
    try:
        told = read_json(folder / CONFIG)
        recipe, arguments = str(told["env"]), dict(told["arguments"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise TrainingError(f"{folder / CONFIG}: cannot be read; valid: what fleet train wrote") from error
    if recipe not in RECIPES:
        raise TrainingError(f"{folder}: was trained by recipe {recipe!r}; valid: {', '.join(RECIPES)}")
    try:
        env = RECIPES[recipe].make(**arguments)
    except (ConfigError, MapsError, TypeError) as error:  # TypeError: of a single robot's environment
        raise TrainingError(f"{folder}: its environment is none of this version: {error}") from error
    env.close()
    return LearnedRun(
        folder=folder,
        recipe=recipe,
        arguments=arguments,
        environment=str(env.metadata["name"]),
        render_modes=tuple(env.metadata.get("render_modes", ())),
    )


def played_policy(part: str, told: str, seed: int) -> PlayedPolicy:
    """Find the policy that is to play a part of a fleet.

    Args:
        part: A name in `LAYERS`.
        told: Name of a scripted policy of its layer, or folder of a training run.
        seed: Source of chance, of scripted policies that leave anything to it.

    Raises:
        TrainingError: It is neither; or the run learned something else.
    """
    layer = LAYERS[part]
    if told in POLICIES[layer]:
        return PlayedPolicy(policy=make_policy(layer, told, seed), decisions=Decisions(policy=told))
    if not Path(told).is_dir():
        valid = f"{', '.join(POLICIES[layer])}, or a folder of fleet train"
        raise TrainingError(f"--{part} is {told!r}; valid: {valid}")
    run = learned_run(Path(told))
    if run.layer != layer:
        fits = ", ".join(f"--{name}" for name, of in LAYERS.items() if of == run.layer) or "fleet play RUN"
        raise TrainingError(f"--{part} {told}: was trained in {run.environment}; valid: one of {layer}, or {fits}")
    return PlayedPolicy(
        policy=run.policy(seed),
        decisions=Decisions(policy=told),
        settings={name: value for name, value in run.arguments.items() if name not in _OF_THE_RUN},
        learned=run,
    )
