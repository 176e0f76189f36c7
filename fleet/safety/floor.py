"""FloorCheck: whose each cell is by the grants alone, and whether every body is in cells of its own."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, CellArray, FloatArray
from fleet.robots.cars.models import CarModels
from fleet.run.view import RunView
from fleet.safety.breach import Breach, Invariant
from fleet.safety.faults import CarFaults
from maps.lane_graph import LaneGraph
from planners.precedence.arrays import Int64Array
from planners.precedence.queues import Queues

TAIL_M, DEVIATIONS = 0.04, 3.0
"""A body may reach into a cell that is not its own by the tail of a car whose move is done [m], and by so many standard
deviations of a position measurement. What a move swept is released 0.05 m before its end, where a car is to stand with
its tail 0.01 m inside its cell; the next car's nose keeps 0.49 m off the border."""
PATH_STRAY_M = 0.001
"""A move's path is sampled, and its body may be this far outside between samples [m]."""
_TWO_HOLDERS, _OTHER_HOLDER = 1, 2
_NONE = -2


class FloorCheck:
    """Holders of cells, and the bodies in them.

    Who holds what is found out anew in every tick, from the states cars have reached, the moves they were granted and
    what they reserved. What the dependency graph keeps must say the same.

    Args:
        run: The run.
        faults: Cars that may be anywhere.
    """

    def __init__(self, run: RunView, faults: CarFaults) -> None:
        self._run = run
        self._faults = faults
        self._dependencies = run.executor.dependencies
        grid, models = run.site.grid, run.scene.cars
        self._grid = grid
        self._size = (grid.rows, grid.cols, grid.cell_m)
        self._walls = np.flatnonzero(~grid.free.ravel())
        narrowest_m = min(kind.half_width_m for kind in models.kinds)
        self._stray_m = min(TAIL_M + DEVIATIONS * run.config.estimate.noise_m, narrowest_m)
        self._bodies = _bodies(models, self._stray_m)[models.kind_of]
        self._owner = np.empty(grid.n_cells, dtype=np.int32)
        self._n_reasons = np.empty(grid.n_cells, dtype=np.int32)
        self._closed = run.executor.closed.copy()
        self._n_granted = self._dependencies.n_granted_so_far()
        self.inside: BoolArray = np.ones(run.world.n_cars, dtype=np.bool_)
        """Whether each car's body is in its own cells, shape (n_cars,)."""

    def moves(self) -> Breach | None:
        """Whether the moves of the lane graph sweep the cells that they say; once is enough, as it does not change."""
        graph = self._run.graph
        # Each model has moves of its own, in its turn.
        firsts = np.searchsorted(graph.move_from, np.arange(graph.n_kinds + 1) * graph.n_places).tolist()
        bodies = _bodies(self._run.scene.cars, PATH_STRAY_M)
        for body, (first, end) in zip(bodies, pairwise(firsts), strict=True):
            paths = graph.path_ptr[first : end + 1], graph.swept_ptr[first : end + 1]
            move, cell = _escapes(paths, graph.path_points, graph.swept_cell, body, self._size)
            if move >= 0:
                move += first
                break
        else:
            return None
        return Breach(
            invariant=Invariant.SWEPT,
            words=f"the body of a car on move {move} of the lane graph is in cell {self._name(cell)}, "
            f"and the move is said to sweep {self._names(_swept(graph, move))}",
            valid="only those cells",
            place=self._name(cell),
            values={"move": move, "path": graph.path_points[graph.path_ptr[move] : graph.path_ptr[move + 1]]},
        )

    def look(self, poses: FloatArray) -> Breach | None:
        """Find out whose each cell is, and who is where it must not be.

        Args:
            poses: True rear-axle poses x, y, yaw, shape (n_cars, 3).
        """
        queues = self._dependencies.queues
        reserved = self._dependencies.reservations()
        kind, cell, first, second = _holders(queues, reserved, self._owner, self._n_reasons)
        if kind:
            return self._held_wrongly(kind, cell, first, second)
        car, cell = self._let_in()
        if car >= 0:
            return self._closed_to(car, cell)
        self._owner[self._walls] = -1  # a car that was shoved into a wall holds it, and does not belong there
        car, cell = _strays(poses, self._bodies, self._owner, self._size, self._faults.cars, self.inside)
        return None if car < 0 else self._strayed(car, cell, poses[car])

    def _let_in(self) -> tuple[int, int]:
        """A car that was granted a move into a cell that was closed before and still is, and the cell; -1 if none."""
        closed, n_granted = self._run.executor.closed, self._dependencies.n_granted_so_far()
        shut = self._closed & closed
        found = _entered(self._dependencies.queues, self._n_granted, shut) if shut.any() else (-1, -1)
        self._closed, self._n_granted = closed.copy(), n_granted
        return found

    def _closed_to(self, car: int, cell: int) -> Breach:
        return Breach(
            invariant=Invariant.CLOSED,
            words=f"{_car(car)} was let into cell {self._name(cell)}, which is closed",
            valid="no grant into a closed cell",
            robots=(_car(car),),
            place=self._name(cell),
            values={"own_cells": self._names(self._dependencies.held_cells(car))},
        )

    def _held_wrongly(self, kind: int, cell: int, first: int, second: int) -> Breach:
        robots = tuple(f"car_{car}" for car in (first, second) if car >= 0)
        if kind == _TWO_HOLDERS:
            words = f"cell {self._name(cell)} was granted to {' and '.join(robots)}"
        else:
            words = (
                f"cell {self._name(cell)} is held by {_car(first)} by what was granted ({self._n_reasons[cell]} "
                f"reasons), and by {_car(second)} by the books ({self._dependencies.queues.holds[cell]} reasons)"
            )
        held = {name: self._names(self._dependencies.held_cells(int(name[4:]))) for name in robots}
        return Breach(
            invariant=Invariant.GRANTS,
            words=words,
            valid="one holder, by the grants and by the books",
            robots=robots,
            place=self._name(cell),
            values={"held": held},
        )

    def _strayed(self, car: int, cell: int, pose: FloatArray) -> Breach:
        holder = int(self._owner[cell]) if cell >= 0 else -1
        own = self._names(np.flatnonzero(self._owner == car).tolist())
        x, y, yaw = (round(float(value), 4) for value in pose)
        whose = f", which {_car(holder)} holds" if cell >= 0 else ""
        return Breach(
            invariant=Invariant.FOOTPRINT,
            words=f"car_{car} at x {x} m, y {y} m, yaw {yaw} rad reaches more than {self._stray_m:.2f} m into "
            f"{'cell ' + self._name(cell) if cell >= 0 else 'the outside of the floor'}{whose}",
            valid=f"its own cells {own}",
            robots=(f"car_{car}",) if holder < 0 else (f"car_{car}", f"car_{holder}"),
            place=self._name(cell),
            values={"pose": pose, "own_cells": own, "phase": self._run.missions.phase[car]},
        )

    def _name(self, cell: int) -> str:
        return "{},{}".format(*self._grid.row_col(cell)) if cell >= 0 else "off the floor"

    def _names(self, cells: list[int]) -> list[str]:
        return [self._name(cell) for cell in cells]


