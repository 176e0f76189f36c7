"""What agents of the traffic layer are told, and which moves they can make; the same for every fidelity."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.abstract.compiled import compiled, inlined
from fleet.abstract.fleet import N_KINDS, FleetSite
from fleet.abstract.kernel import NONE, Bools, Distances, Ints, SmallInts
from fleet.arrays import FloatArray
from maps.grid import DCOL, DROW
from planners.mapf.distance_table import UNREACHABLE

N_OWN, N_PER_MOVE, N_PER_CELL = 19, 9, 8
"""Numbers about the car itself, about each of its moves, and about each cell that it sees."""
N_BEHIND, N_AHEAD, N_ASIDE = 1, 3, 2
"""Cells that a car sees behind it, ahead of it, and to either side."""
N_SEEN = (N_BEHIND + 1 + N_AHEAD) * (2 * N_ASIDE + 1)
OWN = slice(0, N_OWN)
MOVES = slice(OWN.stop, OWN.stop + N_KINDS * N_PER_MOVE)
CELLS = slice(MOVES.stop, MOVES.stop + N_SEEN * N_PER_CELL)
"""Where the three parts of an observation stand; `MOVES` has `N_KINDS` groups, `CELLS` has `N_SEEN`."""
N_ROW_NUMBERS = CELLS.stop
"""Numbers in an observation."""
N_WAY = 6
"""Cells of a way that are searched for cars."""
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
    proposed: Ints
    """State that PIBT would send each car to, shape (n,)."""


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
    n_cols: int
    """Columns of cells."""


class CellMemory(NamedTuple):
    """Working memory of a look, one entry per cell unless said otherwise; between looks all cells are empty."""

    occupant: Ints
    """The car in each cell, or `NONE`."""
    rivals: Ints
    """How many cars could enter it."""
    askers: Ints
    """How many of them would enter it if they were alone."""
    best: FloatArray
    """The highest priority of these, -inf without one."""
    onward: Ints
    """State that each car would be in next if it were alone, shape (n_cars,)."""


class TrafficObserver:
    """Makes rows of numbers in [-1, 1] of a fleet (layout: see `fleet.envs.traffic.env`).

    Args:
        place: The site.
        n_cars: Cars of the fleet.
    """

    def __init__(self, place: FleetSite, n_cars: int) -> None:
        graph, grid = place.graph, place.site.grid
        # Told once for every state: where it lies, and the cells seen from it.
        pose = graph.state_pose
        size = np.array([grid.cols, grid.rows]) * grid.cell_m
        where = np.column_stack((2.0 * pose[:, :2] / size - 1.0, np.cos(pose[:, 2]), np.sin(pose[:, 2])))
        self.surroundings = FloorTold(
            distance=place.floor.distance,
            goal_row=place.goal_row,
            move_to=place.move_to,
            state_cell=graph.state_cell,
            where=where.astype(np.float32),
            xy=np.ascontiguousarray(pose[:, :2] / np.hypot(*size)).astype(np.float32),
            seen=_seen_cells(place),
            far_steps=float(place.far_steps),
            n_cols=int(grid.cols),
        )
        self.memory = CellMemory(
            occupant=np.full(graph.n_cells, NONE, dtype=np.int32),
            rivals=np.zeros(graph.n_cells, dtype=np.int32),
            askers=np.zeros(graph.n_cells, dtype=np.int32),
            best=np.full(graph.n_cells, -np.inf),
            onward=np.empty(n_cars, dtype=np.int32),
        )

    def look(self, view: TrafficView) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int8]]:
        """Observe all cars.

        Returns:
            Observations, shape (n, N_ROW_NUMBERS), and which of the actions are legal, shape (n, 1 + N_KINDS).
        """
        n = len(view.state)
        rows = np.zeros((n, N_ROW_NUMBERS), dtype=np.float32)
        mask = np.zeros((n, 1 + N_KINDS), dtype=np.int8)
        observe(view, self.surroundings, self.memory, rows, mask)
        return rows, mask


@compiled
def observe(
    view: TrafficView,
    floor: FloorTold,
    memory: CellMemory,
    rows: npt.NDArray[np.float32],
    mask: npt.NDArray[np.int8],
) -> None:  # pragma: no cover - compiled
    """Fill in `rows` and `mask`, which are zero before; the memory is empty again after the call."""
    _gather(view, floor, memory)
    for car in range(len(view.state)):
        mask[car, 0] = 1
        _tell_own(view, floor, memory, car, rows[car])
        for kind in range(floor.move_to.shape[1]):
            to = floor.move_to[view.state[car], kind]
            if to != NONE and not view.locked[car]:
                mask[car, 1 + kind] = 1
                at = N_OWN + kind * N_PER_MOVE
                _tell_move(view, floor, memory, car, to, rows[car, at : at + N_PER_MOVE])
        for k in range(floor.seen.shape[1]):
            at = N_OWN + floor.move_to.shape[1] * N_PER_MOVE + k * N_PER_CELL
            _tell_cell(view, floor, memory, car, floor.seen[view.state[car], k], rows[car, at : at + N_PER_CELL])
    _forget(view, floor, memory)


@inlined
def _gather(view: TrafficView, floor: FloorTold, memory: CellMemory) -> None:  # pragma: no cover - compiled
    """Enter all cars, and what they want, into the memory."""
    for car in range(len(view.state)):
        state = view.state[car]
        memory.occupant[floor.state_cell[state]] = car
        memory.onward[car] = state
        if view.locked[car]:
            continue
        for kind in range(floor.move_to.shape[1]):
            to = floor.move_to[state, kind]
            if to != NONE:
                memory.rivals[floor.state_cell[to]] += 1
        memory.onward[car] = _best_move(floor, view.goal[car], state)
        if memory.onward[car] != state:
            cell = floor.state_cell[memory.onward[car]]
            memory.askers[cell] += 1
            memory.best[cell] = max(memory.best[cell], view.priority[car])


@inlined
def _forget(view: TrafficView, floor: FloorTold, memory: CellMemory) -> None:  # pragma: no cover - compiled
    """Take all that was entered out of the memory again."""
    for car in range(len(view.state)):
        state = view.state[car]
        memory.occupant[floor.state_cell[state]] = NONE
        for kind in range(floor.move_to.shape[1]):
            to = floor.move_to[state, kind]
            if to != NONE:
                cell = floor.state_cell[to]
                memory.rivals[cell], memory.askers[cell], memory.best[cell] = 0, 0, -np.inf


@inlined
def _best_move(floor: FloorTold, goal: int, state: int) -> int:  # pragma: no cover - compiled
    """State that a car would be in next if it were alone; its own where no move brings it nearer to its goal."""
    best = state
    if goal != NONE and floor.goal_row[goal] != NONE:
        left = floor.distance[floor.goal_row[goal]]
        for kind in range(floor.move_to.shape[1]):
            to = floor.move_to[state, kind]
            if to != NONE and left[to] < left[best]:
                best = to
    return best


@inlined
def _tell_own(
    view: TrafficView, floor: FloorTold, memory: CellMemory, car: int, told: npt.NDArray[np.float32]
) -> None:  # pragma: no cover - compiled
    """What a car is told of itself."""
    state, goal = view.state[car], view.goal[car]
    for k in range(4):
        told[k] = floor.where[state, k]
    if view.phase[car] < 5:
        told[4 + view.phase[car]] = 1.0
    told[9] = view.held[car]
    if goal != NONE and floor.goal_row[goal] != NONE:
        told[10] = min(1.0, np.int64(floor.distance[floor.goal_row[goal], state]) / floor.far_steps)
        dx, dy = floor.xy[goal, 0] - floor.xy[state, 0], floor.xy[goal, 1] - floor.xy[state, 1]
        told[11], told[12] = _turned(floor, state, dx, dy)
    told[13] = min(1.0, max(0.0, view.priority[car]) / WAIT_UNIT)
    told[14] = state == goal
    told[15] = view.locked[car]
    told[16] = view.proposed[car] == state
    told[17] = memory.askers[floor.state_cell[state]] > 0
    told[18] = memory.best[floor.state_cell[state]] > view.priority[car]


@inlined
def _tell_move(
    view: TrafficView, floor: FloorTold, memory: CellMemory, car: int, to: int, told: npt.NDArray[np.float32]
) -> None:  # pragma: no cover - compiled
    """What a car is told of a move to a state."""
    state, goal, cell = view.state[car], view.goal[car], floor.state_cell[to]
    told[0] = 1.0
    if goal != NONE and floor.goal_row[goal] != NONE:
        left = floor.distance[floor.goal_row[goal]]
        if left[to] < UNREACHABLE:
            told[1] = max(-1.0, min(1.0, (np.int64(left[state]) - np.int64(left[to])) / GAIN_UNIT))
    other = memory.occupant[cell]
    if other != NONE:
        told[2] = 1.0
        told[3] = memory.onward[other] == view.state[other]
    told[4] = min(1.0, (memory.rivals[cell] - 1) / CONTENDERS_UNIT)
    asked = memory.onward[car] == to
    told[5] = memory.askers[cell] > asked
    told[6] = memory.best[cell] > view.priority[car]
    told[7] = view.proposed[car] == to
    n_cars, at = 0, to
    for _ in range(N_WAY):
        onward = _best_move(floor, goal, at)
        if onward == at:
            break
        at = onward
        n_cars += memory.occupant[floor.state_cell[at]] != NONE
    told[8] = n_cars / N_WAY


@inlined
def _tell_cell(
    view: TrafficView, floor: FloorTold, memory: CellMemory, car: int, cell: int, told: npt.NDArray[np.float32]
) -> None:  # pragma: no cover - compiled
    """What a car is told of a cell around it, `NONE` = no lane leads there."""
    if cell == NONE:
        told[0] = 1.0
        return
    other = memory.occupant[cell]
    if other == NONE:
        return
    state, its, onward = view.state[car], view.state[other], memory.onward[other]
    told[1] = 1.0
    told[2], told[3] = _turned(floor, state, floor.where[its, 2], floor.where[its, 3])
    if onward == its:
        told[6] = 1.0
    else:
        here, there = floor.state_cell[its], floor.state_cell[onward]
        east, north = there % floor.n_cols - here % floor.n_cols, here // floor.n_cols - there // floor.n_cols
        told[4], told[5] = _turned(floor, state, np.float32(east), np.float32(north))
    told[7] = max(-1.0, min(1.0, (view.priority[other] - view.priority[car]) / WAIT_UNIT))


@inlined
def _turned(
    floor: FloorTold, state: int, dx: np.float32, dy: np.float32
) -> tuple[float, float]:  # pragma: no cover - compiled
    """A vector as a car in a state sees it: ahead, and to the left."""
    cos, sin = floor.where[state, 2], floor.where[state, 3]
    return cos * dx + sin * dy, cos * dy - sin * dx


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
