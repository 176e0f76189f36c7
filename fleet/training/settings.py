"""Settings of a training run: dataclasses, and the TOML file that changes them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fleet.config import require
from fleet.config.field_checks import is_number
from fleet.training.errors import TrainingError
from maps.reading.shown import named, shown
from maps.reading.text_file import FileError, parse_toml, read_text

NETWORKS, CRITICS = ("perceptron", "attention"), ("own", "central")
_FORM = "TOML with steps_n, checkpoint_n and tables [ppo] and [env]"
N_HEADS = 4
"""Of attention."""
COLDEST = 1e-6
"""Least temperature: divided by less, worths leave the range of 32 bits."""
MOST_SAMPLES, WIDEST = 10_000_000, 16_384
"""Samples of an update, and width of a layer, that fit into memory."""


@dataclass(frozen=True, kw_only=True)
class PpoConfig:
    """Proximal policy optimisation, after cloning a teacher; the names are those of the paper.

    Source: J. Schulman et al., "Proximal Policy Optimization Algorithms", arXiv:1707.06347, 2017; of the details that
    matter (S. Huang et al., "The 37 Implementation Details of PPO", ICLR blog track, 2022) those that are named here.
    """

    envs_n: int = 8
    """Environments that are stepped side by side."""
    horizon_n: int = 128
    """Steps of every environment between two updates (T)."""
    epochs_n: int = 6
    """Times that each sample is used."""
    minibatch_n: int = 1024
    """Samples per gradient step (M)."""
    learning_rate: float = 7e-4
    """At the start; it falls in a straight line."""
    learning_rate_end: float = 0.0
    """At the end."""
    discount: float = 0.98
    """gamma."""
    gae: float = 0.95
    """lambda of generalised advantage estimation."""
    clip: float = 0.2
    """epsilon of the clipped objective."""
    entropy: float = 0.0
    """Weight of the entropy bonus (c2)."""
    value: float = 0.5
    """Weight of the value loss (c1)."""
    max_grad_norm: float = 0.5
    """Gradients are scaled down to this norm."""
    divergence: float = 0.0
    """An update ends after the epoch in which the approximate divergence from the old policy is more; 0: never."""
    hidden: tuple[int, ...] = (64, 64)
    """Widths of the hidden layers, of policy and value alike; with attention, what describes a thing is as wide as the
    first of them."""
    log_std: float = -0.5
    """Logarithm of the standard deviation of continuous actions at the start."""
    network: str = "perceptron"
    """`perceptron`, or `attention`: things that the layout names are looked at together before one is chosen."""
    critic: str = "own"
    """What the value is told: `own`, what the agent sees (IPPO), or `central`, that and `state()` (MAPPO)."""
    clone_n: int = 0
    """Steps of agents at the start in which the recipe's teacher is cloned."""
    clone_own: float = 0.5
    """Share of the environments in which agents meanwhile do what they have learned, and the teacher only says what it
    would do (S. Ross et al., "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
    Learning", AISTATS 2011)."""
    clone_all: bool = False
    """Whether every update clones all that a teacher has said so far, not only what it said in the latest steps (the
    paper's aggregated data set): where choices are rare, a few steps hold too few."""
    clone_temperature: float = 0.0
    """Of teachers that say what each action is worth: the agent learns to do each as often as the softmax of worths
    over this says, so that it is told how much better one is, and not only which; 0: what the teacher did. With
    `clone_n` it needs `clone_all`. Source: S. Ross, J. A. Bagnell, "Reinforcement and Imitation Learning via
    Interactive No-Regret Learning", arXiv:1406.5979, 2014, who learn from worths, by another loss."""
    clone_epochs_n: int = 10
    """Times that each sample of a file of demonstrations is used, before the first step."""
    anchor: float = 0.0
    """Weight of the divergence from the policy that was cloned, or that the run started from, after that; it falls to
    zero in a straight line."""

    def __post_init__(self) -> None:
        for name in ("envs_n", "horizon_n", "epochs_n", "minibatch_n", "clone_epochs_n"):
            value = getattr(self, name)
            require(1 <= value <= MOST_SAMPLES, f"ppo.{name}", value, f"an integer from 1 to {MOST_SAMPLES}")
        n_steps = self.envs_n * self.horizon_n
        require(n_steps <= MOST_SAMPLES, "ppo.envs_n * ppo.horizon_n", n_steps, f"at most {MOST_SAMPLES}")
        require(self.clone_n >= 0, "ppo.clone_n", self.clone_n, "an integer >= 0")
        for name in ("learning_rate", "clip", "max_grad_norm"):
            value = getattr(self, name)
            require(is_number(value) and value > 0, f"ppo.{name}", value, "a number > 0")
        for name in ("discount", "gae", "clone_own"):
            require(0.0 <= getattr(self, name) <= 1.0, f"ppo.{name}", getattr(self, name), "a number from 0 to 1")
        for name in ("entropy", "value", "learning_rate_end", "divergence", "anchor"):
            value = getattr(self, name)
            require(is_number(value) and value >= 0, f"ppo.{name}", value, "a number >= 0")
        value = self.clone_temperature
        valid = f"0, or a number from {COLDEST:g}"
        require(value == 0 or (is_number(value) and value >= COLDEST), "ppo.clone_temperature", value, valid)
        soft_ok = self.clone_all or not self.clone_n or not self.clone_temperature
        require(soft_ok, "ppo.clone_temperature", self.clone_temperature, "0, or more with clone_all")
        require(-20.0 <= self.log_std <= 2.0, "ppo.log_std", self.log_std, "a number from -20 to 2")
        widths_ok = bool(self.hidden) and min(self.hidden) >= 1 and max(self.hidden) <= WIDEST
        require(widths_ok, "ppo.hidden", self.hidden, f"widths from 1 to {WIDEST}")
        require(self.network in NETWORKS, "ppo.network", self.network, ", ".join(NETWORKS))
        require(self.critic in CRITICS, "ppo.critic", self.critic, ", ".join(CRITICS))
        fits = self.network != "attention" or self.hidden[0] % N_HEADS == 0
        require(fits, "ppo.hidden", self.hidden, f"with attention, a first width that {N_HEADS} divides")


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Everything that decides the outcome of a training run."""

    env: str
    """Name in `fleet.training.recipes.RECIPES`."""
    seed: int = 0
    steps_n: int
    """Steps of agents: one environment with four agents makes four per step."""
    checkpoint_n: int = 10
    """Updates between two checkpoints; environments begin new episodes after each, so that a resumed run is exact."""
    arguments: dict[str, Any] = field(default_factory=dict)
    """Arguments of the environment."""
    held: tuple[str, ...] = ()
    """Names of those that no stage of the recipe changes, because they were asked for."""
    demonstrations: str | None = None
    """File with what a teacher did, which is cloned before the first step (`fleet.training.demonstrations`)."""
    start_from: tuple[str, ...] = ()
    """Folders of runs: agents of the types that were trained there begin with what they learned, those of the last
    folder that knows them."""
    ppo: PpoConfig

    def __post_init__(self) -> None:
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        require(self.steps_n >= 1, "--steps, steps_n", self.steps_n, "an integer >= 1")
        require(self.checkpoint_n >= 1, "checkpoint_n", self.checkpoint_n, "an integer >= 1")


def told_ppo(ppo: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of PPO as JSON of a run tells them; those that it is older than are as they come."""
    return {**json.loads(json.dumps(dataclasses.asdict(PpoConfig()))), **ppo}


