"""Goals: figures of what was learned, from the episodes that it and others played, and what they should come to."""

from __future__ import annotations

import csv
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.harness import Row
from benchmarks.training.ratios import ratio
from fleet.charts.statistics import estimate
from fleet.training.intervals import share
from fleet.training.results import EPISODES, LEARNED, SCRIPTED

ORACLE = "rollout"
"""Policy of dispatch that plays the fleet on, in futures that it draws."""


def read_episodes(folder: Path) -> list[dict[str, str]]:
    """Scores of all policies in all episodes of an evaluation."""
    with (folder / EPISODES).open(encoding="utf-8", newline="") as table:
        return list(csv.DictReader(table))


def by_policy(folders: Sequence[Path]) -> dict[str, list[dict[str, str]]]:
    """Scores of all episodes of some evaluations, by policy."""
    found: dict[str, list[dict[str, str]]] = {}
    for row in (row for folder in folders for row in read_episodes(folder)):
        found.setdefault(row["policy"], []).append(row)
    return found


def mean_of(folders: Sequence[Path], figure: str, policy: str) -> float:
    """Mean of a figure over all episodes of some evaluations."""
    return float(np.mean([float(row[figure]) for row in by_policy(folders)[policy]]))


@dataclass(frozen=True, kw_only=True)
class Goal(ABC):
    """A figure of what was learned, from one evaluation for each seed of the training."""

    target: str
    """``<= x`` or ``>= x``."""

    @abstractmethod
    def row(self, folders: Sequence[Path]) -> Row:
        """The figure, without its target."""


@dataclass(frozen=True, kw_only=True)
class Success(Goal):
    """The lower end of the interval of the share of successes, all seeds' episodes together."""

    figures: tuple[str, ...]
    """Columns that count successes; one thing is counted in one of them."""
    of: str | None = None
    """Column that counts trials; None: an episode is one."""

    def row(self, folders: Sequence[Path]) -> Row:
        """The figure, without its target."""
        won, n = self.successes(folders)[LEARNED]
        return Row(name="success, lower end", value=share(won, n).low, unit=f"of 1, 95 %; {won} of {n}")

    def successes(self, folders: Sequence[Path]) -> dict[str, tuple[int, int]]:
        """Successes and trials, by policy, of some evaluations taken together."""
        found: dict[str, tuple[int, int]] = {}
        for row in (row for folder in folders for row in read_episodes(folder)):
            won, n = found.get(row["policy"], (0, 0))
            won += round(sum(float(row[figure]) for figure in self.figures))
            found[row["policy"]] = won, n + (1 if self.of is None else round(float(row[self.of])))
        return found


@dataclass(frozen=True, kw_only=True)
class Mean(Goal):
    """The mean of a figure over all seeds' episodes."""

    figure: str

    def row(self, folders: Sequence[Path]) -> Row:
        """The figure, without its target."""
        return Row(name=f"{self.figure}, mean", value=mean_of(folders, self.figure, LEARNED), unit="per episode")


@dataclass(frozen=True, kw_only=True)
class TimesScript(Goal):
    """A figure as a multiple of the script's: the worse end of its interval over the seeds."""

    figure: str

    def row(self, folders: Sequence[Path]) -> Row:
        """The figure, without its target."""
        pairs = [[mean_of([one], self.figure, policy) for policy in (LEARNED, SCRIPTED)] for one in folders]
        found = estimate([learned / max(scripted, 1e-9) for learned, scripted in pairs])
        assert found is not None
        value = found.mean if len(folders) == 1 else found.low if self.target.startswith(">") else found.high
        return Row(name=f"{self.figure}, worse end", value=value, unit="times the script's, 95 %")


@dataclass(frozen=True, kw_only=True)
class Saved(Goal):
    """What was learned saves over the script, each time something is done, as a share of what there is to save."""

    figure: str
    """Column of the sums."""
    count: str
    """Column that says how often it was done."""
    slack: float
    """What there is to save each time, in the script's episodes."""

    def row(self, folders: Sequence[Path]) -> Row:
        """The figure, without its target."""
        learned, scripted = (
            mean_of(folders, self.figure, policy) / max(mean_of(folders, self.count, policy), 1e-9)
            for policy in (LEARNED, SCRIPTED)
        )
        told = f"{scripted:.2f} to {learned:.2f}"
        return Row(name=f"{self.figure}, saved", value=(scripted - learned) / self.slack, unit=f"of the slack; {told}")


@dataclass(frozen=True, kw_only=True)
class Gap(Goal):
    """How much of what the oracle saves over the best of the rules was learned: the lower end of its interval.

    All seeds' episodes are taken together; each of them was played by everybody.
    """

    figure: str
    """Less of it is better."""

    def row(self, folders: Sequence[Path]) -> Row:
        """The figure, without its target; no number where the oracle saves nothing."""
        played = by_policy(folders)
        told = {policy: np.array([float(row[self.figure]) for row in rows]) for policy, rows in played.items()}
        learned, oracle = told.pop(LEARNED), told.pop(ORACLE)
        best = min(told, key=lambda policy: told[policy].mean())
        rule = told[best]
        unit = f"of 1, from {best} to {ORACLE}"
        if rule.mean() <= oracle.mean():
            return Row(name=f"{self.figure}, gap", value=float("nan"), unit=unit)
        found = ratio((rule - learned).tolist(), (rule - oracle).tolist())
        unit = f"{unit}, 95 %; mean {found.mean:.2f}"
        return Row(name=f"{self.figure}, gap, lower end", value=found.low, unit=unit)
