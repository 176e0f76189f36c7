"""Floor: obstacles by the cell a car is in, and the distance of every cell to a goal."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.open_floor.arrays import BoolArray, FloatArray, IntArray
from planners.open_floor.kernels.body import CarBody, body_meets_disc
from planners.open_floor.kernels.kernel import kernel
from planners.open_floor.problem import OpenFloorProblem

UNREACHED = math.inf
"""Distance of a cell from which there is no way."""
_CELLS_PER_RADIUS = 3.0


class StaticFloor(NamedTuple):
    """What does not move; a cell has a third of the turning radius as its side."""

    width: float
    height: float
    cell: float
    n_across: int
    n_up: int
    disc: FloatArray
    """x, y and radius with the margin, shape (k, 3)."""
    near_ptr: IntArray
    """Discs that a car with its axle in cell c may touch: near[near_ptr[c] : near_ptr[c + 1]], shape (n_cells + 1,)."""
    near: IntArray
    blocked: BoolArray
    """Cells in whose middle no car can have its axle, whatever its heading, shape (n_across, n_up)."""
    walled: bool
    inset: float
    """Margin to the walls, if there are any."""


def floor_of(problem: OpenFloorProblem, body: CarBody, margin_m: float) -> StaticFloor:
    """Prepare the floor of a problem.

    Args:
        problem: Floor and obstacles.
        body: Of the cars.
        margin_m: Kept from obstacles [m].
    """
    cell = problem.car.turning_radius_m / _CELLS_PER_RADIUS
    n_across, n_up = (max(1, math.ceil(side / cell)) for side in problem.size_m)
    index = np.stack(np.meshgrid(np.arange(n_across), np.arange(n_up), indexing="ij"), axis=-1).reshape(-1, 2)
    middle = (index + 0.5) * cell
    disc = problem.discs + np.array([0.0, 0.0, margin_m])
    distance = np.linalg.norm(middle[:, None] - disc[None, :, :2], axis=2) if len(disc) else np.empty((len(middle), 0))
    touchable = distance < disc[:, 2] + abs(body.centre) + body.reach + cell
    cells, near = np.nonzero(touchable)
    return StaticFloor(
        width=float(problem.size_m[0]),
        height=float(problem.size_m[1]),
        cell=cell,
        n_across=n_across,
        n_up=n_up,
        disc=disc,
        near_ptr=np.concatenate([[0], np.cumsum(np.bincount(cells, minlength=len(middle)))]),
        near=near.astype(np.int64),
        blocked=(distance < disc[:, 2] + min(body.half_width, body.half_length - abs(body.centre)))
        .any(axis=1)
        .reshape(n_across, n_up),
        walled=problem.walled,
        inset=margin_m,
    )


@kernel
def cell_of(x: float, y: float, floor: StaticFloor) -> tuple[int, int]:
    """The cell of a place on the floor, or the nearest."""
    across = min(max(int(x / floor.cell), 0), floor.n_across - 1)
    up = min(max(int(y / floor.cell), 0), floor.n_up - 1)
    return across, up


@kernel
def is_free(x: float, y: float, cos: float, sin: float, floor: StaticFloor, body: CarBody) -> bool:
    """Whether a car stands on the floor and clear of obstacles."""
    if x < 0.0 or y < 0.0 or x > floor.width or y > floor.height:
        return False
    if floor.walled:
        middle_x, middle_y = x + body.centre * cos, y + body.centre * sin
        half_x = body.half_length * abs(cos) + body.half_width * abs(sin) + floor.inset
        half_y = body.half_length * abs(sin) + body.half_width * abs(cos) + floor.inset
        if middle_x < half_x or middle_y < half_y:
            return False
        if middle_x > floor.width - half_x or middle_y > floor.height - half_y:
            return False
    across, up = cell_of(x, y, floor)
    c = across * floor.n_up + up
    for k in range(floor.near_ptr[c], floor.near_ptr[c + 1]):
        d = floor.near[k]
        if body_meets_disc(x, y, cos, sin, floor.disc[d, 0], floor.disc[d, 1], floor.disc[d, 2], body):
            return False
    return True


def distances_to(goal: FloatArray, floor: StaticFloor) -> FloatArray:
    """Length of the shortest way of a point to a goal around the obstacles, from cell to its eight neighbours.

    Args:
        goal: Pose x, y, yaw, shape (3,).
        floor: The floor.

    Returns:
        Distances [m], `UNREACHED` where there is no way, shape (n_across, n_up).
    """
    distance = np.full((floor.n_across, floor.n_up), UNREACHED)
    size = floor.n_across * floor.n_up
    _spread(goal[0], goal[1], floor, distance, np.empty(size, np.int32), np.zeros(size, np.bool_))
    return distance


@kernel
def _spread(
    x: float, y: float, floor: StaticFloor, distance: FloatArray, queue: npt.NDArray[np.int32], queued: BoolArray
) -> None:
    """Correct distances from a goal outwards until none changes."""
    across, up = cell_of(x, y, floor)
    size = len(queue)
    distance[across, up] = 0.0
    queue[0], first, n = across * floor.n_up + up, 0, 1
    while n > 0:
        cell = queue[first]
        first, n = (first + 1) % size, n - 1
        queued[cell] = False
        across, up = cell // floor.n_up, cell % floor.n_up
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                i, j = across + dx, up + dy
                if i < 0 or j < 0 or i >= floor.n_across or j >= floor.n_up or floor.blocked[i, j]:
                    continue
                length = distance[across, up] + floor.cell * math.sqrt(dx * dx + dy * dy)
                if length < distance[i, j] - 1e-9:
                    distance[i, j] = length
                    k = i * floor.n_up + j
                    if not queued[k]:
                        queued[k] = True
                        queue[(first + n) % size] = k
                        n += 1
