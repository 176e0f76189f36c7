"""LearnedRun: a folder in which a training run has left what it learned."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fleet.errors import ConfigError
from fleet.training.errors import TrainingError
from fleet.training.recipes import RECIPES
from fleet.training.results import CHECKPOINT, CONFIG
from maps.errors import MapsError
from maps.reading.text_file import read_json

if TYPE_CHECKING:
    from fleet.training.ppo.policy import LearnedPolicy


@dataclass(frozen=True, kw_only=True)
class LearnedRun:
    """A folder in which a training run has left what it learned."""

    folder: Path
    recipe: str
    """Name of the recipe."""
    arguments: Mapping[str, Any]
    """Of its environment."""
    environment: str
    """Name of the environment, with its version: `dispatch_v1`."""
    render_modes: tuple[str, ...]
    """Ways to show it."""

    @property
    def layer(self) -> str:
        """The environment without its version."""
        return self.environment.rpartition("_v")[0]

    def policy(self, seed: int) -> LearnedPolicy:
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

        return load_policy(self.folder, seed=seed)

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
    except (ConfigError, TrainingError, MapsError) as error:
        raise TrainingError(f"{folder}: its environment is none of this version: {error}") from error
    env.close()
    return LearnedRun(
        folder=folder,
        recipe=recipe,
        arguments=arguments,
        environment=str(env.metadata["name"]),
        render_modes=tuple(env.metadata.get("render_modes", ())),
    )
