"""The dataset command: trajectories of a policy as a Parquet file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fleet.config import require
from fleet.terminal.progress_bar import Bar

DONE = 0


@dataclass(frozen=True, kw_only=True)
class DatasetCommand:
    """Play a scenario with a policy and keep every step of every agent as a data set in Parquet."""

    scenario: str
    """What is played; `fleet evaluate` lists the scenarios."""
    out: Path
    """Folder of the data set, which must not be there; it appears when all is written."""
    policy: str | None = None
    """A script by its name, such as pibt; a folder of fleet train; or package.module:Class. Default the scripted
    fleet."""
    split: str = "train"
    """Whose sites and team sizes are played."""
    episodes: int = 10
    """Episodes to play."""
    seed: int = 0
    """Seed of the first episode; the others follow."""
    minari: str | None = None
    """Also make a data set of Minari with this name, such as fleet/reach/script-v0; for single robots."""

    def run(self) -> int:
        """Play and write; returns the exit status."""
        # The environments take a second to load: only for runs, not for --help.
        from fleet.evaluation.dataset.minari_export import require_minari, write_minari
        from fleet.evaluation.dataset.reading import read_dataset
        from fleet.evaluation.dataset.writing import write_dataset
        from fleet.evaluation.players import player_named
        from fleet.evaluation.scenarios import require_episodes, scenario_named

        scenario = scenario_named(self.scenario)
        require(self.split in scenario.splits, "--split", self.split, ", ".join(scenario.splits))
        require_episodes(self.episodes)
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        if self.minari is not None:
            require_minari(self.scenario, self.minari)
        player = player_named(self.policy or scenario.reference, scenario)
        seeds = range(self.seed, self.seed + self.episodes)
        n_played = 0
        with Bar(self.episodes, "episodes", shown=True) as bar:

            def progress() -> None:
                nonlocal n_played
                n_played += 1
                if bar.due():
                    bar.show(n_played, self.scenario, f"{n_played} of {self.episodes} episodes")

            write_dataset(self.out, self.scenario, self.split, player, seeds, progress)
            if self.minari is not None:
                write_minari(read_dataset(self.out), self.minari)
            bar.say(f"data set: {self.out}, {self.episodes} episodes of {player.name}")
        return DONE
