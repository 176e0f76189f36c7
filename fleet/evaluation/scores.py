"""Scores: what a policy came to in a split, episode by episode."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fleet.evaluation.episodes import play_episode
from fleet.evaluation.players import Player
from fleet.evaluation.scenarios import FIRST_SEED, Case, scenario_named
from fleet.recording import commit, versions


@dataclass(frozen=True, kw_only=True)
class SplitScores:
    """What a policy came to in a split of a scenario."""

    scenario: str
    split: str
    policy: str
    digest: str
    """SHA-256 of the file that the policy was made from; nothing for a script of the project."""
    definition: dict[str, Any]
    """All that decides the episodes, see `Scenario.definition`."""
    figures: dict[str, list[float]]
    """Figures by name, episode by episode in the order of the seeds."""
    illegal: int
    """Actions that the environment had to make legal, in all episodes."""
    decision_ms: float
    """Time of the processor for one decision of the whole team, the mean [ms]."""
    commit: str | None
    """Of the source; None outside a git clone."""
    versions: dict[str, str]
    """Of Python and the packages."""

    @property
    def n_episodes(self) -> int:
        """Episodes that were played."""
        return len(next(iter(self.figures.values())))


def play_split(
    name: str,
    split: str,
    player: Player,
    n_episodes: int,
    on_episode: Callable[[], None] = lambda: None,
) -> SplitScores:
    """Play all episodes of a split.

    Args:
        name: Of the scenario.
        split: One of its splits.
        player: Who plays.
        n_episodes: Episodes, from the first seed on.
        on_episode: Called after each episode; what it raises ends the evaluation.

    Raises:
        PolicyError: The policy cannot play the scenario, or failed in it.
    """
    scenario = scenario_named(name)
    figures: dict[str, list[float]] = {measure: [] for measure in scenario.measures}
    cpu_s, n_steps, illegal = 0.0, 0, 0
    envs: dict[Case, Any] = {}
    try:
        for case in scenario.splits[split]:
            envs[case] = scenario.make(case)
            player.check(scenario, envs[case])
        for episode in range(n_episodes):
            env = envs[scenario.case_of(split, episode)]
            tally, spent_s = play_episode(env, player, FIRST_SEED + episode)
            for measure, how in scenario.measures.items():
                figures[measure].append(round(how.of(tally), 6))
            cpu_s, n_steps, illegal = cpu_s + spent_s, n_steps + tally.n_steps, illegal + tally.n_illegal
            on_episode()
    finally:
        for env in envs.values():
            env.close()
    return SplitScores(
        scenario=name,
        split=split,
        policy=player.name,
        digest=player.digest,
        definition=json.loads(json.dumps(scenario.definition(split))),
        figures=figures,
        illegal=illegal,
        decision_ms=round(1000.0 * cpu_s / max(1, n_steps), 4),
        commit=commit(),
        versions=versions(),
    )