def _car(car: int) -> str:
    return f"car_{car}" if car >= 0 else "nobody"


def _swept(graph: LaneGraph, move: int) -> list[int]:
    cells: list[int] = graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]].tolist()
    return cells


def _bodies(models: CarModels, stray_m: float) -> FloatArray:
    """Of each model the middle ahead of its axle, half its length and half its width, less what may stray [m]."""
    kinds = models.kinds
    middles = [(kind.front_m - kind.rear_m) / 2 for kind in kinds]
    lengths = [(kind.front_m + kind.rear_m) / 2 - stray_m for kind in kinds]
    return np.array([middles, lengths, [kind.half_width_m - stray_m for kind in kinds]]).T.copy()


@njit(cache=True)
def _holders(
    q: Queues, reserved: CellArray, owner: CellArray, n_reasons: CellArray
) -> tuple[int, int, int, int]:  # pragma: no cover - compiled
    """Fill in who holds each cell, -1 for nobody, and for how many reasons.

    Returns:
        What is wrong (0 = nothing), the cell, and the two cars that it is about, -1 for none.
    """
    owner[:] = -1
    n_reasons[:] = 0
    room = q.moves.shape[1]
    for car in range(len(q.state)):
        other, cell = _claim(owner, n_reasons, car, q.state_cell[q.state[car]])
        if other >= 0:
            return _TWO_HOLDERS, cell, other, car
        for number in range(q.finished[car], q.granted[car]):
            move = q.moves[car, number % room]
            for k in range(q.swept_ptr[move], q.swept_ptr[move + 1]):
                other, cell = _claim(owner, n_reasons, car, q.swept_cell[k])
                if other >= 0:
                    return _TWO_HOLDERS, cell, other, car
    for row in range(len(reserved)):
        other, cell = _claim(owner, n_reasons, reserved[row, 0], reserved[row, 1])
        if other >= 0:
            return _TWO_HOLDERS, cell, other, reserved[row, 0]
    for cell in range(len(owner)):
        if owner[cell] != q.holder[cell] or n_reasons[cell] != q.holds[cell]:
            return _OTHER_HOLDER, cell, owner[cell], q.holder[cell]
    return 0, -1, -1, -1


