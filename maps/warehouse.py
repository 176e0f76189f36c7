"""Parametric warehouse: racks in blocks between aisles, stations along the walls and between the racks, parking."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from maps.errors import PlanError
from maps.site import Site, site_from_plan

Sides = Literal["we", "nesw", "none"]
"""Walls along which stations stand: west and east, all four, or none."""
_Chars = npt.NDArray[np.str_]

_SIDE_LANES = 2
"""Lanes along a wall with stations: the dock lane and one beside it, so that cars can pass a dock queue."""
_DOCK_PITCH = 3
"""Smallest distance between docks on one wall [cells]: between two of them cars can change to the lane beside."""
_DOCK_MARGIN = 3
"""Nearest row to the north and south wall for a dock, so that cars come to it straight and leave it straight."""
_PARKING_RUN = 5
"""Parking cells between two gaps that join the lanes on either side."""
_ISLAND_ROWS = 3
"""Length of a siding: a cell to turn into and wait in, the dock, a cell to leave straight."""


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
    sides: Sides = "we",
    islands: bool = False,
    lanes: int = 1,
    cell_m: float = 1.0,
    name: str | None = None,
) -> Site:
    """Lay out a warehouse of any size.

    Arms in a wall have the dock lane in front of them and a free lane beside it; pick arms stand in the west and the
    north wall, drop arms in the east and the south wall. An island is an arm in a block of racks beside a siding, a
    lane of three cells across the block from one aisle to the next: a car turns off the aisle, waits and is served
    where nobody has to pass, and leaves straight. Islands lie in rows of blocks spread over the floor, picks and drops
    in turn, so that ways are short and no part of the floor is crowded. Parking and charging cells fill whole rows
    between two lanes, alternately from the north and the south wall: a car enters from one lane and leaves to the
    other, past nobody.

    How many stations `n` cars need: a car does a task in `t_s = ways_m / v_mps + 2 * service_s`, ways there and loaded
    together, so `n / t_s` tasks begin each second, and each keeps an arm of either kind busy for `service_s`. Cars come
    at random, so arms that are busy half of their time are enough: `2 * n * service_s / t_s` stations of each kind.
    With islands, ways are about 0.4 times as long as rows and columns together.

    Args:
        rows: Height of the plan with its walls [cells].
        cols: Width of the plan with its walls [cells].
        pick: Pick stations, at least 1.
        drop: Drop stations, at least 1.
        parking: Parking cells, at least 0.
        chargers: Charging cells, at least 0.
        rack_rows: Rows of shelves in a block, at least 1; blocks with islands have three.
        rack_cols: Columns of shelves in a block, at least 1, with islands at least 2.
        sides: Walls along which stations stand; "none" needs islands.
        islands: Stations for which the walls have no room stand between the racks.
        lanes: Lanes side by side between two blocks, at least 1.
        cell_m: Edge of a cell, and width of a lane, see `site_from_plan` [m].
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
        ("rack_cols", rack_cols, 2 if islands else 1),
        ("lanes", lanes, 1),
    ):
        if value < least:
            raise PlanError(f"{where}: {what} is {value}; valid: at least {least}")
    if sides not in get_args(Sides):
        raise PlanError(f"{where}: sides is {sides!r}; valid: one of {', '.join(get_args(Sides))}")
    if sides == "none" and not islands:
        raise PlanError(f"{where}: sides is none without islands; valid: one of we, nesw, or islands")

    chars = np.full((rows, cols), ".")
    chars[[0, -1], :] = "#"
    chars[:, [0, -1]] = "#"
    left_over = []
    for what, value, dock, walls in (("pick", pick, "P", "wn"), ("drop", drop, "D", "es")):
        fits = {wall: _docks_fit(chars, wall) for wall in walls if sides != "none" and wall in sides}
        on_walls = min(value, sum(fits.values()))
        if on_walls < value and not islands:
            raise PlanError(f"{where}: {what} is {value}; valid: at most {on_walls}, {_fit_words(fits, rows, cols)}")
        _place_docks(chars, on_walls, fits, dock)
        left_over.append(value - on_walls)
    first, last = _place_parking(
        chars, ["C"] * chargers + ["K"] * parking, where, _SIDE_LANES if sides == "nesw" else 1
    )
    _place_racks(chars, first, last, (rack_rows, rack_cols), lanes, left_over, where)
    return site_from_plan(["".join(line) for line in chars], name=name, cell_m=cell_m)


def _docks_fit(chars: _Chars, wall: str) -> int:
    """Most docks along a wall."""
    length = len(chars if wall in "we" else chars.T)
    return (length - 1 - 2 * _DOCK_MARGIN) // _DOCK_PITCH + 1


