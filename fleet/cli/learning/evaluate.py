"""The evaluate command: policies play named scenarios, and are compared with the scripted fleet on the same seeds."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rich.console import Console
from rich.table import Table

from fleet.cli.run_output import plain_console
from fleet.config import require
from fleet.outputs import require_file
from fleet.terminal.progress_bar import Bar

if TYPE_CHECKING:
    from fleet.evaluation.players import Player
    from fleet.evaluation.results import ResultsFile
    from fleet.evaluation.scores import SplitScores

DONE = 0
EPISODES = 50
"""Of each split, as published."""
COLUMNS = 160
"""Columns of a table that goes to a file or a pipe."""


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Play named scenarios with a policy; prints figures with intervals and the gain over the scripted fleet."""

    scenario: str | None = None
    """What is played; without it, the scenarios are listed."""
    policy: str | None = None
    """A script by its name, such as pibt; a folder of fleet train; or package.module:Class. Default the scripted
    fleet."""
    split: str = "all"
    """train (what may be trained on), sites (floors never seen), teams (team sizes never seen), or all."""
    episodes: int = EPISODES
    """Episodes of each split; what is published has 50."""
    json: Path | None = None
    """File for the results, episode by episode; what is in it already is not played again."""
    table: Path | None = None
    """Page with the baselines of the scenario, or of all without --scenario; FILE.json beside it keeps the results."""

    def run(self) -> int:
        """Play, compare and print; returns the exit status."""
        # The environments take a second to load: only for runs, not for --help.
        from fleet.evaluation.baselines import page
        from fleet.evaluation.results import ResultsFile, write_result
        from fleet.evaluation.scenarios import SCENARIOS, require_episodes

        require_episodes(self.episodes)
        if self.scenario is None and self.table is None:
            require(self.policy is None, "--policy", self.policy, "one with --scenario")
            require(self.split == "all", "--split", self.split, "one with --scenario")
            require(self.json is None, "--json", str(self.json), "one with --scenario, or with --table")
            require(self.episodes == EPISODES, "--episodes", self.episodes, "a number of them with --scenario")
            plain_console(columns=COLUMNS).print(_list())
            return DONE
        require_file("--json", self.json)
        require_file("--table", self.table)
        path = self.json if self.table is None else self.json or self.table.with_suffix(".json")
        if path is not None and self.table is not None:
            is_other = path.resolve() != self.table.resolve()
            require(is_other, "--table", str(self.table), "another file than the results'")
        results = ResultsFile(path)
        names = SCENARIOS if self.scenario is None else [self.scenario]
        turns = [turn for name in names for turn in self._turns(name)]
        self._play(results, turns)
        console = plain_console(columns=COLUMNS)
        if self.table is None:
            _show(console, results, turns)
        else:
            beside = os.path.relpath(path or self.table, self.table.parent)
            write_result(self.table, page(results.scores, beside))
            console.print(f"baselines: {self.table}", soft_wrap=True)
        return DONE

    def _turns(self, name: str) -> list[Turn]:
        """Who plays which splits of a scenario, the policy that is asked for first."""
        from fleet.evaluation.players import player_named
        from fleet.evaluation.scenarios import scenario_named, splits_named

        scenario = scenario_named(name)
        words = [scenario.reference] if self.policy is None else [self.policy, scenario.reference]
        if self.table is not None:
            words += scenario.baselines
        players = [player_named(word, scenario) for word in dict.fromkeys(words)]
        return [Turn(name, split, player) for split in splits_named(scenario, self.split) for player in players]

    def _play(self, results: ResultsFile, turns: Sequence[Turn]) -> None:
        """Play what has not been played before."""
        from fleet.evaluation.scores import play_split

        left = [turn for turn in turns if not turn.found(results, self.episodes)]
        total = len(left) * self.episodes
        n_played = 0
        with Bar(total, "episodes", shown=True) as bar:
            for turn in left:

                def progress(turn: Turn = turn) -> None:
                    nonlocal n_played
                    n_played += 1
                    if bar.due():
                        what = f"{turn.scenario}, {turn.split}, {turn.player.name}"
                        bar.show(n_played, what, f"{n_played} of {total} episodes: {what}")

                results.add(play_split(turn.scenario, turn.split, turn.player, self.episodes, progress))


class Turn(NamedTuple):
    """A policy and a split that it plays."""

    scenario: str
    split: str
    player: Player

    def found(self, results: ResultsFile, n_episodes: int) -> SplitScores | None:
        """What it has come to, if it was played."""
        return results.find(self.scenario, self.split, self.player, n_episodes)


def _show(console: Console, results: ResultsFile, turns: Sequence[Turn]) -> None:
    """Print what was found, and what a reader should know beside it."""
    from fleet.evaluation.baselines import headings, row
    from fleet.evaluation.comparison import findings
    from fleet.evaluation.scenarios import SCENARIOS
    from fleet.recording import commit
    from fleet.training.intervals import heading

    name = turns[0].scenario
    wanted = {(turn.split, turn.player.name) for turn in turns}
    scores = [one for one in results.scores if one.scenario == name and (one.split, one.policy) in wanted]
    table = Table(title=f"{name}: {heading(scores[0].n_episodes)}")
    for number, column in enumerate(headings(SCENARIOS[name])):
        table.add_column(column, justify="left" if number < 2 else "right")
    found = {(one.split, one.policy): one for one in findings(scores)}
    for turn in turns:
        table.add_row(*row(found[turn.split, turn.player.name]))
    console.print(table)
    for one in found.values():
        if one.illegal:
            console.print(f"{one.policy}, {one.split}: {one.illegal} actions were illegal", soft_wrap=True)
    if others := sorted({str(one.commit) for one in scores} - {str(commit())}):
        console.print(f"played before, at commit {', '.join(others)}", soft_wrap=True)


def _list() -> Table:
    """All scenarios."""
    from fleet.evaluation.scenarios import SCENARIOS

    table = Table(title="scenarios")
    for heading in ("scenario", "environment", "headline", "scripted fleet", "what agents do"):
        table.add_column(heading)
    for name, one in SCENARIOS.items():
        table.add_row(name, one.env, one.headline, one.reference, one.summary)
    return table