def read_settings(path: Path) -> dict[str, Any]:
    """Read a settings file: `steps_n` and `checkpoint_n` at its top, tables `[ppo]` and `[env]`.

    Args:
        path: A TOML file; `[ppo]` sets fields of `PpoConfig`, `[env]` arguments of the environment.

    Returns:
        Its content.

    Raises:
        TrainingError: It cannot be read, or has a key that means nothing or a value of the wrong type.
    """
    where = f"--config {path}"
    try:
        content = parse_toml(read_text(path, where, valid=_FORM), where, valid=_FORM)
    except FileError as error:
        raise TrainingError(str(error)) from error
    _refuse_unknown(path, "", content, ("steps_n", "checkpoint_n", "ppo", "env"))
    for table in ("ppo", "env"):
        if not isinstance(content.get(table, {}), dict):
            raise TrainingError(f"--config {path}: {table} is {shown(content[table])}; valid: a table [{table}]")
    for name in ("steps_n", "checkpoint_n"):
        if not _is_like(content.get(name, 1), 1):
            raise TrainingError(f"--config {path}: {name} is {shown(content[name])}; valid: an integer")
    fields = {one.name: one.default for one in dataclasses.fields(PpoConfig)}
    ppo = content.get("ppo", {})
    _refuse_unknown(path, "ppo.", ppo, tuple(fields))
    for name, value in ppo.items():
        if not _is_like(value, fields[name]):
            raise TrainingError(f"--config {path}: ppo.{name} is {shown(value)}; valid: a value like {fields[name]!r}")
    if "hidden" in ppo:
        content["ppo"] = {**ppo, "hidden": tuple(ppo["hidden"])}
    return content


def _refuse_unknown(path: Path, where: str, found: dict[str, Any], valid: tuple[str, ...]) -> None:
    for name in found:
        if name not in valid:
            raise TrainingError(f"--config {path}: unknown key {where}{named(name)}; valid: {', '.join(valid)}")


def _is_like(value: object, default: object) -> bool:
    if isinstance(default, str):
        return isinstance(value, str)
    if isinstance(default, tuple):
        return isinstance(value, list) and all(isinstance(x, int) and not isinstance(x, bool) for x in value)
    if isinstance(value, bool) or isinstance(default, bool):
        return isinstance(value, bool) and isinstance(default, bool)
    return isinstance(value, int) or (isinstance(default, float) and isinstance(value, float))
