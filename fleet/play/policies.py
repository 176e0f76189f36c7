"""Policies that play a layer: scripted ones by their names, learned ones by the folders of their training runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fleet.envs.policies import POLICIES, Policy, make_policy
from fleet.play.decisions import Decisions
from fleet.training.errors import TrainingError
from fleet.training.learned_run import LearnedRun, learned_run

LAYERS = {"dispatch": "dispatch", "traffic": "traffic", "docking": "warehouse"}
"""Parts of a fleet that policies can play, and the environments in which such policies are learned."""
_OF_ARMS = frozenset(("planned_arms", "pointing_arms"))
"""Policies of the warehouse layer that drive no car."""
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
        "breakdowns_per_h",
        "repair_s",
        "lost_share",
        "charge_s",
        "stream",
        "floor",
        "seed",
        "render_mode",
        "record_to",
    )
)
"""Settings of environments that a run has of its own, or that mean nothing in one."""


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
    scripted = [name for name in POLICIES[layer] if name not in _OF_ARMS]
    if told in scripted:
        return PlayedPolicy(policy=make_policy(layer, told, seed), decisions=Decisions(policy=told))
    if not Path(told).is_dir():
        valid = f"{', '.join(scripted)}, or a folder of fleet train"
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
