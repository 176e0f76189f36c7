"""LaneDrawing: lanes of a floor as text: every other character is a cell, the one between two cells is their lane."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
import numpy.typing as npt

from maps.errors import PlanError
from maps.grid import GridMap

Ints = npt.NDArray[np.int32]

_ALONG = {">": (0, 1), "<": (0, -1), "^": (-1, 0), "v": (1, 0)}
"""Step (rows, cols) of a one-way lane."""
_BOTH = {"-": True, "|": False}
"""Two-way lanes, and whether they lie in a row."""


def draw_lanes(chars: npt.NDArray[np.str_], lanes: Ints, grid: GridMap) -> list[str]:
    """Draw lanes between the characters of cells.

    Args:
        chars: One for each cell, shape (rows, cols).
        lanes: Directed lanes (from cell, to cell), shape (n, 2).
        grid: The floor of the cells.

    Returns:
        2 rows - 1 lines of 2 cols - 1 characters at most; `-` and `|` are two-way lanes.
    """
    canvas = np.full((2 * grid.rows - 1, 2 * grid.cols - 1), " ")
    canvas[::2, ::2] = chars
    known = {(int(a), int(b)) for a, b in lanes}
    for start, end in known:
        (row, col), (next_row, next_col) = grid.row_col(start), grid.row_col(end)
        across = row == next_row
        arrow = (">" if next_col > col else "<") if across else ("v" if next_row > row else "^")
        if (end, start) in known:
            arrow = "-" if across else "|"
        canvas[row + next_row, col + next_col] = arrow
    return ["".join(line).rstrip() for line in canvas]


def read_lanes(lines: Sequence[str], rows: int, cols: int, *, where: str) -> Ints:
    """Read what `draw_lanes` writes; characters of cells do not matter.

    Args:
        lines: The drawing from top to bottom.
        rows: Rows of the plan that it belongs to.
        cols: Columns of that plan.
        where: Opens every message.

    Returns:
        Directed lanes (from cell, to cell), sorted, shape (n, 2).

    Raises:
        PlanError: Another size than that of the plan, or a character between two cells that is no lane.
    """
    if len(lines) != 2 * rows - 1:
        raise PlanError(f"{where}: lanes have {len(lines)} lines; valid: {2 * rows - 1}, two for each row but the last")
    found = []
    for number, line in enumerate(lines):
        if len(line) > 2 * cols - 1:
            raise PlanError(
                f"{where}: lanes line {number} has {len(line)} characters; valid: at most {2 * cols - 1}, two for "
                "each column but the last"
            )
        for place, character in enumerate(line):
            in_row = number % 2 == 0
            if character == " " or (in_row and place % 2 == 0):
                continue
            row, col = number // 2, place // 2
            first = row * cols + col
            second = first + (1 if in_row else cols)
            step = _ALONG.get(character)
            fits = (in_row or place % 2 == 0) and (
                _BOTH.get(character) == in_row if step is None else (step[0] == 0) == in_row
            )
            if not fits:
                raise PlanError(
                    f"{where}: lanes line {number}, column {place}: {character!r} is no lane; valid: "
                    f"{'one of > < -' if in_row else 'one of ^ v |' if place % 2 == 0 else 'a space'}"
                )
            if step is None or sum(step) > 0:
                found.append((first, second))
            if step is None or sum(step) < 0:
                found.append((second, first))
    return np.array(sorted(found), dtype=np.int32).reshape(-1, 2)


def check_lanes(lanes: Ints, open_cells: npt.NDArray[np.bool_], grid: GridMap, *, where: str) -> None:
    """Lanes lead between cells of the floor.

    Args:
        lanes: Directed lanes (from cell, to cell), shape (n, 2).
        open_cells: Cells a vehicle may stand on, shape (rows, cols).
        grid: Their floor.
        where: Opens every message.

    Raises:
        PlanError: One begins or ends where no vehicle may stand.
    """
    for lane, end in product(range(len(lanes)), range(2)):
        cell = int(lanes[lane, end])
        if not open_cells.ravel()[cell]:
            raise PlanError(
                f"{where}: lanes {'lead to' if end else 'begin at'} {grid.words(cell)}, where nothing "
                "drives; valid: lanes between open cells of the plan"
            )
