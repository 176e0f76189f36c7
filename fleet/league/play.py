"""Play: a controller against the League's clock, timestep by timestep."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.league.arena import Arena
from fleet.league.controller import Controller
from fleet.league.referee import check_actions
from fleet.terminal.interrupts import interrupts
from maps.formats.lorr import LeagueProblem, LeagueResult
from planners.mapf.validate import Conflict


@dataclass(frozen=True, kw_only=True, eq=False)
class Played:
    """What came of a run."""

    result: LeagueResult
    """What the League's file tells; calls of `step` that were timed are `result.planner_times_s`."""
    startup_s: float
    """Wall time of the controller's preparation [s]."""
    step_cpu_s: FloatArray
    """CPU time of each call of `step`, all threads of this process [s]."""
    late_steps: int
    """Calls of `step` that took longer than their budget."""
    conflicts: tuple[Conflict, ...]
    """What the referee found; empty = legal."""
    interrupted: bool

    @property
    def timesteps(self) -> int:
        """Timesteps that passed."""
        return len(self.result.actual)


def play(
    problem: LeagueProblem,
    controller: Controller,
    steps: int,
    budget_s: float,
    *,
    strict_time: bool = False,
    progress: Callable[[Arena], None] | None = None,
) -> Played:
    """Let a controller play a problem; Ctrl-C ends it after the present timestep.

    Args:
        problem: The problem.
        controller: Who plays; only its preparation and its `step` are timed, and separately.
        steps: Timesteps to play, >= 0.
        budget_s: Wall time for each call of `step` [s], > 0.
        strict_time: The League's own rule: while a planner is late, everybody waits, a timestep for each time its
            budget has run out. Otherwise late calls are only counted, so that a result does not depend on the machine.
        progress: Called after each timestep.
    """
    arena = Arena(problem)
    begin = time.perf_counter()
    controller.prepare(arena, budget_s)
    startup_s = time.perf_counter() - begin
    wall_s: list[float] = []
    cpu_s: list[float] = []
    late = 0
    with interrupts() as interrupted:
        while arena.timestep < steps and not interrupted:
            begin, begin_cpu = time.perf_counter(), time.process_time()
            next_states, task_of = controller.step(arena)
            cpu_s.append(time.process_time() - begin_cpu)
            wall_s.append(time.perf_counter() - begin)
            late += wall_s[-1] > budget_s
            if strict_time:
                arena.idle(int(min(wall_s[-1] / budget_s, steps - arena.timestep)))
            if arena.timestep < steps:
                arena.apply(next_states, task_of)
            if progress is not None:
                progress(arena)
        result = arena.result(np.array(wall_s))
        return Played(
            result=result,
            startup_s=startup_s,
            step_cpu_s=np.array(cpu_s),
            late_steps=late,
            conflicts=tuple(check_actions(problem, arena.graph, result.actual)),
            interrupted=bool(interrupted),
        )
