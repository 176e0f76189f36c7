"""What agents of the traffic layer are told, and which moves they can make; the same for every fidelity."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.envs.grid.fleet import N_KINDS, FleetSite
from fleet.envs.grid.kernel import NONE, Bools, Distances, Ints, SmallInts
from maps.grid import DCOL, DROW
from planners.mapf.distance_table import UNREACHABLE

N_OWN, N_PER_MOVE = 16, 6
"""Numbers about the car itself, and about each of its moves."""
N_BEHIND, N_AHEAD, N_ASIDE = 1, 3, 2
"""Cells that a car sees behind it, ahead of it, and to either side."""
N_SEEN = (N_BEHIND + 1 + N_AHEAD) * (2 * N_ASIDE + 1)
N_ROW_NUMBERS = N_OWN + N_KINDS * N_PER_MOVE + 2 * N_SEEN
"""Numbers in an observation."""
WAIT_UNIT = 60.0
"""Waiting is told in units of so many timesteps."""
GAIN_UNIT = 10.0
"""Detours are told in units of so many timesteps."""
CONTENDERS_UNIT = 3.0
"""Other cars that could enter a cell are told in units of so many."""
_DROW, _DCOL = np.array(DROW), np.array(DCOL)


class TrafficView(NamedTuple):
    """A fleet as right of way sees it; n cars."""

    state: Ints
    """Lane-graph state in which each car's way ends as far as it is decided, shape (n,): agents choose how to go on."""
    goal: Ints
    """Lane-graph state, or `NONE`, shape (n,)."""
    phase: SmallInts
    """`Phase` of each car, shape (n,)."""
    held: Bools
    """Waits for room at its station, shape (n,)."""
    locked: Bools
    """Cannot choose: is served, or still has a move to make, shape (n,)."""
    priority: FloatArray
    """Larger goes first; timesteps since the goal was given and a head start; less than 0 = is where it should be."""


class FloorTold(NamedTuple):
    """What never changes about a floor; S states."""

    distance: Distances
    """Timesteps to the goals, a row for each, shape (n_rows, S)."""
    goal_row: Ints
    """Row of `distance` of each state that is a goal, else `NONE`, shape (S,)."""
    move_to: Ints
    """State that each kind of move leads to, or `NONE`, shape (S, N_KINDS)."""
    state_cell: Ints
    """Cell of each state, shape (S,)."""
    where: npt.NDArray[np.float32]
    """What a car in each state is told of where it is, shape (S, 4)."""
    xy: npt.NDArray[np.float32]
    """Place of each state in units of the floor's diagonal, shape (S, 2)."""
    seen: Ints
    """Cells seen from each state, `NONE` where no lane leads, shape (S, N_SEEN)."""
    far_steps: float
    """The longest way to any place, in timesteps."""


class CellMemory(NamedTuple):
    """Working memory of a look, one entry per cell; between looks all cells are empty."""

    occupant: Ints
    """The car in each cell, or `NONE`."""
    rivals: Ints
    """How many cars could enter it."""
    best: FloatArray
    """The highest priority of these, -inf without one."""


class TrafficObserver:
    """Makes rows of numbers in [-1, 1] of a fleet (layout: see `fleet.envs.traffic.env`).

    Args:
        place: The site.
    """

    def __init__(self, place: FleetSite) -> None:
        graph, grid = place.graph, place.site.grid
        # Told once for every state: where it lies, and the cells seen from it.
        pose = graph.state_pose
        size = np.array([grid.cols, grid.rows]) * grid.cell_m
        where = np.column_stack((2.0 * pose[:, :2] / size - 1.0, np.cos(pose[:, 2]), np.sin(pose[:, 2])))
        self._surroundings = FloorTold(
            distance=place.floor.distance,
            goal_row=place.goal_row,
            move_to=place.move_to,
            state_cell=graph.state_cell,
            where=where.astype(np.float32),
            xy=np.ascontiguousarray(pose[:, :2] / np.hypot(*size)).astype(np.float32),
            seen=_seen_cells(place),
            far_steps=float(place.far_steps),
        )
        self._memory = CellMemory(
            occupant=np.full(graph.n_cells, NONE, dtype=np.int32),
            rivals=np.zeros(graph.n_cells, dtype=np.int32),
            best=np.full(graph.n_cells, -np.inf),
        )

    def look(self, view: TrafficView) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int8]]:
        """Observe all cars.

        Returns:
            Observations, shape (n, N_ROW_NUMBERS), and which of the actions are legal, shape (n, 1 + N_KINDS).
        """
        n = len(view.state)
        rows = np.zeros((n, N_ROW_NUMBERS), dtype=np.float32)
        mask = np.zeros((n, 1 + N_KINDS), dtype=np.int8)
        observe(view, self._surroundings, self._memory, rows, mask)
        return rows, mask


