"""Parametric warehouse: racks in blocks between aisles, pick arms west, drop arms east, parking north and south."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from maps.errors import PlanError
from maps.site import Site, site_from_plan

_SIDE_LANES = 2
"""Lanes along the west and east walls: the dock lane and one beside it, so that cars can pass a dock queue."""
_DOCK_PITCH = 3
"""Smallest distance between docks on one wall [cells]: between two of them cars can change to the lane beside."""
_DOCK_MARGIN = 3
"""Nearest row to the north and south wall for a dock, so that cars come to it straight and leave it straight."""
_PARKING_RUN = 5
"""Parking cells between two gaps that join the lanes on either side."""


def generate_warehouse(
    *,
    rows: int,
    cols: int,
    pick: int,
    drop: int,
    parking: int,
    chargers: int = 0,
    rack_rows: int = 2,
    rack_cols: int = 5,
    name: str | None = None,
) -> Site:
    """Lay out a warehouse of any size.

    Arms stand in the west (pick) and east (drop) wall with the dock lane in front of them and a free lane beside it.
    Parking and charging cells fill whole rows between two lanes, alternately from the north and the south wall: a car
    enters from one lane and leaves to the other, past nobody.

    Args:
        rows: Height of the plan with its walls [cells].
        cols: Width of the plan with its walls [cells].
        pick: Pick stations, at least 1.
        drop: Drop stations, at least 1.
        parking: Parking cells, at least 0.
        chargers: Charging cells, at least 0.
        rack_rows: Rows of shelves in a block, at least 1.
        rack_cols: Columns of shelves in a block, at least 1.
        name: Name of the site; by default "warehouse-ROWSxCOLS".

    Raises:
        PlanError: A number is out of range, or stations or parking do not fit; tells how many do.
    """
    name = name or f"warehouse-{rows}x{cols}"
    where = f"warehouse {name}"
    for what, value, least in (
        ("rows", rows, 7),
        ("cols", cols, 9),
        ("pick", pick, 1),
        ("drop", drop, 1),
        ("parking", parking, 0),
        ("chargers", chargers, 0),
        ("rack_rows", rack_rows, 1),
        ("rack_cols", rack_cols, 1),
    ):
        if value < least:
            raise PlanError(f"{where}: {what} is {value}; valid: at least {least}")
    docks_fit = (rows - 1 - 2 * _DOCK_MARGIN) // _DOCK_PITCH + 1
    for what, value in (("pick", pick), ("drop", drop)):
        if value > docks_fit:
            raise PlanError(
                f"{where}: {what} is {value}; valid: at most {docks_fit}, the docks that fit along {rows} rows"
            )

    chars = np.full((rows, cols), ".")
    chars[[0, -1], :] = "#"
    chars[:, [0, -1]] = "#"
    _place_docks(chars, pick, dock_col=1, arm_col=0, dock="P")
    _place_docks(chars, drop, dock_col=cols - 2, arm_col=cols - 1, dock="D")
    first, last = _place_parking(chars, ["C"] * chargers + ["K"] * parking, where)
    _place_racks(chars, first, last, rack_rows, rack_cols)
    return site_from_plan(["".join(line) for line in chars], name=name)


def _place_docks(chars: npt.NDArray[np.str_], count: int, *, dock_col: int, arm_col: int, dock: str) -> None:
    """Spread docks along a wall; the wall beside an arm is left out to give the arm room."""
    first, last = _DOCK_MARGIN, chars.shape[0] - 1 - _DOCK_MARGIN
    spread = np.linspace(first, last, count) if count > 1 else [(first + last) / 2]
    for row in spread:
        at = int(row + 0.5)
        chars[at, dock_col] = dock
        chars[at - 1 : at + 2, arm_col] = ["_", "A", "_"]


def _place_parking(chars: npt.NDArray[np.str_], wanted: list[str], where: str) -> tuple[int, int]:
    """Fill parking rows; returns the first and last row left for racks and aisles."""
    north, south = 1, chars.shape[0] - 2  # lane rows next to the rest of the floor
    left, right = 1 + _SIDE_LANES, chars.shape[1] - 2 - _SIDE_LANES
    usable = [col for col in range(left, right + 1) if (col - left) % (_PARKING_RUN + 1) != _PARKING_RUN]
    n_wanted = len(wanted)
    from_north = True
    while wanted:
        if south - north <= 1:
            raise PlanError(f"{where}: {n_wanted} parking and charging cells; valid: at most {n_wanted - len(wanted)}")
        row = north + 1 if from_north else south - 1
        north, south = (north + 2, south) if from_north else (north, south - 2)
        from_north = not from_north
        here, wanted = wanted[: len(usable)], wanted[len(usable) :]
        for col, character in zip(usable, here, strict=False):
            chars[row, col] = character
        for col in usable[len(here) :]:
            chars[row, col] = "="  # a part-filled row stays a row between two lanes
    return north + 1, south - 1


def _place_racks(chars: npt.NDArray[np.str_], first: int, last: int, rack_rows: int, rack_cols: int) -> None:
    left, right = 1 + _SIDE_LANES, chars.shape[1] - 2 - _SIDE_LANES
    for row in range(first, last + 1):
        if (row - first) % (rack_rows + 1) == rack_rows:
            continue
        for col in range(left, right + 1):
            if (col - left) % (rack_cols + 1) != rack_cols:
                chars[row, col] = "="
