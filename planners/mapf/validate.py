"""Referee: lists everything that is wrong with a plan. Shares no code with the planners."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from planners.mapf.arrays import IntArray
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
    states = np.asarray(plan.states)
    none = np.zeros(graph.n_cells, dtype=np.bool_)
    suspects = suspicious(graph, states, allow_rotation=allow_rotation, blocked=none if blocked is None else blocked)
    if not suspects.size:
        return []
    sweeps: dict[tuple[int, int], set[int]] = {}
    for move in range(len(graph.move_from)):
        ends = int(graph.move_from[move]), int(graph.move_to[move])
        sweeps[ends] = {int(c) for c in graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]]}
    closed = set() if blocked is None else {int(c) for c in np.flatnonzero(blocked)}
    found: list[Conflict] = []
    for t in suspects.tolist():
        row = states[t].tolist()
        found += _standing(graph, t, row)
        if t + 1 < len(states):
            found += _moving(graph, t, row, states[t + 1].tolist(), sweeps, closed, allow_rotation)
    return found


def breaches(instance: Instance, plan: Plan) -> list[Conflict]:
    """Check a plan against its whole instance: `conflicts` plus `start`, `fixed` and `stay`."""
    found: list[Conflict] = []
    states = np.asarray(plan.states)
    cells = instance.graph.state_cell
    for agent in np.flatnonzero(states[0] != instance.starts).tolist():
        found.append(Conflict(kind="start", timestep=0, agents=(agent,), where=int(states[0, agent])))
    moves = states[:-1] != states[1:]
    for kind, wrong in (
        ("fixed", moves & np.asarray(instance.fixed, dtype=np.bool_)),
        ("stay", moves & np.asarray(instance.stay, dtype=np.bool_) & (states[:-1] == instance.goals)),
    ):
        for t, agent in np.argwhere(wrong).tolist():
            found.append(Conflict(kind=kind, timestep=t, agents=(agent,), where=int(cells[states[t, agent]])))
    found.sort(key=lambda breach: (breach.agents, breach.timestep, breach.kind != "start"))
    return found + conflicts(instance.graph, plan, allow_rotation=instance.allow_rotation, blocked=instance.blocked)


def suspicious(
    graph: LaneGraph, states: IntArray, *, allow_rotation: bool, blocked: npt.NDArray[np.bool_]
) -> npt.NDArray[np.intp]:
    """Rows of a plan in which something may be wrong, ascending; all others are right.

    The same rules as array operations over the whole plan, so that a long plan that is right is read in seconds.

    Args:
        graph: Lane graph.
        states: State of each agent at each timestep, shape (T + 1, n).
        allow_rotation: Whether a closed ring is legal.
        blocked: Cells nobody may enter, shape (n_cells,).
    """
    n = states.shape[1]
    cells = graph.state_cell[states].astype(np.int64)
    ordered = np.sort(cells, axis=1)
    wrong = np.zeros(len(states), dtype=np.bool_)
    wrong |= (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    if len(states) < 2 or n == 0:
        return np.flatnonzero(wrong)

    time, agent = np.nonzero(states[:-1] != states[1:])
    origin, target = states[time, agent].astype(np.int64), states[time + 1, agent]
    known = graph.move_from.astype(np.int64) * graph.n_states + graph.move_to
    by_ends = np.argsort(known, kind="stable")
    step = origin * graph.n_states + target
    at = np.minimum(np.searchsorted(known[by_ends], step), max(len(known) - 1, 0))
    legal = known[by_ends[at]] == step if len(known) else np.zeros(len(step), dtype=np.bool_)
    wrong[time[~legal]] = True

    here, there = cells[time, agent], cells[time + 1, agent]
    goes = here != there
    wrong[time[goes & blocked[there]]] = True

    # Whoever goes to a cell follows the one who stands there, and what goes in circles is a swap or a ring.
    place = time * graph.n_cells
    leaving = np.argsort(place + here, kind="stable")
    spot = np.minimum(np.searchsorted((place + here)[leaving], place + there), max(len(step) - 1, 0))
    ahead = leaving[spot] if len(step) else leaving
    follows = goes & ((place + here)[ahead] == place + there) & goes[ahead]
    swaps = follows & follows[ahead] & (ahead[ahead] == np.arange(len(step)))
    wrong[time[swaps]] = True
    if not allow_rotation:
        nobody = len(step)
        far = np.append(np.where(follows, ahead, nobody), nobody)
        for _ in range(int(n).bit_length()):
            far = far[far]
        wrong[time[far[:-1] != nobody]] = True

    # Cells swept besides the two ends must be nobody's, before, after and on the way.
    counts = np.diff(graph.swept_ptr)
    of_move = np.repeat(np.arange(len(counts)), counts)
    beside = (graph.swept_cell != graph.state_cell[graph.move_from][of_move]) & (
        graph.swept_cell != graph.state_cell[graph.move_to][of_move]
    )
    if beside.any():
        cell, of_move = graph.swept_cell[beside].astype(np.int64), of_move[beside]
        begin, end = np.searchsorted(of_move, [by_ends[at], by_ends[at] + 1])
        begin, end = np.where(legal, begin, 0), np.where(legal, end, 0)
        which = np.repeat(np.arange(len(step)), end - begin)
        offset = np.arange(len(which)) - np.repeat(np.cumsum(end - begin) - (end - begin), end - begin)
        crossed = cell[begin[which] + offset]
        when = time[which]
        standing = np.sort((np.arange(len(states))[:, None] * graph.n_cells + cells).ravel())
        for row in (when, when + 1):
            key = row * graph.n_cells + crossed
            found = np.minimum(np.searchsorted(standing, key), len(standing) - 1)
            wrong[when[standing[found] == key]] = True
        wrong[when[blocked[crossed]]] = True
        key = when * graph.n_cells + crossed
        order = np.argsort(key, kind="stable")
        twice = np.flatnonzero(np.diff(key[order]) == 0)
        wrong[when[order[twice]]] = True
    return np.flatnonzero(wrong)


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
