"""Policies that play a layer: scripted ones by name, learned ones by the folder of their training run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fleet.envs.policies import POLICIES, Policy, make_policy
from fleet.play.decisions import Decisions


@dataclass(frozen=True, kw_only=True)
class PlayedPolicy:
    """A policy that plays one layer of a run."""

    policy: Policy
    """Decides."""
    decisions: Decisions
    """Counts what it decides."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the layer's environment that it knows the fleet by."""


def policy_of(layer: str, told: str, seed: int) -> PlayedPolicy:
    """Scripted only, for the moment."""
    return PlayedPolicy(policy=make_policy(layer, told, seed), decisions=Decisions(policy=told))
