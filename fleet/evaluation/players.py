"""Players: policies by the word that names them - a script, a training folder, or a class of one's own."""

from __future__ import annotations

import hashlib
import importlib
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fleet.envs.policies import POLICIES
from fleet.envs.policies.policy import Policy, Random
from fleet.evaluation.errors import PolicyError
from fleet.evaluation.scenarios import Scenario
from fleet.training.errors import TrainingError
from fleet.training.learned_run import learned_run
from fleet.training.recipes import RECIPES
from fleet.training.results import CHECKPOINT

ENVIRONMENT, TEAM_SIZES = "environment", "team_sizes"
"""What a class of one's own may say of itself: the environment with its version that it plays, as one text or several;
and its smallest and largest team."""


@dataclass(frozen=True, kw_only=True)
class Player:
    """A policy that can be had."""

    name: str
    """The word that names it."""
    make: Callable[[int], Policy]
    """Makes it for one episode, whose seed is its source of chance."""
    digest: str = ""
    """SHA-256 of the file that it is made from; nothing for a script of the project."""
    trained_on: str | None = None
    """Environment with version that it was trained on, of a training folder."""

    def check(self, scenario: Scenario, env: Any) -> None:
        """See that it can play an environment.

        Raises:
            PolicyError: It plays another environment, version or size of team, or says so in no known form.
            TrainingError: It was trained on other observations or actions.
        """
        now = env.metadata["name"]
        if self.trained_on not in (None, now):
            raise PolicyError(f"--policy {self.name} was trained on {self.trained_on}; valid: one trained on {now}")
        policy = self.make(0)
        if self.trained_on is not None:
            try:
                policy.check(env)  # type: ignore[attr-defined]  # only the trainer's own folder may import PyTorch
            except TrainingError as reason:
                raise TrainingError(f"--policy {self.name}: {reason}") from reason
            return
        names, sizes = self._environments(policy), self._team_sizes(policy)
        if names and scenario.env not in names:
            raise PolicyError(f"--policy {self.name} plays {', '.join(names)}; valid: one that plays {scenario.env}")
        n = len(env.possible_agents)
        if sizes and not sizes[0] <= n <= sizes[1]:
            raise PolicyError(f"--policy {self.name} cannot play {n} agents; valid: {sizes[0]} to {sizes[1]}")

    def _environments(self, policy: Policy) -> tuple[str, ...]:
        """What a policy says that it plays; empty: nothing."""
        told = getattr(policy, ENVIRONMENT, ())
        names = (told,) if isinstance(told, str) else told
        if not isinstance(names, tuple | list) or not all(isinstance(name, str) for name in names):
            raise PolicyError(f"--policy {self.name}: {ENVIRONMENT} is {told!r}; valid: one text or several")
        return tuple(names)

    def _team_sizes(self, policy: Policy) -> tuple[int, ...]:
        """Smallest and largest team that a policy says that it plays; empty: it does not say."""
        told = getattr(policy, TEAM_SIZES, ())
        pair = isinstance(told, tuple | list) and len(told) in (0, 2) and all(isinstance(size, int) for size in told)
        if not pair:
            raise PolicyError(f"--policy {self.name}: {TEAM_SIZES} is {told!r}; valid: two whole numbers")
        return tuple(told)


def player_named(word: str, scenario: Scenario) -> Player:
    """The policy that a word means.

    Args:
        word: A name in `POLICIES` of the scenario's layer; a folder of `fleet.train`; or `package.module:Class`, which
            is made with a seed and has `act(env, observations)`.
        scenario: What it is to play.

    Raises:
        PolicyError: There is no such policy; says what is valid.
    """
    scripts = scripts_of(scenario)
    if word in scripts:
        return Player(name=word, make=scripts[word])
    if Path(word).is_dir():
        return _learned(Path(word))
    if ":" in word:
        return _own(word)
    elsewhere = [layer for layer, table in POLICIES.items() if word in table]
    what = f"one of layer {', '.join(elsewhere)}" if elsewhere else "no policy"
    valid = f"{', '.join(scripts)}, a folder of fleet train, or package.module:Class"
    raise PolicyError(f"--policy {word} is {what} for {scenario.env}; valid: {valid}")


def scripts_of(scenario: Scenario) -> Mapping[str, Callable[[int], Policy]]:
    """Scripted policies of a scenario, by name; a layer without a table has chance and its recipe's `script`."""
    layer = scenario.layer
    if layer in POLICIES:
        return POLICIES[layer]
    return {"random": Random, "script": lambda seed: RECIPES[layer].scripted()}


def _own(word: str) -> Player:
    valid = "package.module:Class with act(env, observations), made with a seed"
    module, _, name = word.partition(":")
    try:
        home = importlib.import_module(module)
        kind = getattr(home, name)
    except (ImportError, AttributeError, ValueError) as reason:
        raise PolicyError(f"--policy {word}: {reason}; valid: {valid}") from reason
    except (Exception, SystemExit) as reason:  # whatever a module does when it is imported
        raise PolicyError(f"--policy {word}: {told(reason)}; valid: {valid}") from reason
    if not callable(getattr(kind, "act", None)):
        raise PolicyError(f"--policy {word}: {name} has no act; valid: {valid}")

    def make(seed: int) -> Policy:
        try:
            made: Policy = kind(seed)
        except (Exception, SystemExit) as reason:
            raise PolicyError(f"--policy {word} cannot be made with a seed: {told(reason)}; valid: {valid}") from reason
        return made

    file = getattr(home, "__file__", None)
    return Player(name=word, make=make, digest=_digest(Path(file)) if file else "")


def _learned(folder: Path) -> Player:
    try:
        run = learned_run(folder)
        learned = run.policy(seed=0)
    except TrainingError as reason:
        raise PolicyError(f"--policy {reason}") from reason
    return Player(
        name=folder.as_posix(),
        make=learned.seeded,
        digest=_digest(folder / CHECKPOINT),
        trained_on=run.environment,
    )


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def told(reason: BaseException) -> str:
    """An error of somebody else's code in one line, with its place."""
    at = traceback.extract_tb(reason.__traceback__)[-1]
    return f"{type(reason).__name__}: {reason} ({Path(at.filename).name}, line {at.lineno})"
