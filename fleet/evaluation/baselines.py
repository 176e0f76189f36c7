"""Baselines: what scripts, and policies that were learned, come to in all scenarios, as a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from fleet.evaluation.comparison import Finding, findings
from fleet.evaluation.scenarios import SCENARIOS, SPLITS, Scenario
from fleet.evaluation.scores import SplitScores


def headings(scenario: Scenario) -> list[str]:
    """Headings of the table of a scenario."""
    figures = [f"{name} [{measure.unit}]" for name, measure in scenario.measures.items()]
    return ["split", "policy", *figures, f"gain over {scenario.reference}", "ms"]


def row(finding: Finding) -> list[str]:
    """What a policy came to, as a row below `headings`."""
    gain = "" if finding.gain is None else finding.gain.of(finding.n_episodes)
    if finding.gain is not None and finding.gain_share is not None:
        gain += f", {100.0 * finding.gain_share:+.1f} %"
    figures = [found.of(finding.n_episodes) for found in finding.figures.values()]
    return [finding.split, finding.policy, *figures, gain, f"{finding.decision_ms:.3g}"]


def page(scores: Sequence[SplitScores], results: str) -> str:
    """The page of baselines.

    Args:
        scores: What was played.
        results: Name of the file that has every episode.
    """
    told = findings(scores)
    commits = sorted({one.commit or "unknown" for one in scores})
    lines = [
        "# Baselines",
        "",
        "Made by `python -m fleet.evaluate --table`; not written by hand. Means of "
        f"{_numbers({one.n_episodes for one in scores})} episodes with 95 % intervals (bootstrap; shares: Wilson); the "
        "gain is the paired difference of the first figure from the scripted fleet's on the same seeds, positive = "
        "better; ms is the time of the processor for one decision of the whole team. A policy with a path as its name "
        "is what one training run has learned. Every episode, with versions: "
        f"[{results}]({results}). Commit: {', '.join(commits)}.",
    ]
    for name, scenario in SCENARIOS.items():
        own = [one for one in told if one.scenario == name]
        if own:
            lines += ["", f"## {name}", "", *_section(scenario, own)]
    return "\n".join(lines) + "\n"


def _section(scenario: Scenario, own: Sequence[Finding]) -> Iterator[str]:
    arguments = ", ".join(f"{key} = {value}" for key, value in scenario.arguments.items())
    yield f"`{scenario.env}`{f', {arguments}' if arguments else ''}: {scenario.summary}."
    yield ""
    for split, cases in scenario.splits.items():
        yield f"- {split} ({SPLITS[split]}): {'; '.join(filter(None, map(str, cases))) or 'as it is'}"
    yield ""
    table = [headings(scenario)]
    for split in scenario.splits:
        table += [row(one) for one in _best_first(scenario, [one for one in own if one.split == split])]
    yield from (f"| {' | '.join(cells)} |" for cells in (table[0], ["---"] * len(table[0]), *table[1:]))


def _best_first(scenario: Scenario, own: Sequence[Finding]) -> list[Finding]:
    more: Mapping[bool, float] = {True: -1.0, False: 1.0}
    sign = more[scenario.measures[scenario.headline].more_is_better]
    return sorted(own, key=lambda one: sign * one.figures[scenario.headline].mean)


def _numbers(found: set[int]) -> str:
    return ", ".join(map(str, sorted(found)))