@njit(cache=True)
def _entered(q: Queues, before: Int64Array, closed: BoolArray) -> tuple[int, int]:  # pragma: no cover - compiled
    """The first car with a grant since the numbers `before` that ends in a closed cell, and the cell; -1 if none.

    A move that turns on the spot enters nothing.
    """
    room = q.moves.shape[1]
    for car in range(len(q.state)):
        for number in range(max(before[car], q.finished[car]), q.granted[car]):
            move = q.moves[car, number % room]
            cell = q.state_cell[q.move_to[move]]
            if closed[cell] and cell != q.state_cell[q.move_from[move]]:
                return car, cell
    return -1, -1


@njit(cache=True)
def _claim(
    owner: CellArray, n_reasons: CellArray, car: int, cell: int
) -> tuple[int, int]:  # pragma: no cover - compiled
    """Give a cell to a car; returns who has it already, -1 if nobody else, and the cell."""
    if owner[cell] >= 0 and owner[cell] != car:
        return owner[cell], cell
    owner[cell] = car
    n_reasons[cell] += 1
    return -1, cell


@njit(cache=True)
def _strays(
    poses: FloatArray,
    bodies: FloatArray,
    owner: CellArray,
    size: tuple[int, int, float],
    excused: BoolArray,
    inside: BoolArray,
) -> tuple[int, int]:  # pragma: no cover - compiled
    """Fill in which bodies are in their cars' cells; returns the first that is not, and a cell (-1 = off the floor)."""
    wrong, where = -1, -1
    for car in range(len(poses)):
        cell = _foreign(poses[car], bodies[car], owner, car, size)
        inside[car] = cell == _NONE
        if not inside[car] and not excused[car] and wrong < 0:
            wrong, where = car, cell
    return wrong, where


@njit(cache=True)
def _foreign(
    pose: FloatArray, body: FloatArray, owner: CellArray, car: int, size: tuple[int, int, float]
) -> int:  # pragma: no cover - compiled
    """A cell under a body that is not its own, `_NONE` if there is none, -1 if it is off the floor."""
    rows, cols, cell_m = size
    x, y, cos, sin, half_x, half_y = _frame(pose, body)
    for from_below in range(math.floor((y - half_y) / cell_m), math.floor((y + half_y) / cell_m) + 1):
        for col in range(math.floor((x - half_x) / cell_m), math.floor((x + half_x) / cell_m) + 1):
            row = rows - 1 - from_below
            on_floor = 0 <= row < rows and 0 <= col < cols
            if on_floor and owner[row * cols + col] == car:
                continue
            dx, dy = (col + 0.5) * cell_m - x, (from_below + 0.5) * cell_m - y
            if _in_cell(dx, dy, cos, sin, body[1], body[2], cell_m / 2.0):
                return row * cols + col if on_floor else -1
    return _NONE


@njit(cache=True)
def _frame(
    pose: FloatArray, body: FloatArray
) -> tuple[float, float, float, float, float, float]:  # pragma: no cover - compiled
    """Middle of a body, cos and sin of its yaw, and half of its extent along x and along y."""
    shift, length, width = body[0], body[1], body[2]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    half_x, half_y = abs(cos) * length + abs(sin) * width, abs(sin) * length + abs(cos) * width
    return pose[0] + shift * cos, pose[1] + shift * sin, cos, sin, half_x, half_y


@njit(cache=True)
def _in_cell(
    dx: float, dy: float, cos: float, sin: float, length: float, width: float, half: float
) -> bool:  # pragma: no cover - compiled
    """Whether a body overlaps a cell whose middle is at dx, dy from its own: by the axes of the body.

    The axes of the cell part none, as the cell is one of those that the body's extent touches.
    """
    reach = half * (abs(cos) + abs(sin))
    return abs(cos * dx + sin * dy) < length + reach and abs(cos * dy - sin * dx) < width + reach


@njit(cache=True)
def _escapes(
    rows: tuple[CellArray, CellArray],
    path_points: FloatArray,
    swept_cell: CellArray,
    body: FloatArray,
    size: tuple[int, int, float],
) -> tuple[int, int]:  # pragma: no cover - compiled
    """The first move whose body is in a cell that it is not said to sweep, and the cell; -1 and -1 if there is none."""
    owner = np.full(size[0] * size[1], -1, np.int32)
    path_ptr, swept_ptr = rows
    for move in range(len(path_ptr) - 1):
        for k in range(swept_ptr[move], swept_ptr[move + 1]):
            owner[swept_cell[k]] = move
        for point in range(path_ptr[move], path_ptr[move + 1]):
            cell = _foreign(path_points[point], body, owner, move, size)
            if cell != _NONE:
                return move, cell
    return -1, -1
