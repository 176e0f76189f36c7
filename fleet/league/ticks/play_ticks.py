"""Play in ticks: a controller that plans every few ticks, and an executor that carries its plans out in each."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from fleet.league.controller import Controller
from fleet.league.play import Played
from fleet.league.ticks.foresight import Foresight
from fleet.league.ticks.plan_executor import PlanExecutor
from fleet.league.ticks.tick_arena import TickArena
from fleet.league.ticks.tick_referee import check_ticks
from fleet.terminal.interrupts import interrupts
from maps.formats.lorr import Ints, LeagueProblem

TICK_S = 0.1
"""Wall time of a tick, as the League's own simulator has it if nothing else is said [s]."""


def play_ticks(
    problem: LeagueProblem,
    controller: Controller,
    steps: int,
    budget_s: float,
    *,
    strict_time: bool = False,
    progress: Callable[[TickArena], None] | None = None,
) -> Played:
    """Let a controller play a problem of 2026; Ctrl-C ends it after the present tick.

    While robots carry out one plan, the next one is made, from where they will be; it comes into force with its
    schedule when its budget is over.

    Args:
        problem: A problem of 2026.
        controller: Who plays; its preparation and its plans are timed, and separately.
        steps: Ticks to play, >= 0.
        budget_s: Wall time for each plan, and what passes from one to the next in units of `TICK_S` [s], > 0.
        strict_time: The League's own rule: a plan that is late comes into force so much later. Otherwise late plans are
            only counted, so that a result does not depend on the machine.
        progress: Called after each tick.

    Source: BaseSystem::simulate of https://github.com/MAPF-Competition/Start-Kit, tag v3.1.0.
    """
    arena = TickArena(problem)
    # In tenths of a millisecond, so that 0.3 s are three ticks.
    interval = max(1, math.ceil(round(budget_s / TICK_S, 3)))
    rows = interval // arena.ticks.per_action + 1
    executor = PlanExecutor(arena.graph, arena.states, rows)
    begin = time.perf_counter()
    controller.prepare(Foresight(arena, executor), budget_s / rows)
    startup_s = time.perf_counter() - begin
    wall_s: list[float] = []
    cpu_s: list[float] = []

    def plan() -> Ints:
        """States of the next timesteps; the schedule is proposed."""
        begin, begin_cpu = time.perf_counter(), time.process_time()
        ahead = Foresight(arena, executor)
        states = [ahead.states]
        for _ in range(rows):
            ahead.advance(*controller.step(ahead))
            states.append(ahead.states)
        cpu_s.append(time.process_time() - begin_cpu)
        wall_s.append(time.perf_counter() - begin)
        arena.propose(ahead.proposal)
        return np.array(states, dtype=np.int32)

    with interrupts() as interrupted:
        coming = plan()
        while arena.timestep < steps and not interrupted:
            arena.assign()
            executor.take(coming)
            coming = plan()
            pause = max(interval, math.ceil(wall_s[-1] / TICK_S)) if strict_time else interval
            for _ in range(min(pause, steps - arena.timestep)):
                executor.ended(arena.apply(executor.actions()))
                if progress is not None:
                    progress(arena)
                if interrupted:
                    break
        result = arena.result(np.array(wall_s))
        return Played(
            result=result,
            startup_s=startup_s,
            step_cpu_s=np.array(cpu_s),
            late_steps=sum(each > budget_s for each in wall_s),
            conflicts=tuple(check_ticks(result)),
            interrupted=bool(interrupted),
        )
