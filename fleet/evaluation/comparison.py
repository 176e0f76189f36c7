"""Comparison: means with intervals, and what a policy gains over the scripted fleet on the same seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fleet.evaluation.measures import Measure
from fleet.evaluation.scenarios import SCENARIOS, Scenario
from fleet.evaluation.scores import SplitScores
from fleet.training.intervals import Interval, difference, interval


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What a policy came to in a split, as tables tell it."""

    scenario: str
    split: str
    policy: str
    n_episodes: int
    figures: dict[str, Interval]
    """Mean of each figure with its interval, the headline first."""
    gain: Interval | None
    """By how much the headline is better than the reference's on the same seeds, negative = worse; None if the
    reference was not played."""
    gain_share: float | None
    """The same as a share of the reference's mean, of figures of which more is better; None where that is zero, too."""
    illegal: int
    """Actions that the environment had to make legal."""
    decision_ms: float
    """Time of the processor for one decision of the whole team [ms]."""


def findings(scores: Sequence[SplitScores]) -> list[Finding]:
    """What scores of shipped scenarios show, in their order; others are left out."""
    return [_finding(one, SCENARIOS[one.scenario], scores) for one in scores if one.scenario in SCENARIOS]


def _finding(scores: SplitScores, scenario: Scenario, among: Sequence[SplitScores]) -> Finding:
    figures = {
        name: interval(values, is_share=scenario.measures[name].is_share)
        for name, values in scores.figures.items()
        if name in scenario.measures
    }
    reference = _reference(scores, scenario, among)
    won, part = None, None
    if reference is not None:
        own, other = scores.figures[scenario.headline], reference.figures[scenario.headline]
        won = _gain(own, other, scenario.measures[scenario.headline])
        mean = sum(other) / len(other)
        part = won.mean / mean if scenario.measures[scenario.headline].more_is_better and mean else None
    return Finding(
        scenario=scores.scenario,
        split=scores.split,
        policy=scores.policy,
        n_episodes=scores.n_episodes,
        figures=figures,
        gain=won,
        gain_share=part,
        illegal=scores.illegal,
        decision_ms=scores.decision_ms,
    )


def _gain(own: Sequence[float], other: Sequence[float], measure: Measure) -> Interval:
    """By how much a figure is better than the reference's, episode by episode."""
    better, worse = (own, other) if measure.more_is_better else (other, own)
    return difference(better, worse, is_share=measure.is_share)


def _reference(scores: SplitScores, scenario: Scenario, among: Sequence[SplitScores]) -> SplitScores | None:
    """The scripted fleet on the same episodes; None for itself, and where it was not played on them."""
    if scores.policy == scenario.reference:
        return None
    for one in among:
        same = (one.scenario, one.split, one.definition) == (scores.scenario, scores.split, scores.definition)
        if same and one.policy == scenario.reference and one.n_episodes == scores.n_episodes:
            return one
    return None
