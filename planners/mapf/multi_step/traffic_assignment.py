"""Traffic assignment: how many robots drive through each move, and costs that keep opposing streams apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import uniform_filter
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from maps.grid import GridMap
from maps.lane_graph import LaneGraph
from planners.errors import PlanningError
from planners.mapf.arrays import Distances, FloatArray, IntArray
from planners.mapf.distance_table import MOST_COST, UNREACHABLE, DistanceTable, DistanceTooLong
from planners.mapf.multi_step.guidance import Errands, reverse_moves

UNIT = 2
"""Cost of a move where nobody is; a whole number, so that traffic counts in halves."""


@dataclass(frozen=True, kw_only=True)
class AssignmentConfig:
    """Settings of `assign_traffic`."""

    rounds: int = 12
    """Times the streams are sent with the costs of the round before."""
    goals: int = 600
    """Goals drawn in each round, to which everybody drives."""
    meeting: float = 60.0
    """How much dearer a move gets, as a multiple, for each robot a timestep that makes it the other way."""
    most: int = 24
    """Most that this adds to a move."""
    crowding: float = 0.0
    """How much dearer a move gets, as a multiple, for each robot a timestep beyond `roomy` that passes a cell around
    its end."""
    roomy: float = 0.4
    """Robots a timestep that pass a cell without being in each other's way. Up to here all ways of one length cost the
    same, so that whoever is hindered on one takes another."""
    around: int = 11
    """Side of the square that such crowds are averaged over [cells]. Costs that differ from one aisle to the next send
    everybody into the same aisle; those that change slowly make a stream spread."""
    memory: float = 0.7
    """Share of the streams seen before that counts on in each round."""

    def __post_init__(self) -> None:
        for name in ("rounds", "goals", "around"):
            if getattr(self, name) < 1:
                raise PlanningError(f"traffic assignment: {name} = {getattr(self, name)}; valid: an integer >= 1")
        for name in ("meeting", "crowding", "roomy"):
            if not 0 <= getattr(self, name) <= MOST_COST:
                raise PlanningError(f"traffic assignment: {name} = {getattr(self, name)}; valid: 0 to {MOST_COST}")
        if not 0 <= self.most < MOST_COST:
            raise PlanningError(f"traffic assignment: most = {self.most}; valid: 0 to {MOST_COST - 1}")
        if not 0 <= self.memory < 1:
            raise PlanningError(f"traffic assignment: memory = {self.memory}; valid: 0 <= memory < 1")


class Streams(NamedTuple):
    """What came out of an assignment, for each move of the graph."""

    cost: IntArray
    """In units of `UNIT`, or fewer where a way would become too dear for a distance table, shape (n_moves,)."""
    flow: FloatArray
    """Robots a timestep if all drive and nobody waits, shape (n_moves,)."""


def assign_traffic(
    grid: GridMap,
    graph: LaneGraph,
    errands: Errands,
    n_robots: int,
    *,
    own_cost: IntArray | None = None,
    first_cost: IntArray | None = None,
    config: AssignmentConfig | None = None,
    seed: int | np.random.Generator = 0,
) -> Streams:
    """Send streams of robots from errand to errand, make moves against a stream dearer, and send them again.

    Nobody drives: a stream is the share of robots that come from each cell, added up along the cheapest ways to a goal,
    so that thousands of robots cost as much as one. Where a stream is larger than the one against it, the smaller one
    has to pay more and looks for another way.

    Args:
        grid: The floor.
        graph: Pebble graph on it; every move has one the other way.
        errands: Tasks as the fleet will get them.
        n_robots: Robots on the floor.
        own_cost: What each move costs where nobody is, 1 or more, shape (n_moves,); None = 1 each.
        first_cost: The same in the first round, to break the tie between the two directions of an aisle; None = as in
            all others.
        config: Settings.
        seed: Seed of the goals drawn.

    Source: all-or-nothing assignment to shortest-path trees with averaged volumes, Smock, "An iterative assignment
    approach to capacity restraint on arterial networks", Highway Research Board Bulletin 347, 1962; that opposing
    traffic and crowds are what costs time here is our own.
    """
    config = AssignmentConfig() if config is None else config
    rng = np.random.default_rng(seed)
    back = reverse_moves(graph.state_cell[graph.move_from], graph.state_cell[graph.move_to], graph.n_cells)
    nobody = np.zeros(graph.n_cells, dtype=np.bool_)
    own = np.ones(graph.n_moves, dtype=np.int32) if own_cost is None else own_cost
    parts = _parts(graph)
    cost = _fitting(graph, back, parts, _whole(own if first_cost is None else first_cost))
    place = np.arange(len(errands.cell)) - np.repeat(errands.ptr[:-1], np.diff(errands.ptr))
    sources = _sources(graph, errands, place)
    flow = np.zeros(graph.n_moves)
    for done in range(config.rounds):
        drawn = rng.integers(len(errands.cell), size=config.goals)
        goals = graph.state_index[errands.cell[drawn], 0].astype(np.int32)
        tables = DistanceTable(graph, nobody, move_costs=cost, memory_cap=2 * graph.n_states * config.goals)
        table, row = tables.rows(goals)
        sent = np.zeros(graph.n_moves)
        _send(table, row, place[drawn], sources, graph.out_ptr, graph.out_move, graph.move_to, cost, sent)
        sent *= n_robots / max(sent.sum(), 1e-9)
        flow = sent if done == 0 else config.memory * flow + (1.0 - config.memory) * sent
        extra = np.minimum(config.meeting * flow[back], config.most)
        if config.crowding:
            extra += config.crowding * np.maximum(_around(grid, graph, flow, config.around) - config.roomy, 0.0)
        cost = _fitting(graph, back, parts, _whole(own + extra))
    return Streams(cost=cost, flow=flow)


def _whole(cost: npt.NDArray[np.floating[Any] | np.integer[Any]]) -> IntArray:
    return np.clip(np.round(UNIT * cost), 1, MOST_COST).astype(np.int32)


def _parts(graph: LaneGraph) -> list[npt.NDArray[np.int64]]:
    """States of each part of the floor that holds together."""
    ends = np.ones(graph.n_moves, dtype=np.bool_), (graph.move_from, graph.move_to)
    n_parts, part_of = connected_components(coo_array(ends, shape=(graph.n_states, graph.n_states)), directed=False)
    in_parts = np.argsort(part_of, kind="stable")
    return np.split(in_parts, np.cumsum(np.bincount(part_of, minlength=n_parts))[:-1])


def _fitting(
    graph: LaneGraph, back: npt.NDArray[np.int64], parts: list[npt.NDArray[np.int64]], cost: IntArray
) -> IntArray:
    """The costs, halved until a distance table can hold the dearest way between any two cells of the floor."""
    while cost.max(initial=1) > 1 and not _fits(graph, back, parts, cost):
        cost = np.maximum(cost // 2, 1)
    return cost


def _fits(graph: LaneGraph, back: npt.NDArray[np.int64], parts: list[npt.NDArray[np.int64]], cost: IntArray) -> bool:
    """Whether all ways over some cell of each part of the floor can be held; no cheapest way is dearer than those."""
    large = [part for part in parts if len(part) * int(cost.max()) >= UNREACHABLE]
    if not large:
        return True
    nobody = np.zeros(graph.n_cells, dtype=np.bool_)
    try:
        to, fro = (DistanceTable(graph, nobody, move_costs=way) for way in (cost, cost[back]))
        for part in large:
            state = int(part[0])
            if int(to.to(state)[part].max()) + int(fro.to(state)[part].max()) >= UNREACHABLE:
                return False
    except DistanceTooLong:
        return False
    return True


def _around(grid: GridMap, graph: LaneGraph, flow: FloatArray, side: int) -> FloatArray:
    """Robots a timestep that pass a free cell around the end of each move, shape (n_moves,)."""
    end = graph.state_cell[graph.move_to]
    passing = np.bincount(end, weights=flow, minlength=graph.n_cells).reshape(grid.free.shape)
    floor = uniform_filter(grid.free.astype(np.float64), side, mode="constant")
    around: FloatArray = uniform_filter(passing, side, mode="constant").ravel()[end] / floor.ravel()[end]
    return around


def _sources(graph: LaneGraph, errands: Errands, place: npt.NDArray[np.intp]) -> FloatArray:
    """Share of robots that come from each state on the way to the k-th errand of a task, shape (most, n_states)."""
    ends = errands.ptr[1:] - 1
    shares = []
    for k in range(int(place.max(initial=0)) + 1):
        before = errands.cell[place == k - 1] if k else errands.cell[ends]
        states = graph.state_index[before, 0]
        shares.append(np.bincount(states, minlength=graph.n_states) / len(states))
    return np.array(shares)


@njit(cache=True, nogil=True)
def _send(
    table: Distances,
    rows: IntArray,
    place: npt.NDArray[np.int64],
    sources: FloatArray,
    out_ptr: IntArray,
    out_move: IntArray,
    move_to: IntArray,
    cost: IntArray,
    flow: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Add up the streams to goals, shape (k,): the farthest states first; they split where ways cost the same."""
    n_states = table.shape[1]
    order = np.empty(n_states, dtype=np.int32)
    for k in range(len(rows)):
        left = table[rows[k]]
        farthest = 0
        for state in range(n_states):
            if left[state] < UNREACHABLE:
                farthest = max(farthest, int(left[state]))
        ends = np.zeros(farthest + 2, dtype=np.int32)
        for state in range(n_states):
            if left[state] < UNREACHABLE:
                ends[left[state] + 1] += 1
        ends = np.cumsum(ends).astype(np.int32)
        n_reached = ends[-1]
        for state in range(n_states):
            if left[state] < UNREACHABLE:
                order[ends[left[state]]] = state
                ends[left[state]] += 1
        load = sources[place[k]].copy()
        for at in range(n_reached - 1, -1, -1):
            state = order[at]
            if left[state] == 0 or load[state] == 0.0:
                continue
            n_ways = 0
            for j in range(out_ptr[state], out_ptr[state + 1]):
                move = out_move[j]
                n_ways += int(left[move_to[move]]) + cost[move] == left[state]
            for j in range(out_ptr[state], out_ptr[state + 1]):
                move = out_move[j]
                if int(left[move_to[move]]) + cost[move] == left[state]:
                    flow[move] += load[state] / n_ways
                    load[move_to[move]] += load[state] / n_ways
