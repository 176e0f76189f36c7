"""The MovingAI benchmark formats (.map, .scen), and sites made from published floor plans."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from maps.errors import MapsError, SiteError
from maps.grid import DCOL, DROW, EAST, NORTH, SOUTH, WEST, GridMap
from maps.orientation import n_separated, orient_lanes
from maps.plan import parse_plan
from maps.reading.shown import shown
from maps.reading.text_file import FileError, read_lines
from maps.site import Site, site_from_plan
from maps.stations import MIN_ARM_SPACING_M, match_arms

_PASSABLE = ".GSE"
"""`E` marks the stations on maps of the League of Robot Runners."""
_BLOCKED = "@OTW"
_SHELVES = "T"
"""Trees mark racks on the warehouse maps; they become shelves, other obstacles walls."""
_STATION_SPACING = 4
"""Smallest distance between two docks [cells], so that a queue at one does not reach the other at once."""
_ATTEMPTS = 20
_MAP_HEADER = 4
_COUNT = re.compile(r"[0-9]{1,9}")
_SCENARIO_FIELDS = (
    "bucket",
    "map",
    "map width",
    "map height",
    "start column",
    "start row",
    "goal column",
    "goal row",
    "length",
)


class MovingAiError(MapsError):
    """A .map or .scen file is malformed; the message names file, line and field."""


@dataclass(frozen=True, kw_only=True)
class ScenarioEntry:
    """One start and goal of a .scen file."""

    line: int
    """Line of the file, from 1."""
    bucket: int
    map_name: str
    map_size: tuple[int, int]
    """(rows, cols)."""
    start: tuple[int, int]
    """(row, col)."""
    goal: tuple[int, int]
    """(row, col)."""
    length: float
    """Published length of the shortest path with diagonal steps [cells]."""


def read_map(path: str | os.PathLike[str]) -> GridMap:
    """Read a .map file as free and blocked cells.

    Raises:
        MovingAiError: The file cannot be read or is malformed.

    Source: N. Sturtevant, Benchmarks for grid-based pathfinding, IEEE TCIAIG 2012.
    """
    return GridMap(np.isin(_read_chars(path), list(_PASSABLE)))


def read_marks(path: str | os.PathLike[str]) -> npt.NDArray[np.str_]:
    """Read the characters of a .map file, shape (rows, cols).

    Raises:
        MovingAiError: The file cannot be read or is malformed.
    """
    return _read_chars(path)


def read_scenario(path: str | os.PathLike[str]) -> tuple[ScenarioEntry, ...]:
    """Read a .scen file.

    Raises:
        MovingAiError: The file cannot be read or a line is malformed.
    """
    lines = _read_lines(path)
    if not lines or not lines[0].startswith("version"):
        found = shown(lines[0]) if lines else "an empty file"
        raise MovingAiError(f"{path}: line 1 is {found}; valid: 'version 1'")
    return tuple(
        _entry(f"{path}: line {number}", number, line) for number, line in enumerate(lines[1:], start=2) if line.strip()
    )


def starts_and_goals(
    path: str | os.PathLike[str], grid: GridMap, *, agents: int | None = None
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Read a .scen file as a problem on a map: everybody starts, and ends, in a cell of its own that it can get to.

    Args:
        path: A .scen file.
        grid: The map.
        agents: How many entries to take, from the first on; None = all.

    Returns:
        Start cell and goal cell of each agent, shape (n,) each.

    Raises:
        MovingAiError: The file cannot be read, is malformed or empty; there are fewer entries, or free cells, than
            agents; an entry is of a map of another size, starts or ends on an obstacle, outside the map or where an
            earlier one does, or has no way from start to goal.
    """
    from scipy.ndimage import label

    entries = read_scenario(path)
    if not entries:
        raise MovingAiError(f"{path}: no entries; valid: at least one line below the first")
    if agents is not None:
        if not 1 <= agents <= len(entries):
            raise MovingAiError(f"{path}: {agents} agents asked for; valid: 1 to {len(entries)}, one per entry")
        entries = entries[:agents]
    if len(entries) > grid.free.sum():
        raise MovingAiError(f"{path}: {len(entries)} agents; valid: at most {grid.free.sum()}, the map's free cells")
    region, _ = label(grid.free)
    first: dict[tuple[str, tuple[int, int]], int] = {}
    for entry in entries:
        where = f"{path}: line {entry.line}"
        if entry.map_size != grid.free.shape:
            raise MovingAiError(
                f"{where}: map height and width are {entry.map_size}; valid: {grid.free.shape} as in the map"
            )
        for what, cell in (("start", entry.start), ("goal", entry.goal)):
            at = f"{where}: {what} row {cell[0]}, column {cell[1]}"
            if not (0 <= cell[0] < grid.rows and 0 <= cell[1] < grid.cols):
                raise MovingAiError(
                    f"{at} is outside the map; valid: row 0 to {grid.rows - 1}, column 0 to {grid.cols - 1}"
                )
            if not grid.free[cell]:
                raise MovingAiError(f"{at} is an obstacle; valid: a free cell")
            before = first.setdefault((what, cell), entry.line)
            if before != entry.line:
                raise MovingAiError(f"{at} is that of line {before} too; valid: a cell of its own")
        if region[entry.start] != region[entry.goal]:
            raise MovingAiError(
                f"{where}: goal row {entry.goal[0]}, column {entry.goal[1]} has no way from the start; "
                "valid: a cell in the same part of the map"
            )
    return (
        np.array([grid.index(*entry.start) for entry in entries], dtype=np.int32),
        np.array([grid.index(*entry.goal) for entry in entries], dtype=np.int32),
    )


