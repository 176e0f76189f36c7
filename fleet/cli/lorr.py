"""The lorr command: play a problem of the League of Robot Runners."""

from __future__ import annotations

import json
import math
import resource
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.table import Table

from fleet.cli.run_output import plain_console
from fleet.config import require
from fleet.outputs import require_file
from fleet.terminal.interrupts import interrupts
from fleet.terminal.progress_bar import Bar
from fleet.whole_file import draft_of, write_whole

if TYPE_CHECKING:
    from fleet.league.arena import Arena
    from fleet.league.play import Played
    from fleet.league.ticks.tick_arena import TickArena
    from maps.formats.lorr import LeagueProblem

PLAYED, ILLEGAL, INTERRUPTED = 0, 1, 130
BLOCK = 200
"""Timesteps of the blocks that the summary counts finished tasks in."""


@dataclass(frozen=True, kw_only=True)
class Lorr:
    """Play a League of Robot Runners problem; prints a table, writes the League's output format and a summary."""

    problem: Annotated[Path, tyro.conf.Positional]
    """Problem file of 2023, 2024 or 2026 (JSON); its map, agent and task files are found relative to it."""
    steps: int = 1000
    """Timesteps to play; for a problem of 2026 ticks of 100 ms."""
    budget_ms: float = 1000.0
    """Wall time for each step of the planner [ms]; for a problem of 2026 for each plan, and from one to the next."""
    output: Path | None = None
    """File for the run in the League's output format (JSON)."""
    json: Path | None = None
    """File for the summary (JSON)."""
    controller: Literal["multi_step_pibt", "pibt"] = "multi_step_pibt"
    """What plays; `pibt` is plain: nearest tasks, one step ahead, no budget."""
    seed: int = 0
    """Seed of everything random."""
    strict_time: bool = False
    """While the planner is late all robots wait, as in the League (in 2026 they carry out the plan that they have);
    otherwise late steps are only counted."""

    def run(self) -> int:
        """Play and print the result; returns the exit status."""
        from maps.formats.lorr import read_problem, write_result

        self._check()
        problem = read_problem(self.problem)
        for option, path in (("--output", self.output), ("--json", self.json)):
            require_file(option, path)
        # Kernels take a second to load: only when there is something to play.
        from fleet.league.controller import PibtController
        from fleet.league.multi_step_controller import MultiStepController
        from fleet.league.play import play
        from fleet.league.ticks.play_ticks import play_ticks

        make = MultiStepController if self.controller == "multi_step_pibt" else PibtController

        with Bar(self.steps, "steps", shown=True) as bar:

            def progress(arena: Arena | TickArena) -> None:
                if bar.due():
                    done = f"{arena.n_finished} tasks"
                    bar.show(arena.timestep, done, f"step {arena.timestep} of {self.steps}, {done} finished")

            played = (play if problem.ticks is None else play_ticks)(
                problem,
                make(seed=self.seed),
                self.steps,
                self.budget_ms / 1000.0,
                strict_time=self.strict_time,
                progress=progress,
            )
        with interrupts():
            if self.output is not None:
                with draft_of(self.output) as draft:
                    write_result(draft, played.result)
            summary = self._summary(problem, played)
            if self.json is not None:
                write_whole(self.json, json.dumps(summary, indent=2) + "\n")
        console = plain_console()
        console.print(_table(summary))
        if played.conflicts:
            worst = played.conflicts[0]
            console.print(f"illegal: {worst.kind} at timestep {worst.timestep}, robots {worst.agents}")
            return ILLEGAL
        if played.interrupted:
            console.print("interrupted: the files hold the run up to here")
            return INTERRUPTED
        return PLAYED

    def _check(self) -> None:
        require(self.steps >= 1, "--steps", self.steps, "an integer >= 1")
        require(self.budget_ms > 0 and math.isfinite(self.budget_ms), "--budget-ms", self.budget_ms, "a number > 0")
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        taken = {self.problem.resolve()}
        for option, path in (("--output", self.output), ("--json", self.json)):
            if path is not None:
                require(path.resolve() not in taken, option, str(path), "a file of its own")
                taken.add(path.resolve())

    def _summary(self, problem: LeagueProblem, played: Played) -> dict[str, object]:
        """What the summary file holds."""
        from fleet.league.pace import finished_in_blocks, longest_stand

        result = played.result
        wall_ms, cpu_ms = 1000.0 * result.planner_times_s, 1000.0 * played.step_cpu_s
        return {
            "problem": problem.name,
            "robots": problem.n_robots,
            "steps": played.timesteps,
            "tasks_finished": result.n_finished,
            "step_ms_mean": round(float(wall_ms.mean()), 3) if wall_ms.size else 0.0,
            "step_ms_max": round(float(wall_ms.max(initial=0.0)), 3),
            "step_cpu_ms_mean": round(float(cpu_ms.mean()), 3) if cpu_ms.size else 0.0,
            "late_steps": played.late_steps,
            "startup_s": round(played.startup_s, 3),
            "peak_rss_mb": round(_peak_rss_mb(), 1),
            "planner_errors": len(result.planner_errors),
            "schedule_errors": len(result.schedule_errors),
            "timeouts": result.n_timeouts,
            "conflicts": len(played.conflicts),
            "tasks_finished_in_blocks": finished_in_blocks(result, BLOCK).tolist(),
            "block_steps": BLOCK,
            "longest_stand_steps": longest_stand(result),
            "budget_ms": self.budget_ms,
            "seed": self.seed,
            "interrupted": played.interrupted,
        }


def _table(summary: dict[str, object]) -> Table:
    rows = (
        ("tasks finished", "{tasks_finished}"),
        ("step, mean", "{step_ms_mean:.2f} ms"),
        ("step, longest", "{step_ms_max:.2f} ms"),
        ("step, CPU time, mean", "{step_cpu_ms_mean:.2f} ms"),
        ("steps over the budget", "{late_steps} of {budget_ms:g} ms"),
        ("start-up", "{startup_s:.2f} s"),
        ("peak memory", "{peak_rss_mb:.0f} MB"),
        ("longest stand with a task", "{longest_stand_steps} steps"),
        ("planner errors", "{planner_errors}"),
        ("schedule errors", "{schedule_errors}"),
        ("conflicts found by the referee", "{conflicts}"),
    )
    title = "{problem}: {robots} robots, {steps} steps, seed {seed}".format_map(summary)
    table = Table(title=title, show_header=False, min_width=len(title))
    table.add_column("figure")
    table.add_column("value", justify="right")
    for name, form in rows:
        table.add_row(name, form.format_map(summary))
    return table


def _peak_rss_mb() -> float:
    """Most memory this process has had [MB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10
