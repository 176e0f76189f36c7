"""What an agent sees of the costs and the others around it, in a frame in which its best move points ahead.

Source: H. Jiang et al., "Deploying Ten Thousand Robots: Scalable Imitation Learning for Lifelong Multi-Agent Path
Finding", ICRA 2025, https://arxiv.org/abs/2410.21415 (costs to the goal around an agent, and the others there). The
frame, the moves of those who have decided already, and what the others would mind are our own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from maps.grid import DCOL, DROW, EAST, NORTH, SOUTH, WEST
from maps.lane_graph import LaneGraph
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, Distances, FloatArray, IntArray
from planners.mapf.distance_table import UNREACHABLE
from planners.mapf.inheritance import UNDECIDED
from planners.mapf.kernel import Int, inlined, kernel
from planners.mapf.multi_step.pockets import pocket_depth
from planners.mapf.options import open_moves

Seen = npt.NDArray[np.int8]
"""Observations in units of 1 / `ONE`, shape (n, N_SEEN) or (N_SEEN,)."""

RADIUS = 3
"""Cells that an agent sees to each side."""
N_CELLS = (2 * RADIUS + 1) ** 2
ONE = 16
"""What stands for 1 in an observation."""
N_MOVES = 5
"""Ahead, to the better side, back, to the other side, wait: this is how moves are numbered in an agent's frame."""
WAIT = 4
_N_LAYERS = 6
_N_SCALARS = 8
N_SEEN = _N_LAYERS * N_CELLS + _N_SCALARS
"""Numbers of an observation."""
_FARTHEST = 7.0
"""Cost differences, in moves, are cut off here, so that they fit into a byte; an obstacle is farther."""
_OBSTACLE = 127
_NOWHERE = 4
"""Heading of an agent that no move brings nearer."""


class Surroundings(NamedTuple):
    """What lies around each state of a pebble graph; S states."""

    beside: IntArray
    """State next to it in each heading, -1 = none, shape (S, 4)."""
    window: IntArray
    """States of the cells around it, row by row from the north-west, -1 = none, shape (S, N_CELLS)."""
    turned: IntArray
    """Places in the window in the order in which they are seen in each frame, shape (8, N_CELLS)."""
    depth: IntArray
    """Bottlenecks between it and the open floor, shape (S,)."""
    cell: IntArray
    """Its cell, shape (S,)."""
    cols: int
    """Cells in a row of the floor."""


class Outlook(NamedTuple):
    """What all agents see of each other; n agents. Working memory, filled by `look_out`."""

    stands: IntArray
    """Agent in each state, -1 = nobody; -1 everywhere between timesteps, shape (S,)."""
    frame: IntArray
    """Frame of each agent: twice the heading that is ahead, and 1 if its better side is the left one; shape (n,)."""
    wished: IntArray
    """Heading that brings it nearer, 4 = none does, shape (n,)."""
    spare: FloatArray
    """How much worse its second move is than its best, in moves, shape (n,)."""
    place: IntArray
    """Its place in the order, shape (n,)."""