def _entry(where: str, number: int, line: str) -> ScenarioEntry:
    """One line of a .scen file."""
    fields = line.split("\t") if "\t" in line else line.split()
    if len(fields) != len(_SCENARIO_FIELDS):
        raise MovingAiError(
            f"{where}: {len(fields)} fields; valid: {len(_SCENARIO_FIELDS)}, {', '.join(_SCENARIO_FIELDS)}"
        )
    whole = []
    for name, value in zip(_SCENARIO_FIELDS, fields, strict=True):
        if name not in ("map", "length"):
            try:
                whole.append(int(value))
            except ValueError:
                raise MovingAiError(f"{where}: {name} is {shown(value)}; valid: a whole number") from None
    try:
        length = float(fields[-1])
    except ValueError:
        raise MovingAiError(f"{where}: length is {shown(fields[-1])}; valid: a number") from None
    bucket, map_cols, map_rows, start_col, start_row, goal_col, goal_row = whole
    return ScenarioEntry(
        line=number,
        bucket=bucket,
        map_name=fields[1],
        map_size=(map_rows, map_cols),
        start=(start_row, start_col),
        goal=(goal_row, goal_col),
        length=length,
    )


def site_from_map(
    path: str | os.PathLike[str], *, pick: int, drop: int, parking: int, chargers: int = 0, name: str | None = None
) -> Site:
    """Turn a published floor plan into a site with stations and parking.

    Arms replace obstacle cells beside a straight lane: picks in the west, drops in the east, spread over the floor,
    preferably where cars can pass the dock on a second lane. Obstacles beside an arm are left out (kept clear) to give
    it room. Parking takes free cells in open areas. Free cells of the map stay free. The same file and numbers always
    give the same site.

    Args:
        path: A .map file.
        pick: Pick stations, at least 1.
        drop: Drop stations, at least 1.
        parking: Parking cells, at least 0.
        chargers: Charging cells, at least 0.
        name: Name of the site; by default the file's name without its ending.

    Raises:
        MovingAiError: The file cannot be read or is malformed, or a number is negative.
        SiteError: The map has no room for so many stations or parking cells; tells how many fit.
    """
    name = name or Path(path).stem
    numbers = {"pick": (pick, 1), "drop": (drop, 1), "parking": (parking, 0), "chargers": (chargers, 0)}
    for what, (value, least) in numbers.items():
        if value < least:
            raise MovingAiError(f"{path}: {what} is {value}; valid: at least {least}")
    source = _read_chars(path)
    chars = np.full(source.shape, "#")
    chars[np.isin(source, list(_PASSABLE))] = "."
    chars[np.isin(source, list(_SHELVES))] = "="
    chars[[0, -1], :] = np.where(chars[[0, -1], :] == "=", "#", chars[[0, -1], :])
    chars[:, [0, -1]] = np.where(chars[:, [0, -1]] == "=", "#", chars[:, [0, -1]])

    refused: set[int] = set()
    for _ in range(_ATTEMPTS):
        drawn = _draw_places(chars, pick, drop, chargers, parking, refused, name)
        bad = _unserved(drawn, name)
        if not bad:
            return site_from_plan(["".join(line) for line in drawn], name=name)
        refused |= bad
    raise SiteError(
        f"site {name}: no room found for {pick} pick, {drop} drop, {parking} parking and {chargers} charger cells; "
        "valid: smaller numbers"
    )


