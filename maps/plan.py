"""FloorPlan: the ASCII drawing of a site, checked character by character and split into masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from maps.errors import PlanError
from maps.grid import EAST, NORTH, SOUTH, WEST, BoolGrid

LEGEND: dict[str, str] = {
    "#": "wall",
    "=": "shelf",
    "_": "kept clear: no vehicle, nothing built (beside arms)",
    ".": "floor, lane directions derived",
    ">": "floor, one-way east",
    "<": "floor, one-way west",
    "^": "floor, one-way north (up)",
    "v": "floor, one-way south (down)",
    "x": "floor, two-way (needs allow_reverse and a passing place)",
    "P": "pick dock",
    "D": "drop dock",
    "A": "arm of the dock beside it; a dock may have two, on opposite sides",
    "K": "parking",
    "C": "charger",
    "S": "storage place of a shelf pod",
}
"""What each character of a plan means."""

ARROWS: dict[str, int] = {">": EAST, "^": NORTH, "<": WEST, "v": SOUTH}
_BLOCKED = "#=_A"
_BAYS = "PDKCS"


@dataclass(frozen=True, kw_only=True, eq=False)
class FloorPlan:
    """A rectangular drawing, one character per cell, row 0 on top."""

    lines: tuple[str, ...]
    chars: npt.NDArray[np.str_]
    """Shape (rows, cols), one character each."""

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.lines), len(self.lines[0])

    def mask(self, characters: str) -> BoolGrid:
        """Cells whose character is one of `characters`, shape (rows, cols)."""
        return np.isin(self.chars, list(characters))

    def cells(self, characters: str) -> list[int]:
        """Indices of these cells in reading order."""
        return [int(cell) for cell in np.flatnonzero(self.mask(characters))]

    @property
    def open(self) -> BoolGrid:
        """Cells a vehicle may stand on."""
        return ~self.mask(_BLOCKED)

    @property
    def bays(self) -> BoolGrid:
        """Docks, parking, charging and storage cells: places where cars stand, each with one way in and one way out."""
        return self.mask(_BAYS)

    @property
    def arrows(self) -> npt.NDArray[np.int8]:
        """Heading of one-way cells, -1 elsewhere, shape (rows, cols)."""
        arrows = np.full(self.shape, -1, dtype=np.int8)
        for character, heading in ARROWS.items():
            arrows[self.mask(character)] = heading
        return arrows


def parse_plan(lines: Sequence[str], *, where: str) -> FloorPlan:
    """Check a drawing and take it apart.

    Args:
        lines: Rows of the plan from top to bottom.
        where: Name of the site or file, opens every message.

    Raises:
        PlanError: The plan is empty, not rectangular, holds an unknown character, or lacks a pick or a drop dock.
    """
    if not lines or not lines[0]:
        raise PlanError(f"{where}: plan is empty; valid: at least one row of cells")
    for number, line in enumerate(lines):
        if len(line) != len(lines[0]):
            raise PlanError(
                f"{where}: plan row {number} has {len(line)} characters; valid: {len(lines[0])} like the first row"
            )
        for column, character in enumerate(line):
            if character not in LEGEND:
                raise PlanError(
                    f"{where}: plan row {number}, column {column}: unknown character {character!r}; "
                    f"valid: one of {' '.join(LEGEND)}"
                )
    chars = np.array([list(line) for line in lines])
    for character, what in (("P", "pick"), ("D", "drop")):
        if not (chars == character).any():
            raise PlanError(f"{where}: plan has no {what} dock; valid: at least one {character!r} cell")
    return FloorPlan(lines=tuple(lines), chars=chars)
