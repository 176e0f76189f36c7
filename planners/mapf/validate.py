"""Referee: lists everything that is wrong with a plan. Shares no code with the planners."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from planners.mapf.problem import Instance, Plan


@dataclass(frozen=True, kw_only=True)
class Conflict:
    """One thing that is wrong with a plan."""

    kind: str
    """vertex, edge, swept, rotation, illegal_move, blocked; from `breaches` also start, fixed, stay."""
    timestep: int
    """Row of the plan; for whatever happens on the way, the row it starts from."""
    agents: tuple[int, ...]
    """Who takes part, in ascending order; a ring in driving order, from its smallest agent on."""
    where: int
    """Cell; for start and illegal_move the state that is wrong."""


def conflicts(
    graph: LaneGraph, plan: Plan, *, allow_rotation: bool, blocked: npt.NDArray[np.bool_] | None = None
) -> list[Conflict]:
    """Check a plan against the rules of the lane graph.

    Kinds: `vertex`, two agents in one cell; `edge`, two agents swap cells; `swept`, a move touches a cell that another
    agent uses in the same timestep (other than following into a cell being vacated); `rotation`, a closed ring of three
    or more followers; `illegal_move`, a step that is no move of the graph; `blocked`, a blocked cell is entered or
    crossed.

    Args:
        graph: Lane graph.
        plan: The plan.
        allow_rotation: Whether a closed ring is legal.
        blocked: Cells nobody may enter, shape (n_cells,); None = none.

    Returns:
        All conflicts, by timestep; empty = legal.
    """
    sweeps: dict[tuple[int, int], set[int]] = {}
    for move in range(len(graph.move_from)):
        ends = int(graph.move_from[move]), int(graph.move_to[move])
        sweeps[ends] = {int(c) for c in graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]]}
    closed = set() if blocked is None else {int(c) for c in np.flatnonzero(blocked)}
    rows = [[int(state) for state in row] for row in plan.states]
    found: list[Conflict] = []
    for t, row in enumerate(rows):
        found += _standing(graph, t, row)
        if t + 1 < len(rows):
            found += _moving(graph, t, row, rows[t + 1], sweeps, closed, allow_rotation)
    return found


def breaches(instance: Instance, plan: Plan) -> list[Conflict]:
    """Check a plan against its whole instance: `conflicts` plus `start`, `fixed` and `stay`."""
    found: list[Conflict] = []
    rows = [[int(state) for state in row] for row in plan.states]
    for agent, start in enumerate(instance.starts):
        if rows[0][agent] != start:
            found.append(Conflict(kind="start", timestep=0, agents=(agent,), where=rows[0][agent]))
        for t in range(len(rows) - 1):
            if rows[t][agent] == rows[t + 1][agent]:
                continue
            cell = int(instance.graph.state_cell[rows[t][agent]])
            if instance.fixed[agent]:
                found.append(Conflict(kind="fixed", timestep=t, agents=(agent,), where=cell))
            if instance.stay[agent] and rows[t][agent] == instance.goals[agent]:
                found.append(Conflict(kind="stay", timestep=t, agents=(agent,), where=cell))
    return found + conflicts(instance.graph, plan, allow_rotation=instance.allow_rotation, blocked=instance.blocked)


def _standing(graph: LaneGraph, t: int, row: list[int]) -> list[Conflict]:
    by_cell = defaultdict(list)
    for agent, state in enumerate(row):
        by_cell[int(graph.state_cell[state])].append(agent)
    return [
        Conflict(kind="vertex", timestep=t, agents=tuple(agents), where=cell)
        for cell, agents in sorted(by_cell.items())
        if len(agents) > 1
    ]


def _moving(
    graph: LaneGraph,
    t: int,
    row: list[int],
    next_row: list[int],
    sweeps: dict[tuple[int, int], set[int]],
    closed: set[int],
    allow_rotation: bool,
) -> list[Conflict]:
    found = []
    origin = [int(graph.state_cell[state]) for state in row]
    target = [int(graph.state_cell[state]) for state in next_row]
    users = defaultdict(list)  # cell -> agents that touch it during this timestep
    for agent, step in enumerate(zip(row, next_row, strict=True)):
        if step[0] == step[1]:
            swept = {origin[agent]}
        elif step in sweeps:
            swept = sweeps[step] | {origin[agent], target[agent]}
        else:
            found.append(Conflict(kind="illegal_move", timestep=t, agents=(agent,), where=step[1]))
            swept = {origin[agent], target[agent]}
        for cell in sorted(swept):
            users[cell].append(agent)
            if cell in closed and cell != origin[agent]:
                found.append(Conflict(kind="blocked", timestep=t, agents=(agent,), where=cell))

    for cell, agents in sorted(users.items()):
        for k, a in enumerate(agents):
            for b in agents[k + 1 :]:
                if target[a] == target[b] == cell or origin[a] == origin[b] == cell:
                    continue  # a vertex conflict of this row or the next
                follows = {origin[a], target[b]} == {cell} or {origin[b], target[a]} == {cell}
                if not follows:
                    found.append(Conflict(kind="swept", timestep=t, agents=(a, b), where=cell))
    found += _rings(t, origin, target, allow_rotation)
    return found


def _rings(t: int, origin: list[int], target: list[int], allow_rotation: bool) -> list[Conflict]:
    """Closed rings of agents that each enter the cell of the next: two of them swap, more of them rotate."""
    stands = {cell: agent for agent, cell in enumerate(origin)}
    found = []
    seen: set[int] = set()
    for agent in range(len(origin)):
        trail: list[int] = []
        at: int | None = agent
        while at is not None and at not in seen and target[at] != origin[at]:
            seen.add(at)
            trail.append(at)
            at = stands.get(target[at])
        if at is None or at not in trail:
            continue
        ring = trail[trail.index(at) :]
        ring = ring[ring.index(min(ring)) :] + ring[: ring.index(min(ring))]
        if len(ring) == 2:
            found.append(Conflict(kind="edge", timestep=t, agents=tuple(ring), where=origin[ring[0]]))
        elif not allow_rotation:
            found.append(Conflict(kind="rotation", timestep=t, agents=tuple(ring), where=origin[ring[0]]))
    return found
