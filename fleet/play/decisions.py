"""Decisions: how much of what a part decided was the policy's, and why the classical part decided the rest."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fleet.whole_file import write_whole


@dataclass(kw_only=True)
class Decisions:
    """What one part had to decide in a run, counted robot by robot."""

    policy: str
    """Who decides, as it was named."""
    n_made: int = 0
    """Decisions in which there was something to choose."""
    n_policy: int = 0
    """Those that were the policy's, and legal."""
    n_granted: int = 0
    """Those of the policy's that were carried out as they were meant; the others had to wait for another robot."""
    n_fallback: Counter[str] = field(default_factory=Counter)
    """Those that the classical part took instead, by reason."""

    @property
    def policy_share(self) -> float | None:
        """Share of the decisions that were the policy's; None if there was none."""
        return self.n_policy / self.n_made if self.n_made else None

    def fall_back(self, reason: str, n: int = 1) -> None:
        """Count decisions that were not the policy's."""
        self.n_made += n
        self.n_fallback[reason] += n

    def decide(self, n: int, granted: int) -> None:
        """Count legal decisions of the policy, and how many of them were carried out."""
        self.n_made += n
        self.n_policy += n
        self.n_granted += granted

    def told(self) -> dict[str, Any]:
        """All figures, as they go into a file."""
        share = self.policy_share
        fallback = dict(sorted(self.n_fallback.items()))
        return {**vars(self), "n_fallback": fallback, "policy_share": None if share is None else round(share, 6)}

    def __str__(self) -> str:
        share = self.policy_share
        text = f"{self.policy}: " + (
            "nothing to decide" if share is None else f"{100.0 * share:.1f} % of {self.n_made} decisions"
        )
        text += f", {self.n_granted} carried out as meant"
        why = ", ".join(f"{n} {reason}" for reason, n in sorted(self.n_fallback.items()))
        return f"{text}; the classical part took {why}" if why else text


def write_decisions(path: Path, decisions: Mapping[str, Decisions]) -> None:
    """Write the figures of all layers, whole or not at all."""
    told = {layer: one.told() for layer, one in decisions.items()}
    write_whole(path, json.dumps(told, indent=2) + "\n")
