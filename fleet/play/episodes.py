"""Episodes: what was learned plays the environment that it was learned in, with figures and recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from fleet.envs.core.env_config import UnknownSetting
from fleet.envs.policies import Policy
from fleet.errors import ConfigError
from fleet.outputs import require_folder
from fleet.training.errors import TrainingError
from fleet.training.evaluation import Score, play
from fleet.training.learned_run import LearnedRun
from fleet.training.recipes import RECIPES
from fleet.training.results import CHECKPOINT, EPISODES

RERUN = "rerun"
"""Render mode of environments that record their episodes."""
OPTIONS = {"--site": "site", "--robots": "n_cars", "--fidelity": "fidelity"}
"""Options of the command line, and what environments call them."""


def play_episodes(
    run: LearnedRun,
    policies: Mapping[str, Policy],
    changes: Mapping[str, Any],
    seeds: Sequence[int],
    folder: Path,
    on_episode: Callable[[int], None],
    interrupted: Sequence[int] = (),
    *,
    record: bool,
) -> dict[str, list[Score]]:
    """Let policies play episodes of the environment in which one of them was learned.

    Args:
        run: Where.
        policies: By name; the first one is what was learned, and is recorded.
        changes: What differs from the training, by option in `OPTIONS`.
        seeds: Of the episodes.
        folder: Made once it is known that they can play; recordings of an earlier call are removed.
        on_episode: Called with the number of episodes played so far.
        interrupted: No longer empty when no further episode is to begin; a `KeyboardInterrupt` ends the one under way,
            too.
        record: Whether each episode of the first policy is recorded in the folder.

    Returns:
        Scores by policy, in the order of the seeds; fewer where it was interrupted, and nobody who played nothing.

    Raises:
        TrainingError: The environment has no such option, cannot record, or its agents see something else then.
        ConfigError: A value is outside its valid range.
    """
    recipe = RECIPES[run.recipe]
    scores: dict[str, list[Score]] = {name: [] for name in policies}
    for index, (name, policy) in enumerate(policies.items()):
        if interrupted:
            break
        recorded = {"render_mode": RERUN, "record_to": folder} if record and not index else {}
        env = _made(run, changes, recorded)
        try:
            if not index:
                run.require_fits(policy, env)
                _make_way(folder)
            for seed in seeds:
                if interrupted:
                    break
                scores[name].append(play(env, policy, seed, recipe.figures, recipe.at_end))
                on_episode(sum(map(len, scores.values())))
        except KeyboardInterrupt:  # a second one: the episode that was under way is lost, not those before it
            break
        finally:
            env.close()
    return {name: played for name, played in scores.items() if played}


def require_output(folder: Path) -> None:
    """See that figures can be written into a folder, before hours of playing; leaves nothing behind.

    Raises:
        ConfigError: It cannot be made or written.
        TrainingError: It holds a training run, whose figures have the same name, or a directory where a file belongs.
    """
    require_folder("--out", folder)
    if (folder / CHECKPOINT).exists():
        raise TrainingError(f"--out {folder}: holds a training run; valid: another directory")
    for path in (folder / EPISODES, *recordings(folder)):
        if path.is_dir():
            raise TrainingError(f"--out {folder}: {path.name} is a directory; valid: a file, or nothing there")


def recordings(folder: Path) -> list[Path]:
    """Recordings of episodes in a folder, in their order."""
    return [path for path in sorted(folder.glob("episode_*.rrd")) if path.stem.removeprefix("episode_").isdecimal()]


def _make_way(folder: Path) -> None:
    """Make a folder, or remove the recordings that are in it; figures take the place of others by themselves."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path in recordings(folder):
            path.unlink()
    except OSError as error:
        raise TrainingError(f"--out {folder}: {error.strerror}; valid: a directory that can be written") from error


def _made(run: LearnedRun, changes: Mapping[str, Any], recorded: Mapping[str, Any]) -> Any:
    arguments = {OPTIONS[option]: value for option, value in changes.items()}
    try:
        return RECIPES[run.recipe].make(**{**run.arguments, **arguments, **recorded})
    except UnknownSetting as error:
        unknown = [option for option in changes if f"unknown setting {OPTIONS[option]};" in str(error)]
        if not unknown:
            raise TrainingError(f"{run.folder}: {error}; valid: what {run.environment} knows") from error
        option = unknown[0]
        raise TrainingError(f"{option} means nothing in {run.environment}; valid: without {option}") from error
    except ConfigError as error:
        for option, name in OPTIONS.items():
            if str(error).startswith(f"{name} "):
                raise ConfigError(str(error).replace(name, option, 1)) from error
        raise
