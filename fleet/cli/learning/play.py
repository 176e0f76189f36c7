"""The play command: what was learned drives the demo, or plays the environment that it was learned in."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.table import Table

from fleet.cli.arguments import require_live, require_with, stream_of
from fleet.cli.run_output import (
    ALL_DONE,
    INTERRUPTED,
    exit_status,
    plain_console,
    run_table,
    show_missing,
    show_recording,
)
from fleet.config import Connect, Fidelity, RunConfig, WholeFidelity, require
from fleet.errors import ConfigError
from fleet.terminal.interrupts import interrupts
from fleet.terminal.progress_bar import Bar

if TYPE_CHECKING:  # takes a second to load
    from fleet.envs.policies import Policy
    from fleet.training.evaluation import Score
    from fleet.training.learned_run import LearnedRun

PLAYED, SCRIPTED = "played", "scripted"
"""Headings of the run with policies and of the one without, which is the latter's folder, too."""
OF_A_FLEET = ("tasks", "stream", "rate", "duration", "serve", "port", "speed", "gui")
"""Options that mean nothing to an environment."""
USUAL_SITE, USUAL_ROBOTS = "small", 3
"""Those of the demo."""


@dataclass(frozen=True, kw_only=True)
class Play:
    """Let what was learned drive the demo, under the executor's grants, or play the environment it was learned in."""

    folder: Annotated[str | None, tyro.conf.Positional] = None
    """Folder of `fleet train`. What was learned about dispatch or traffic plays that part of a fleet; all else plays
    its own environment."""
    dispatch: str | None = None
    """Who gives tasks to cars: a folder of `fleet train` or a scripted policy (nearest, greedy, hungarian, ...)."""
    traffic: str | None = None
    """Who says where cars go next: a folder of `fleet train` or a scripted policy (pibt, shortest_way, ...)."""
    docking: str | None = None
    """Who drives cars on the last metre to a station: a folder of `fleet train` or a scripted policy (pursuit)."""
    compare: bool = False
    """Also make the run, or the episodes, without what was learned, on the same seed; shows both side by side."""
    robots: int | None = None
    """Number of cars; default 3, or that of the training where its own environment is played."""
    site: str | None = None
    """Name of a shipped site or path of a site file; default small, or that of the training."""
    tasks: int | None = None
    """Number of deliveries; default two per car, at least 6, or all that a stream brings in the time."""
    stream: str | None = None
    """Orders that arrive over time with due dates and priorities: poisson, waves, skewed or skewed_waves."""
    rate: float | None = None
    """Orders per hour of a stream; default 120."""
    seed: int = 0
    """Seed of everything random; the same seed gives the same run."""
    duration: float = 3600.0
    """End after this much simulated time even if tasks are open [s]."""
    fidelity: WholeFidelity | None = None
    """How robots are moved; default physics, or that of the training."""
    episodes: int = 1
    """Episodes of the environment, with seeds from --seed on."""
    record: bool = False
    """Write a recording."""
    view: bool = False
    """Open the viewer on the recording afterwards; without a display say how to look at it."""
    serve: bool = False
    """Stream to viewers on the loopback interface while it runs."""
    port: int = 9876
    """Port of --serve."""
    speed: float = 0.0
    """Simulated seconds per second of wall time; 0 = as fast as possible."""
    gui: bool = False
    """Show the physics engine's own window."""
    out: Path = Path("runs/play")
    """Directory for result.json, run.jsonl, decisions.json and recording.rrd, or for episodes.csv and recordings."""

    def run(self) -> int:
        """Run and print the result; returns the exit status."""
        self._check()
        told = {
            name: value for name in ("dispatch", "traffic", "docking") if (value := getattr(self, name)) is not None
        }
        if self.folder is not None:
            from fleet.play.policies import LAYERS
            from fleet.training.learned_run import learned_run

            run = learned_run(Path(self.folder))
            if run.layer not in told and run.layer in LAYERS:
                told[run.layer] = self.folder
            elif run.layer in LAYERS:
                raise ConfigError(f"{self.folder} plays {run.layer}, too; valid: it, or --{run.layer}")
            elif told:
                option = next(iter(told))
                raise ConfigError(f"{self.folder} plays {run.environment} alone; valid: it without --{option}")
            else:
                return self._play_episodes(run)
        if not told:
            raise ConfigError("there is no policy; valid: FOLDER, --dispatch, --traffic or --docking")
        return self._play_fleet(told)

    def _play_fleet(self, told: dict[str, str]) -> int:
        """A run of the fleet."""
        self._refuse(("episodes",), "is for an environment that is played, and this is a run of a fleet")
        is_physics = self.fidelity in (None, Fidelity.PHYSICS)
        require_with("--gui", self.gui, is_physics, "with --fidelity physics")
        require_with("--serve", self.serve, self.record, "with --record")
        require_with("--port", self.port != type(self).port, self.serve, "with --serve")
        require_with("--view", self.view, self.record, "with --record")
        has_stops = self.fidelity != Fidelity.GRID
        require_with("--docking", "docking" in told, has_stops, "with --fidelity kinematic, mixed or physics")
        from fleet.play.decisions import write_decisions
        from fleet.play.policies import played_policy
        from fleet.play.simulation import PlayedSimulation
        from fleet.recording import DECISIONS, RECORDING
        from fleet.session import SessionConfig, run_session

        config = self._run_config()
        policies = {part: played_policy(part, policy, self.seed) for part, policy in sorted(told.items())}
        session = SessionConfig(out=self.out, record=self.record, serve=self.serve, port=self.port, speed=self.speed)
        result = run_session(config, session, functools.partial(PlayedSimulation, policies=policies))
        write_decisions(self.out / DECISIONS, {part: one.decisions for part, one in policies.items()})
        results = {PLAYED: result}
        if self.compare and not result.interrupted:
            beside = replace(session, out=self.out / SCRIPTED, record=False, serve=False)
            results[SCRIPTED] = run_session(config, beside)
        console = plain_console()
        console.print(run_table({name: vars(one) for name, one in results.items()}))
        for part, one in policies.items():
            console.print(f"{part} by {one.decisions}", soft_wrap=True)
        if self.record:
            show_recording(console, self.out / RECORDING, view=self.view)
        show_missing(console, result)
        cut = next((one for one in results.values() if one.interrupted), result)
        return exit_status(console, cut, self.duration)

    def _play_episodes(self, run: LearnedRun) -> int:
        """Episodes of the environment."""
        from fleet.play.episodes import RERUN, play_episodes, require_output
        from fleet.training.recipes import RECIPES
        from fleet.training.results import write_episodes

        self._refuse(OF_A_FLEET, f"is for a fleet, and {run.environment} is none")
        if self.record and RERUN not in run.render_modes:
            raise ConfigError(f"{run.environment} has no recordings; valid: without --record")
        require_with("--view", self.view, self.record, "with --record")
        asked = {"--site": self.site, "--robots": self.robots}
        asked["--fidelity"] = None if self.fidelity is None else str(self.fidelity)
        changes = {option: value for option, value in asked.items() if value is not None}
        policies: dict[str, Policy] = {PLAYED: run.policy(self.seed)}
        if self.compare:
            policies[SCRIPTED] = RECIPES[run.recipe].scripted()
        require_output(self.out)
        seeds = list(range(self.seed, self.seed + self.episodes))
        total = len(seeds) * len(policies)
        with interrupts() as interrupted, Bar(total, "episodes", shown=True) as bar:

            def progress(done: int) -> None:
                if bar.due():
                    bar.show(done, run.environment, f"{done} of {total} episodes")

            scores = play_episodes(run, policies, changes, seeds, self.out, progress, interrupted, record=self.record)
        if not scores:
            raise KeyboardInterrupt
        write_episodes(self.out, scores, seeds)
        return self._tell_episodes(run, scores, total)

    def _tell_episodes(self, run: LearnedRun, scores: Mapping[str, Sequence[Score]], total: int) -> int:
        """Print what episodes came to; returns the exit status."""
        from fleet.play.episodes import recordings
        from fleet.training.intervals import heading, interval
        from fleet.training.recipes import RECIPES
        from fleet.training.results import EPISODES

        def told(figure: str, played: Sequence[Score]) -> str:
            values = [score[figure] for score in played]
            return interval(values, is_share=figure in RECIPES[run.recipe].shares).of(len(values))

        n_whole, n_played = len(scores[PLAYED]), sum(map(len, scores.values()))
        table = Table(title=f"{run.environment}: {heading(n_whole)}")
        table.add_column("figure")
        for name, played in scores.items():
            table.add_column(name if len(played) == n_whole else f"{name}, {len(played)} of them", justify="right")
        for figure in scores[PLAYED][0]:
            table.add_row(figure, *(told(figure, played) for played in scores.values()))
        console = plain_console()
        console.print(table)
        console.print(f"results: {self.out / EPISODES}", soft_wrap=True)
        if self.record:
            for recording in recordings(self.out)[:n_whole]:
                show_recording(console, recording, view=self.view)
        if n_played < total:
            console.print(f"interrupted: {n_played} of {total} episodes were played", soft_wrap=True)
            return INTERRUPTED
        return ALL_DONE

    def _refuse(self, options: Sequence[str], why: str) -> None:
        """Refuse options that are not as they come.

        Raises:
            ConfigError: One of them is.
        """
        usual = type(self)()
        for name in options:
            if getattr(self, name) != getattr(usual, name):
                raise ConfigError(f"--{name} {why}; valid: without --{name}")

    def _check(self) -> None:
        """Refuse what only the command line can get wrong; the rest is checked by `RunConfig`."""
        from fleet.evaluation.scenarios import require_episodes

        require_live(self.speed, self.port)
        require_episodes(self.episodes)
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")

    def _run_config(self) -> RunConfig:
        return RunConfig(
            site=USUAL_SITE if self.site is None else self.site,
            robots=USUAL_ROBOTS if self.robots is None else self.robots,
            tasks=self.tasks,
            stream=stream_of(self.stream, self.rate),
            seed=self.seed,
            duration_s=self.duration,
            fidelity=Fidelity.PHYSICS if self.fidelity is None else self.fidelity,
            connect=Connect.GUI if self.gui else Connect.DIRECT,
        )
