"""Rehearsal: a problem made of what is known before the first timestep, on which a controller tries what serves it."""

from __future__ import annotations

from fleet.league.view import LeagueView
from maps.formats.lorr import LeagueProblem
from planners.mapf.multi_step.guidance import Errands


def problem_to_rehearse(arena: LeagueView, errands: Errands) -> LeagueProblem:
    """The same floor, robots and size of pool, with the tasks that are known coming again and again.

    Args:
        arena: The arena before its first timestep.
        errands: The errands of the tasks that are known.
    """
    return LeagueProblem(
        name=arena.problem.name,
        grid=arena.problem.grid,
        start_cell=arena.graph.state_cell[arena.states],
        errand_ptr=errands.ptr,
        errand_cell=errands.cell,
        pool_size=max(arena.problem.pool_size, len(arena.states)),
        round_robin=False,
        marks=arena.problem.marks,
    )