def surroundings_of(graph: LaneGraph, blocked: BoolArray) -> Surroundings:
    """What lies around each state.

    Args:
        graph: Lane graph, of pebbles.
        blocked: Cells nobody may enter, shape (n_cells,).

    Raises:
        PlanningError: The graph is of vehicles that turn or reach other cells than the four beside theirs.
    """
    if graph.motion != "pebble":
        raise PlanningError(f"learned pibt: motion is {graph.motion!r}; valid: 'pebble'")
    moves = np.flatnonzero(open_moves(graph, blocked))
    origin, target = graph.move_from[moves], graph.move_to[moves]
    step = graph.state_cell[target] - graph.state_cell[origin]
    cols = int(np.abs(step).max(initial=1))
    if cols == 1:  # a single row
        cols = graph.n_cells
    heading = np.select([step == DROW[h] * cols + DCOL[h] for h in range(4)], range(4), -1)
    if (heading < 0).any():
        raise PlanningError(
            "learned pibt: a move leads to a cell that is not beside it; valid: grids of four neighbours"
        )
    beside = np.full((graph.n_states, 4), -1, dtype=np.int32)
    beside[origin, heading] = target

    row, col = np.divmod(graph.state_cell, cols)
    state_at = np.full((graph.n_cells // cols + 2 * RADIUS, cols + 2 * RADIUS), -1, dtype=np.int32)
    usable = ~blocked[graph.state_cell]
    state_at[row[usable] + RADIUS, col[usable] + RADIUS] = np.flatnonzero(usable)
    offset = np.arange(2 * RADIUS + 1)
    window = state_at[row[:, None, None] + offset[:, None], col[:, None, None] + offset]
    return Surroundings(
        beside=beside,
        window=window.reshape(graph.n_states, N_CELLS).astype(np.int32),
        turned=_turned(),
        depth=pocket_depth(graph)[graph.state_cell].astype(np.int32),
        cell=graph.state_cell,
        cols=cols,
    )


def _turned() -> IntArray:
    """`Surroundings.turned`: rows from far ahead to far behind, in each from the worse side to the better one."""
    frames = []
    for ahead in range(4):
        for side in ((ahead - 1) % 4, (ahead + 1) % 4):
            near = np.arange(-RADIUS, RADIUS + 1)
            forward, across = np.meshgrid(near[::-1], near, indexing="ij")
            row = forward * DROW[ahead] + across * DROW[side]
            col = forward * DCOL[ahead] + across * DCOL[side]
            frames.append(((row + RADIUS) * (2 * RADIUS + 1) + col + RADIUS).ravel())
    return np.array(frames, dtype=np.int32)


def outlook_of(n_states: int, n: int) -> Outlook:
    """Working memory for `n` agents."""
    stands = np.full(n_states, -1, dtype=np.int32)
    frame, wished, place = np.zeros((3, n), dtype=np.int32)
    return Outlook(stands=stands, frame=frame, wished=wished, spare=np.zeros(n), place=place)


@kernel
def move_in(frame: Int, heading: Int) -> Int:  # pragma: no cover - compiled
    """Number in a frame of the move in a heading."""
    turn = heading - (frame >> 1) if frame & 1 else (frame >> 1) - heading
    return turn & 3


@kernel
def heading_in(frame: Int, move: Int) -> Int:  # pragma: no cover - compiled
    """Heading of a move that is numbered in a frame and is not to wait."""
    return ((frame >> 1) + move if frame & 1 else (frame >> 1) - move) & 3


@kernel
def look_out(
    around: Surroundings, outlook: Outlook, table: Distances, row: IntArray, now: IntArray, order: IntArray, unit: Int
) -> None:  # pragma: no cover - compiled
    """Find out what each agent wishes, and how much it would mind another move."""
    for place in range(len(order)):
        outlook.place[order[place]] = place
    for agent in range(len(now)):
        outlook.stands[now[agent]] = agent
        outlook.frame[agent] = 0
        outlook.wished[agent] = _NOWHERE
        outlook.spare[agent] = 0.0
        if row[agent] < 0:
            continue
        left = table[row[agent]]
        best, second, heading = np.int64(2**30), np.int64(2**30), np.int64(0)
        for h in range(4):
            state = around.beside[now[agent], h]
            if state < 0:
                continue
            cost = np.int64(left[state])
            if cost < best:
                second, best, heading = best, cost, np.int64(h)
            elif cost < second:
                second = cost
        right, other = around.beside[now[agent], (heading - 1) & 3], around.beside[now[agent], (heading + 1) & 3]
        mirrored = other >= 0 and (right < 0 or left[other] < left[right])
        outlook.frame[agent] = 2 * heading + mirrored
        if best < left[now[agent]]:
            outlook.wished[agent] = heading
        outlook.spare[agent] = min((second - best) / unit, _FARTHEST)


@inlined
def _heading_of(step: Int, cols: Int) -> Int:  # pragma: no cover - compiled
    """Heading of a step between cells beside each other."""
    if step == 1:
        return np.int64(EAST)
    if step == -cols:
        return np.int64(NORTH)
    if step == -1:
        return np.int64(WEST)
    if step == cols:
        return np.int64(SOUTH)
    return np.int64(_NOWHERE)


@kernel
def forget(outlook: Outlook, now: IntArray) -> None:  # pragma: no cover - compiled
    """Take all agents off the floor again."""
    for agent in range(len(now)):
        outlook.stands[now[agent]] = -1


@kernel
def observe(
    around: Surroundings,
    outlook: Outlook,
    table: Distances,
    row: IntArray,
    now: IntArray,
    waited: IntArray,
    goes: IntArray,
    unit: Int,
    agent: Int,
    out: Seen,
) -> None:  # pragma: no cover - compiled
    """Fill the observation of an agent that has a goal, shape (N_SEEN,), once `look_out` has been called.

    Of those who have decided it sees where they go, shape (n,), `UNDECIDED` = not yet; of the others what they wish.
    """
    state, frame = now[agent], outlook.frame[agent]
    left = table[row[agent]]
    own = np.int64(left[state])
    out[:] = 0
    for k in range(N_CELLS):
        there = around.window[state, around.turned[frame, k]]
        if there < 0 or left[there] == UNREACHABLE:
            out[k] = _OBSTACLE
            continue
        nearer = (np.int64(left[there]) - own) / unit
        out[k] = np.int8(ONE * min(max(nearer, -_FARTHEST), _FARTHEST))
        other = outlook.stands[there]
        if other < 0 or other == agent:
            continue
        out[N_CELLS + k] = ONE
        decided = goes[other] != UNDECIDED
        heading = _heading_of(goes[other] - around.cell[there], around.cols) if decided else outlook.wished[other]
        if heading != _NOWHERE:
            move = move_in(frame, heading)
            out[2 * N_CELLS + k] = ONE * (1 if move == 0 else -1 if move == 2 else 0)
            out[3 * N_CELLS + k] = ONE * (1 if move == 1 else -1 if move == 3 else 0)
        out[4 * N_CELLS + k] = ONE if decided else -ONE
        out[5 * N_CELLS + k] = np.int8(ONE * outlook.spare[other])
    scalar = _N_LAYERS * N_CELLS
    depth = around.depth[state]
    out[scalar] = min(depth, 4) * ONE
    for move in range(4):
        there = around.beside[state, heading_in(frame, move)]
        if there >= 0:
            out[scalar + 1 + move] = min(max(around.depth[there] - depth, -4), 4) * ONE
    out[scalar + 5] = np.int8(4 * ONE * outlook.place[agent] / len(now))
    out[scalar + 6] = np.int8(ONE * min(own / unit / 4, _FARTHEST))
    out[scalar + 7] = np.int8(ONE * min(waited[agent] / 4, _FARTHEST))
