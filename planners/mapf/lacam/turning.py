"""Turning: plans for vehicles that turn on the spot, made from plans that forget about headings."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph, MoveKind
from planners.mapf.arrays import IntArray
from planners.mapf.kernel import Int, kernel
from planners.mapf.lanes import Lanes, lanes_of
from planners.mapf.problem import NO_GOAL, Instance

_UNKNOWN, _ASKED, _GOES, _WAITS = range(4)
_ROWS = 64
"""Timesteps that are driven between two looks at the memory."""


class CellVisits(NamedTuple):
    """The cells that agents visit, agent by agent."""

    ptr: IntArray
    """Visits of agent a: ptr[a] .. ptr[a + 1] - 1, shape (n + 1,)."""
    cell: IntArray
    rank: IntArray
    """Visitors of the cell before."""


class TurnDrive(NamedTuple):
    """How far everybody is; n agents."""

    now: IntArray
    """State of each agent, shape (n,)."""
    visit: IntArray
    """Its visit, shape (n,)."""
    left: IntArray
    """Visitors that have left each cell, shape (n_cells,)."""
    occupant: IntArray
    """Who is in each cell, -1 = nobody, shape (n_cells,)."""
    verdict: npt.NDArray[np.int8]
    """Whether each agent goes on in this timestep, shape (n,)."""


class Headings(NamedTuple):
    """Between states and headings."""

    of_state: npt.NDArray[np.int8]
    """Heading of each state, shape (S,)."""
    state: IntArray
    """State of each cell in each heading, -1 = none, shape (n_cells, 4)."""


def can_forget_headings(instance: Instance) -> bool:
    """Whether a plan over cells can be turned into one over states.

    It can where everybody turns on the spot, unless somebody must not turn away from its goal once it is there.
    """
    return instance.graph.motion == "rotating" and not (instance.stay & (instance.starts != instance.goals)).any()


def without_headings(instance: Instance) -> Instance:
    """The same instance on the graph of the cells; it can be solved if and only if the instance can."""
    graph = instance.graph
    cells, number = np.unique(graph.state_cell, return_inverse=True)
    ends = number[np.column_stack((graph.move_from, graph.move_to))]
    ends = np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0)
    ends = ends.reshape(-1, 2).astype(np.int32)
    out_ptr = np.searchsorted(ends[:, 0], np.arange(len(cells) + 1)).astype(np.int32)
    into = np.argsort(ends[:, 1], kind="stable").astype(np.int32)
    index = np.full((graph.n_cells, 4), -1, dtype=np.int32)
    index[cells, 0] = np.arange(len(cells))
    m = len(ends)
    over_cells = LaneGraph(
        motion="pebble",
        n_states=len(cells),
        n_cells=graph.n_cells,
        state_cell=cells.astype(np.int32),
        state_heading=np.zeros(len(cells), dtype=np.int8),
        state_pose=np.zeros((len(cells), 3)),
        state_index=index,
        move_from=np.ascontiguousarray(ends[:, 0]),
        move_to=np.ascontiguousarray(ends[:, 1]),
        move_kind=np.full(m, MoveKind.STRAIGHT, dtype=np.int8),
        move_length=np.ones(m),
        out_ptr=out_ptr,
        out_move=np.arange(m, dtype=np.int32),
        in_ptr=np.searchsorted(ends[into, 1], np.arange(len(cells) + 1)).astype(np.int32),
        in_move=into,
        swept_ptr=2 * np.arange(m + 1, dtype=np.int32),
        swept_cell=cells[ends].ravel().astype(np.int32),
        path_ptr=np.zeros(m + 1, dtype=np.int32),
        path_points=np.zeros((0, 3)),
        path_s=np.zeros(0),
    )
    starts = number[instance.starts].astype(np.int32)
    goals = np.where(instance.goals == NO_GOAL, NO_GOAL, number[instance.goals]).astype(np.int32)
    fixed = instance.fixed | (instance.stay & (instance.starts == instance.goals))
    return replace(
        instance, graph=over_cells, starts=starts, goals=goals, fixed=fixed, stay=np.zeros_like(instance.stay)
    )


def with_headings(instance: Instance, cells: IntArray) -> IntArray:
    """Drive a plan over cells: everybody visits its cells in order, and every cell has its visitors in order.

    Nobody waits for a timestep of the plan, only for the visitors before it, and turns meanwhile. That always ends,
    because the plan itself, with time for turns between its rows, is one way to keep all the orders.

    Args:
        instance: The instance with headings.
        cells: State of each agent on the graph of the cells at each timestep, shape (T + 1, n).

    Returns:
        State of each agent at each timestep, shape (T' + 1, n).

    Source: the orders are those of the action dependency graph: Hönig, Kiesel, Tinka, Durham, Ayanian, "Persistent and
    robust execution of MAPF schedules in warehouses", IEEE RA-L 2019.
    """
    graph = instance.graph
    place = np.unique(graph.state_cell)
    n = instance.n_agents
    arrives = np.vstack((np.ones((1, n), dtype=np.bool_), cells[1:] != cells[:-1]))
    when, who = np.nonzero(arrives)  # by timestep: a cell's visitors in order
    order = np.argsort(cells[when, who], kind="stable")
    by_cell = cells[when, who][order]
    rank = np.empty(len(when), dtype=np.int32)
    rank[order] = np.arange(len(when)) - np.searchsorted(by_cell, by_cell)
    by_agent = np.argsort(who, kind="stable")
    visits = CellVisits(
        ptr=np.searchsorted(who[by_agent], np.arange(n + 1)).astype(np.int32),
        cell=place[cells[when, who][by_agent]].astype(np.int32),
        rank=rank[by_agent],
    )
    drive = TurnDrive(
        now=np.array(instance.starts),
        visit=visits.ptr[:-1].copy(),
        left=np.zeros(graph.n_cells, dtype=np.int32),
        occupant=np.full(graph.n_cells, -1, dtype=np.int32),
        verdict=np.zeros(n, dtype=np.int8),
    )
    drive.occupant[graph.state_cell[drive.now]] = np.arange(n)
    lanes = lanes_of(graph, np.ones(graph.n_moves, dtype=np.bool_))
    headings = Headings(of_state=graph.state_heading, state=graph.state_index)
    rows = [drive.now[None].copy()]
    made = _ROWS
    while made == _ROWS:
        more = np.empty((_ROWS, n), dtype=np.int32)
        made = _drive(lanes, headings, instance.goals, visits, drive, more)
        rows.append(more[:made])
    return np.concatenate(rows)


@kernel
def _drive(
    lanes: Lanes, headings: Headings, goals: IntArray, visits: CellVisits, drive: TurnDrive, rows: IntArray
) -> int:  # pragma: no cover - compiled
    """Fill rows with the states after each timestep; how many, fewer than there are when everybody is there."""
    for row in range(len(rows)):
        if not _advance(lanes, headings, goals, visits, drive):
            return row
        for agent in range(len(drive.now)):
            rows[row, agent] = drive.now[agent]
    return len(rows)


@kernel
def _advance(
    lanes: Lanes, headings: Headings, goals: IntArray, visits: CellVisits, drive: TurnDrive
) -> bool:  # pragma: no cover - compiled
    """Make one timestep; False when everybody is where it should be."""
    now, visit, verdict, occupant = drive.now, drive.visit, drive.verdict, drive.occupant
    state_cell, state_heading, state_index = lanes.state_cell, headings.of_state, headings.state
    n = len(now)
    moved = False
    for agent in range(n):
        verdict[agent] = _UNKNOWN
    for agent in range(n):
        if verdict[agent] == _UNKNOWN:
            _judge(lanes, visits, drive, agent)
    for agent in range(n):
        if verdict[agent] == _GOES:
            cell = state_cell[now[agent]]
            drive.left[cell] += 1
            if occupant[cell] == agent:
                occupant[cell] = -1
            ahead = np.int64(visits.cell[visit[agent] + 1])
            now[agent] = _ahead(lanes, np.int64(now[agent]), ahead)
            visit[agent] += 1
            occupant[state_cell[now[agent]]] = agent
            moved = True
            continue
        wanted = np.int64(-1)
        home, facing = state_cell[now[agent]], np.int64(state_heading[now[agent]])
        if visit[agent] + 1 < visits.ptr[agent + 1]:
            ahead = np.int64(visits.cell[visit[agent] + 1])
            for k in range(4):
                state = np.int64(state_index[home, k])
                if state >= 0 and _ahead(lanes, state, ahead) >= 0:
                    wanted = np.int64(k)
        elif goals[agent] >= 0:
            wanted = np.int64(state_heading[goals[agent]])
        quarters = (wanted - facing) % 4
        if wanted >= 0 and quarters != 0:
            now[agent] = state_index[home, (facing + (3 if quarters == 3 else 1)) % 4]
            moved = True
    return moved


@kernel
def _ahead(lanes: Lanes, state: Int, cell: Int) -> Int:  # pragma: no cover - compiled
    """State in a cell that is one move ahead of a state, -1 = none."""
    for k in range(lanes.out_ptr[state], lanes.out_ptr[state + 1]):
        to = lanes.move_to[lanes.out_move[k]]
        if lanes.state_cell[to] == cell:
            return np.int64(to)
    return np.int64(-1)


@kernel
def _judge(lanes: Lanes, visits: CellVisits, drive: TurnDrive, first: Int) -> None:  # pragma: no cover - compiled
    """Say for an agent, and for all it follows, whether they go to their next cell now."""
    now, visit, verdict, occupant = drive.now, drive.visit, drive.verdict, drive.occupant
    agent = np.int64(first)
    end = _WAITS
    while True:
        verdict[agent] = _ASKED
        following = visit[agent] + 1
        if following >= visits.ptr[agent + 1]:
            break
        cell = visits.cell[following]
        if _ahead(lanes, np.int64(now[agent]), np.int64(cell)) < 0:
            break
        before = visits.rank[following] - drive.left[cell]
        if before == 0:
            end = _GOES
            break
        if before > 1 or occupant[cell] < 0:
            break
        other = np.int64(occupant[cell])
        if verdict[other] != _UNKNOWN:  # known, or asked in this very chain: a ring, which moves as one
            end = _WAITS if verdict[other] == _WAITS else _GOES
            break
        agent = other
    # The chain is walked again from its tail; whoever waits holds up all behind it.
    agent = np.int64(first)
    while verdict[agent] == _ASKED:
        verdict[agent] = end
        following = visit[agent] + 1
        if following >= visits.ptr[agent + 1]:
            break
        other = np.int64(occupant[visits.cell[following]])
        if other < 0:
            break
        agent = other