def _draw_places(
    chars: npt.NDArray[np.str_], pick: int, drop: int, chargers: int, parking: int, refused: set[int], name: str
) -> npt.NDArray[np.str_]:
    """A copy of the plan with docks, arms and bays at the best cells not refused so far."""
    drawn = chars.copy()
    candidates = [place for place in _dock_candidates(chars) if place.row * chars.shape[1] + place.col not in refused]
    taken: list[_DockCandidate] = []
    for character, what, count, from_west in (("P", "pick", pick, True), ("D", "drop", drop, False)):
        chosen = _spread(candidates, count, taken, chars.shape, from_west=from_west)
        if len(chosen) < count:
            raise SiteError(
                f"site {name}: {count} {what} stations asked for; valid: at most {len(chosen)}, which fit this map"
            )
        for place in chosen:
            drawn[place.row, place.col] = character
            _draw_arm(drawn, *place.arm)
        taken += chosen
    _draw_bays(drawn, ["C"] * chargers + ["K"] * parking, [(place.row, place.col) for place in taken], refused, name)
    return drawn


@dataclass(frozen=True, kw_only=True)
class _DockCandidate:
    """A cell of a straight lane beside an obstacle that an arm could replace."""

    demerits: int
    row: int
    col: int
    arm_side: int

    @property
    def arm(self) -> tuple[int, int]:
        return self.row + DROW[self.arm_side], self.col + DCOL[self.arm_side]

    def clear_of(self, other: _DockCandidate, spacing: int) -> bool:
        """Docks at least `spacing` cells apart along the aisles, arms far enough for both to turn."""
        docks = abs(self.row - other.row) + abs(self.col - other.col)
        arms = abs(self.arm[0] - other.arm[0]) + abs(self.arm[1] - other.arm[1])
        return docks >= spacing and arms > MIN_ARM_SPACING_M