@njit(cache=True, nogil=True)
def observe(
    view: TrafficView,
    floor: FloorTold,
    memory: CellMemory,
    rows: npt.NDArray[np.float32],
    mask: npt.NDArray[np.int8],
) -> None:  # pragma: no cover - compiled
    """Fill in `rows` and `mask`; the memory is empty again after the call."""
    distance, goal_row, move_to, state_cell, where, xy, seen, far_steps = floor
    occupant, rivals, best = memory
    n = len(view.state)
    for car in range(n):
        state = view.state[car]
        occupant[state_cell[state]] = car
        if not view.locked[car]:
            for kind in range(move_to.shape[1]):
                to = move_to[state, kind]
                if to != NONE:
                    rivals[state_cell[to]] += 1
                    best[state_cell[to]] = max(best[state_cell[to]], view.priority[car])
    for car in range(n):
        state, goal = view.state[car], view.goal[car]
        row, told = np.int32(NONE), rows[car]
        if goal != NONE:
            row = goal_row[goal]
        told[0:4] = where[state]
        if view.phase[car] < 5:
            told[4 + view.phase[car]] = 1.0
        told[9] = view.held[car]
        left = np.int64(0)
        if row != NONE:
            left = np.int64(distance[row, state])
            told[10] = min(1.0, left / far_steps)
            dx, dy = xy[goal, 0] - xy[state, 0], xy[goal, 1] - xy[state, 1]
            told[11] = where[state, 2] * dx + where[state, 3] * dy
            told[12] = where[state, 2] * dy - where[state, 3] * dx
        told[13] = min(1.0, max(0.0, view.priority[car]) / WAIT_UNIT)
        told[14] = state == goal
        told[15] = view.locked[car]
        mask[car, 0] = 1
        for kind in range(move_to.shape[1]):
            to = move_to[state, kind]
            if to == NONE or view.locked[car]:
                continue
            mask[car, 1 + kind] = 1
            cell, at = state_cell[to], N_OWN + kind * N_PER_MOVE
            told[at] = 1.0
            if row != NONE and distance[row, to] < UNREACHABLE:
                told[at + 1] = max(-1.0, min(1.0, (left - np.int64(distance[row, to])) / GAIN_UNIT))
            other = occupant[cell]
            if other != NONE:
                told[at + 2] = 1.0
                told[at + 3] = view.locked[other] or view.state[other] == view.goal[other]
            told[at + 4] = min(1.0, (rivals[cell] - 1) / CONTENDERS_UNIT)
            told[at + 5] = best[cell] > view.priority[car]
        at = N_OWN + move_to.shape[1] * N_PER_MOVE
        for k in range(seen.shape[1]):
            cell = seen[state, k]
            if cell == NONE:
                told[at + k] = 1.0
            elif occupant[cell] != NONE:
                told[at + seen.shape[1] + k] = 1.0
    for car in range(n):
        state = view.state[car]
        occupant[state_cell[state]] = NONE
        for kind in range(move_to.shape[1]):
            to = move_to[state, kind]
            if to != NONE:
                rivals[state_cell[to]] = 0
                best[state_cell[to]] = -np.inf


def _seen_cells(place: FleetSite) -> Ints:
    """Cells around each state, as its car sees them, row by row from behind and each from the left, `NONE` where no
    lane leads; shape (n_states, N_SEEN)."""
    graph, grid = place.graph, place.site.grid
    has_lane = np.zeros(graph.n_cells, dtype=np.bool_)
    has_lane[graph.state_cell] = True
    row, col = np.divmod(graph.state_cell, grid.cols)
    ahead, left = graph.state_heading, (graph.state_heading + 1) % 4
    seen = np.full((graph.n_states, N_SEEN), NONE, dtype=np.int32)
    k = 0
    for forward in range(-N_BEHIND, N_AHEAD + 1):
        for aside in range(N_ASIDE, -N_ASIDE - 1, -1):
            to_row = row + forward * _DROW[ahead] + aside * _DROW[left]
            to_col = col + forward * _DCOL[ahead] + aside * _DCOL[left]
            inside = (to_row >= 0) & (to_row < grid.rows) & (to_col >= 0) & (to_col < grid.cols)
            cell = np.where(inside, to_row * grid.cols + to_col, 0)
            seen[:, k] = np.where(inside & has_lane[cell], cell, NONE)
            k += 1
    return seen