def _fit_words(fits: dict[str, int], rows: int, cols: int) -> str:
    """What limits the docks along walls."""
    return f"the docks that fit along {rows} rows" + (f" and {cols} columns" if len(fits) > 1 else "")


def _place_docks(chars: _Chars, count: int, fits: dict[str, int], dock: str) -> None:
    """Spread docks along one wall or two, by their length; the wall beside an arm is left out to give the arm room."""
    left, room = count, sum(fits.values())
    for wall, fit in fits.items():
        here = int(left * fit / room + 0.5)
        left, room = left - here, room - fit
        # Views in which the wall is the first column; writing to them writes to the plan.
        side = {"w": chars, "e": chars[:, ::-1], "n": chars.T, "s": chars[::-1].T}[wall]
        first, last = _DOCK_MARGIN, side.shape[0] - 1 - _DOCK_MARGIN
        spread = np.linspace(first, last, here) if here > 1 else [(first + last) / 2] * here
        for along in spread:
            at = int(along + 0.5)
            side[at, 1] = dock
            side[at - 1 : at + 2, 0] = ["_", "A", "_"]


def _place_parking(chars: _Chars, wanted: list[str], where: str, margin: int) -> tuple[int, int]:
    """Fill parking rows, `margin` lanes off the walls; returns the first and last row left for racks and aisles."""
    north, south = margin, chars.shape[0] - 1 - margin  # lane rows next to the rest of the floor
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


def _place_racks(
    chars: _Chars, first: int, last: int, rack: tuple[int, int], lanes: int, stations: list[int], where: str
) -> None:
    """Fill the floor with blocks of racks between aisles; rows of blocks with islands lie evenly among the others.

    Args:
        chars: The plan; changed.
        first: First row for racks.
        last: Last row for racks.
        rack: Rows and columns of a block.
        lanes: Lanes between two blocks.
        stations: Pick and drop stations to stand in blocks.
        where: Opens every message.
    """
    rack_rows, rack_cols = rack
    left, right = 1 + _SIDE_LANES, chars.shape[1] - 2 - _SIDE_LANES
    most_lanes = max(1, right - left - rack_cols, last - first - rack_rows)
    if lanes > most_lanes:
        raise PlanError(f"{where}: lanes is {lanes}; valid: at most {most_lanes}, with a block of racks on either side")
    starts = range(left, right + 1, rack_cols + lanes)
    whole = [col for col in starts if col + rack_cols - 1 <= right]
    n_islands, n_rows = sum(stations), last - first + 1 + lanes
    fit = len(whole) * max(n_rows // (_ISLAND_ROWS + lanes), 0)
    if n_islands > fit:
        raise PlanError(
            f"{where}: {n_islands} stations between the racks, {stations[0]} pick and {stations[1]} drop; valid: at "
            f"most {fit}, one in each block of racks"
        )
    n_island_rows = -(-n_islands // len(whole)) if n_islands else 0
    n_rack_rows = max(n_rows - n_island_rows * (_ISLAND_ROWS + lanes), 0) // (rack_rows + lanes)
    heights = [rack_rows] * (n_island_rows + n_rack_rows)
    with_islands = {int((k + 0.5) * len(heights) / n_island_rows) for k in range(n_island_rows)}
    for number in with_islands:
        heights[number] = _ISLAND_ROWS
    heights.append(max(n_rows - sum(heights) - lanes * (len(heights) + 1), 0))  # a part of a block is the last

    blocks, row = [], first
    for number, height in enumerate(heights):
        for col in starts:
            chars[row : row + height, col : min(col + rack_cols, right + 1)] = "="
        if number in with_islands:
            blocks += [(row, col) for col in whole]
        row += height + lanes
    if n_islands:
        _place_islands(chars, blocks, rack_cols, stations)


def _place_islands(chars: _Chars, blocks: list[tuple[int, int]], rack_cols: int, stations: list[int]) -> None:
    """Spread stations over blocks, picks and drops in turn."""
    # Each kind is spread evenly over the sequence, whatever the numbers are.
    kinds = sorted(((k + 0.5) / count, dock) for dock, count in zip("PD", stations, strict=True) for k in range(count))
    spread = np.linspace(0, len(blocks), len(kinds), endpoint=False)
    for (_, dock), block in zip(kinds, spread, strict=True):
        row, col = blocks[int(block)]
        siding = col + max(1, rack_cols // 2)
        chars[row : row + _ISLAND_ROWS, siding - 1] = ["_", "A", "_"]
        chars[row : row + _ISLAND_ROWS, siding] = [".", dock, "."]