def _dock_candidates(chars: npt.NDArray[np.str_]) -> list[_DockCandidate]:
    """Wherever a straight lane runs past an obstacle; demerits for what slows traffic or crowds the arm."""
    rows, cols = chars.shape
    free, blocked = np.pad(chars == ".", 2), np.pad(chars != ".", 2)  # neither, beyond the border
    found = []
    for arm_side in (EAST, NORTH, WEST, SOUTH):
        to_arm = np.array((DROW[arm_side], DCOL[arm_side]))
        along = to_arm[::-1]

        def at(mask: npt.NDArray[np.bool_], offset: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
            """The mask seen from every cell at an offset (rows, cols) of at most two."""
            return mask[2 + offset[0] : 2 + offset[0] + rows, 2 + offset[1] : 2 + offset[1] + cols]

        fits = at(free, 0 * along) & at(blocked, to_arm) & at(free, along) & at(free, -along)
        demerits = 4 * ~at(free, -to_arm)  # no second lane to pass the dock
        for step in (along, -along):
            demerits = demerits + 8 * ~at(blocked, to_arm + step)  # a lane beside the arm
            demerits += 4 * ~at(free, step - to_arm)
            demerits += 1 * ~at(free, 2 * step)  # a turn right before or after the dock
        for row, col in np.argwhere(fits).tolist():
            found.append(_DockCandidate(demerits=int(demerits[row, col]), row=row, col=col, arm_side=arm_side))
    return found


def _spread(
    candidates: list[_DockCandidate],
    count: int,
    taken: list[_DockCandidate],
    shape: tuple[int, ...],
    *,
    from_west: bool,
) -> list[_DockCandidate]:
    """Good candidates near one side, far from each other: spacing shrinks, then the region grows, until enough fit."""
    width = shape[1]

    def depth(place: _DockCandidate) -> int:
        return place.col if from_west else width - 1 - place.col

    ranked = sorted(candidates, key=lambda place: (place.demerits, depth(place), place.row, place.arm_side))
    chosen: list[_DockCandidate] = []
    for region in (0.25, 0.5, 1.0):
        here = [place for place in ranked if depth(place) < region * width]
        spacing = max(_STATION_SPACING, sum(shape) // count)
        while True:
            chosen = []
            for place in here:
                if all(place.clear_of(other, spacing) for other in chosen) and all(
                    place.clear_of(other, _STATION_SPACING) for other in taken
                ):
                    chosen.append(place)
                    if len(chosen) == count:
                        return chosen
            if spacing == _STATION_SPACING:
                break
            spacing = max(_STATION_SPACING, spacing * 3 // 4)
    return chosen


def _draw_arm(drawn: npt.NDArray[np.str_], row: int, col: int) -> None:
    drawn[row, col] = "A"
    for heading in range(4):
        beside = (row + DROW[heading], col + DCOL[heading])
        if 0 <= beside[0] < drawn.shape[0] and 0 <= beside[1] < drawn.shape[1] and drawn[beside] in "#=":
            drawn[beside] = "_"


def _draw_bays(
    drawn: npt.NDArray[np.str_], wanted: list[str], docks: list[tuple[int, int]], refused: set[int], name: str
) -> None:
    """Put parking and chargers on cells with the most free floor around, not side by side and away from docks."""
    free = np.pad(drawn == ".", 1)
    cols = drawn.shape[1]
    around = sum(
        np.roll(free, shift, axis=(0, 1))[1:-1, 1:-1].astype(np.int64)
        for shift in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
    )
    around = np.where(drawn == ".", around, -1)
    # Lattice (odd row, odd column) first: bays there leave all lanes of even rows and columns whole.
    row, col = np.indices(drawn.shape)
    order = np.lexsort((col.ravel(), row.ravel(), ((row % 2 == 0) | (col % 2 == 0)).ravel(), -around.ravel()))
    near_dock = np.zeros(drawn.shape, dtype=np.bool_)
    for dock_row, dock_col in docks:
        near_dock[max(0, dock_row - 3) : dock_row + 4, max(0, dock_col - 2) : dock_col + 3] = True
    placed = 0
    for cell in order.tolist():
        if placed == len(wanted):
            return
        at = divmod(cell, cols)
        if around.flat[cell] < 0 or near_dock[at] or cell in refused:
            continue
        block = drawn[max(0, at[0] - 1) : at[0] + 2, max(0, at[1] - 1) : at[1] + 2]
        if np.isin(block, ["K", "C"]).any():
            continue
        drawn[at] = wanted[placed]
        placed += 1
    if placed < len(wanted):
        raise SiteError(
            f"site {name}: {len(wanted)} parking and charger cells asked for; "
            f"valid: at most {placed}, which fit this map"
        )


def _unserved(drawn: npt.NDArray[np.str_], name: str) -> set[int]:
    """Docks and bays that the lanes of this drawing leave out, and bays where a standing car would shut others off."""
    where = f"site {name}"
    plan = parse_plan(["".join(line) for line in drawn], where=where)
    lanes = orient_lanes(plan, match_arms(plan, GridMap(plan.open), where=where)).lanes
    places = plan.cells("PDKC")
    left_out = set(places) - set(np.intersect1d(lanes[:, 0], lanes[:, 1]).tolist())
    if left_out:
        return left_out
    start, end = lanes.astype(np.int64).T
    return {cell for cell in plan.cells("KC") if n_separated(start, end, cell, np.array(places)) > 0}


def _read_lines(path: str | os.PathLike[str]) -> list[str]:
    try:
        return read_lines(path, str(path), valid="a .map or .scen file of the MovingAI benchmarks")
    except FileError as error:
        raise MovingAiError(str(error)) from error


def _read_chars(path: str | os.PathLike[str]) -> npt.NDArray[np.str_]:
    """The map's characters, shape (rows, cols)."""
    lines = _read_lines(path)
    size = {}
    if len(lines) < _MAP_HEADER or not lines[0].startswith("type") or lines[3].strip() != "map":
        raise MovingAiError(
            f"{path}: lines 1-4 are {shown(' / '.join(lines[:_MAP_HEADER]))}; "
            "valid: 'type octile', 'height H', 'width W' and 'map'"
        )
    for number in (2, 3):
        key, _, value = lines[number - 1].partition(" ")
        if key not in ("height", "width") or not _COUNT.fullmatch(value.strip()) or int(value) < 1:
            raise MovingAiError(
                f"{path}: line {number} is {shown(lines[number - 1])}; valid: 'height' or 'width' and a number"
            )
        size[key] = int(value)
    if size.keys() != {"height", "width"}:
        raise MovingAiError(f"{path}: lines 2 and 3 both give {next(iter(size))}; valid: height and width")
    body = lines[_MAP_HEADER : _MAP_HEADER + size["height"]]
    if len(body) != size["height"]:
        raise MovingAiError(f"{path}: {len(body)} map rows; valid: {size['height']}, the height in its head")
    known = _PASSABLE + _BLOCKED
    for number, line in enumerate(body, start=_MAP_HEADER + 1):
        if len(line) != size["width"]:
            raise MovingAiError(
                f"{path}: line {number} has {len(line)} cells; valid: {size['width']}, the width in its head"
            )
        unknown = set(line) - set(known)
        if unknown:
            raise MovingAiError(
                f"{path}: line {number}: unknown cell {min(unknown)!r}; valid: one of {' '.join(known)}"
            )
    return np.array([list(line) for line in body])
