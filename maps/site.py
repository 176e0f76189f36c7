"""Site: a floor plan with its lanes, stations, parking and chargers; reads and writes site files (TOML)."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from maps.errors import LaneError, PlanError, SiteFileError, StationError, UnknownSiteError
from maps.grid import BoolGrid, GridMap
from maps.lane_drawing import check_lanes, draw_lanes, read_lanes
from maps.plan import FloorPlan, parse_plan
from maps.reading.near import hint
from maps.reading.shown import named, shown
from maps.reading.text_file import FileError, is_file, parse_toml, read_text
from maps.stations import StationOptions, StationPlace, match_arms, name_stations, place_stations

_PASSING_WAYS = 3
"""Open neighbours that make a two-way cell a passing place: two for the way, one to step aside."""
_DATA = Path(__file__).parent / "data"
_FORM = "TOML with name, allow_reverse, cell_m, plan and tables [stations.NAME]"
MAX_CELL_M = 1.25
"""Arms reach no farther than to the middle of a lane as wide as this [m]."""
_VALID = {
    "name": "a text that is not empty",
    "allow_reverse": "true or false",
    "cell_m": f"a number from 1 to {MAX_CELL_M}",
    "plan": "the drawing as a text, a line for each row",
    "lanes": "the lanes as a text, two lines for each row but the last",
    "stations": "tables [stations.NAME]",
    "names": "a table of names of stations, and what others call them",
    "stop_offset_m": "a number >= 0",
    "arm_xy": "[x, y], two numbers",
    "arm_yaw_deg": "a number",
    "slots": "a list of [x, y, z], numbers with z > 0",
}
"""What the entries of a site file hold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Site:
    """Everything about a warehouse floor that does not move."""

    name: str
    grid: GridMap
    """Cells a vehicle may stand on, cut cells included."""
    walls: BoolGrid
    """Wall cells, shape (rows, cols)."""
    shelves: BoolGrid
    """Shelf cells, shape (rows, cols)."""
    lanes: npt.NDArray[np.int32]
    """Directed lanes (from cell, to cell), shape (n_lanes, 2), sorted."""
    stations: tuple[StationPlace, ...]
    """Pick stations first, each kind in reading order of the docks."""
    parking: tuple[int, ...]
    """Parking cells in reading order."""
    chargers: tuple[int, ...]
    cut_cells: tuple[int, ...]
    """Open cells no lane touches: they lie outside the largest strongly connected part."""
    allow_reverse: bool
    plan: tuple[str, ...]
    """The drawing the site was made from."""
    options: Mapping[str, StationOptions] = field(default_factory=dict)
    """What the site file says about single stations, by name."""
    against: npt.NDArray[np.int32] = field(default_factory=lambda: np.empty((0, 2), dtype=np.int32))
    """Lanes of two-way aisles that lead against the aisle's street (from cell, to cell), shape (k, 2), sorted."""
    lanes_given: bool = False
    """Whether the lanes were given and not derived from the drawing; a site file then has them."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Name of a station -> what others call it, in whose layouts it goes by that."""
    storage: tuple[int, ...] = ()
    """Cells in which shelf pods stand, in reading order."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Site):
            return NotImplemented
        words = ("name", "stations", "parking", "chargers", "storage", "cut_cells", "allow_reverse", "plan", "grid")
        same = self.lanes_given == other.lanes_given
        arrays = ("walls", "shelves", "lanes", "against")
        return (
            same
            and all(getattr(self, word) == getattr(other, word) for word in words)
            and dict(self.options) == dict(other.options)
            and dict(self.names) == dict(other.names)
            and all(np.array_equal(getattr(self, array), getattr(other, array)) for array in arrays)
        )

    __hash__ = None  # type: ignore[assignment]

    def station_names(self, kind: Literal["pick", "drop"]) -> list[str]:
        """Names of the stations of a kind, in their order."""
        return [station.name for station in self.stations if station.kind == kind]

    def bays(self) -> dict[str, int]:
        """Cell of each place to stand at, by name.

        Docks are called like their station, the others `parking_1`, ..., `charger_1`, ... and `storage_1`, ... in
        reading order.
        """
        bays = {station.name: station.dock.cell for station in self.stations}
        for kind, cells in (("parking", self.parking), ("charger", self.chargers), ("storage", self.storage)):
            bays |= {f"{kind}_{k}": cell for k, cell in enumerate(cells, start=1)}
        return bays

    def station(self, name: str) -> StationPlace:
        """The station of this name.

        Raises:
            LaneError: There is none; lists the names.
        """
        for station in self.stations:
            if station.name == name:
                return station
        raise LaneError(
            f"site {self.name}: no station {name!r}; valid: one of {', '.join(place.name for place in self.stations)}"
        )


@dataclass(frozen=True, kw_only=True)
class SiteOutline:
    """What the drawing of a site tells without its lanes."""

    name: str
    rows: int
    cols: int
    cell_m: float
    """Edge of a cell [m]."""
    n_pick: int
    """Pick stations."""
    n_drop: int
    """Drop stations."""
    n_parking: int
    """Parking cells."""


_Finite = Annotated[float, Field(allow_inf_nan=False)]


class _StationTable(BaseModel):
    """[stations.NAME] of a site file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    stop_offset_m: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None
    arm: Annotated[str, Field(min_length=1)] | None = None
    arm_xy: tuple[_Finite, _Finite] | None = None
    arm_yaw_deg: _Finite | None = None
    slots: tuple[tuple[_Finite, _Finite, Annotated[float, Field(gt=0.0, allow_inf_nan=False)]], ...] | None = None


class _SiteTable(BaseModel):
    """A site file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str = Field(min_length=1)
    allow_reverse: bool = False
    cell_m: Annotated[float, Field(ge=1.0, le=MAX_CELL_M, allow_inf_nan=False)] = 1.0
    plan: str
    lanes: str | None = None
    stations: dict[str, _StationTable] = {}
    names: dict[str, Annotated[str, Field(min_length=1)]] = {}

    @property
    def lines(self) -> list[str]:
        """Rows of the drawing."""
        return self.plan.strip("\n").split("\n")


def site_names() -> tuple[str, ...]:
    """Names of the sites that ship, sorted."""
    return tuple(sorted(path.stem for path in _DATA.glob("*.toml")))


def site_file(name_or_path: str | os.PathLike[str]) -> Path:
    """Find the file of a site that ships (by name) or of any other (by path).

    Raises:
        UnknownSiteError: Neither a shipped site nor a file.
    """
    text = os.fspath(name_or_path)
    path = _DATA / f"{text}.toml" if text in site_names() else Path(text)
    if not is_file(path):
        what = "a folder" if path.is_dir() else f"unknown{hint(text, site_names())}"
        names = ", ".join(site_names())
        raise UnknownSiteError(f"site {shown(text)} is {what}; valid: one of {names} or a path to a site file")
    return path


def load_site(name_or_path: str | os.PathLike[str]) -> Site:
    """Read a site that ships (by name) or a site file (by path).

    Raises:
        UnknownSiteError: Neither a shipped site nor a file.
        SiteFileError: The file cannot be read or its entries are wrong.
        PlanError, StationError, LaneError: See `site_from_plan`.
    """
    table, where = _read_table(name_or_path)
    options = {name: StationOptions(**entry.model_dump()) for name, entry in table.stations.items()}
    lanes = None
    if table.lanes is not None:
        plan = parse_plan(table.lines, where=where)
        lanes = read_lanes(table.lanes.strip("\n").split("\n"), *plan.shape, where=where)
    return site_from_plan(
        table.lines,
        name=table.name,
        allow_reverse=table.allow_reverse,
        options=options,
        lanes=lanes,
        names=table.names,
        cell_m=table.cell_m,
        where=where,
    )


def outline(name_or_path: str | os.PathLike[str]) -> SiteOutline:
    """Look at a site file without working out its lanes, which takes most of the time of `load_site`.

    Raises:
        UnknownSiteError, SiteFileError: See `load_site`.
        PlanError: Wrong shape or character, or no pick or drop dock.
        StationError: A dock has no arm beside it, or too many.
    """
    table, where = _read_table(name_or_path)
    plan = parse_plan(table.lines, where=where)
    arm_sides = match_arms(plan, GridMap(plan.open), where=where)
    rows, cols = plan.shape
    return SiteOutline(
        name=table.name,
        rows=rows,
        cols=cols,
        cell_m=table.cell_m,
        n_pick=sum(len(arm_sides[dock]) for dock in plan.cells("P")),
        n_drop=sum(len(arm_sides[dock]) for dock in plan.cells("D")),
        n_parking=len(plan.cells("K")),
    )


def _read_table(name_or_path: str | os.PathLike[str]) -> tuple[_SiteTable, str]:
    """The content of a site file, and how messages name it."""
    path = site_file(name_or_path)
    where = f"site {os.fspath(name_or_path)}"
    try:
        content = parse_toml(read_text(path, where, valid=_FORM), where, valid=_FORM)
    except FileError as error:
        raise SiteFileError(str(error)) from error
    content.setdefault("name", path.stem)
    try:
        table = _SiteTable.model_validate(content)
    except ValidationError as error:
        raise SiteFileError(f"{where}: {_first_problem(error)}") from error
    return table, where


def _toml(value: object) -> str:
    """A value as TOML writes it: as JSON does, but for characters that JSON writes as two halves, and for DEL."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def save_site(site: Site, path: str | os.PathLike[str]) -> None:
    """Write a site file that `load_site` reads back as an equal site; an existing file is replaced in one step.

    Raises:
        SiteFileError: The file cannot be written.
    """
    lines = [
        f"name = {_toml(site.name)}",
        f"allow_reverse = {'true' if site.allow_reverse else 'false'}",
        *([] if site.grid.cell_m == 1.0 else [f"cell_m = {site.grid.cell_m}"]),
        "plan = '''",
        *site.plan,
        "'''",
    ]
    if site.lanes_given:
        chars = np.array([list(line) for line in site.plan])
        lines += ["", "# Every other character is a cell, the one between two cells is their lane."]
        lines += ["lanes = '''", *draw_lanes(chars, site.lanes, site.grid), "'''"]
    if site.names:
        lines += ["", "# What others call the stations.", "[names]"]
        lines += [f"{name} = {_toml(theirs)}" for name, theirs in site.names.items()]
    for name, given in site.options.items():
        lines += ["", f"[stations.{name}]"]
        for key, value in vars(given).items():
            if value is not None:
                lines.append(f"{key} = {_toml(value)}")
    target = Path(path)
    if not target.name:
        raise SiteFileError(f"site {site.name}: cannot be written to {str(path)!r}; valid: a file")
    part = target.with_name(target.name + ".part")
    try:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
        part.replace(target)
    except OSError as error:
        raise SiteFileError(
            f"site {site.name}: cannot be written to {target}: {error.strerror or error}; valid: a file in a folder "
            "that is there, can be written and has room on its disk"
        ) from error
    finally:
        with suppress(OSError):
            part.unlink()


def site_from_plan(
    lines: Sequence[str],
    *,
    name: str,
    allow_reverse: bool = False,
    options: Mapping[str, StationOptions] | None = None,
    lanes: npt.NDArray[np.int32] | None = None,
    names: Mapping[str, str] | None = None,
    cell_m: float = 1.0,
    where: str | None = None,
) -> Site:
    """Make a site of a drawing: derive lane directions, stop poses, arms and slots, and check that all of it works.

    Args:
        lines: Rows of the plan, see `maps.plan.LEGEND`.
        name: Name of the site.
        allow_reverse: Cars may drive backwards along the lane they came by; two-way cells need it.
        options: Overrides by station name.
        lanes: Directed lanes (from cell, to cell), shape (n, 2), as they are to be; None derives them.
        names: What others call stations, by station name.
        cell_m: Edge of a cell, and width of a lane, 1 to `MAX_CELL_M` [m].
        where: Opens every message; "site NAME" if not given.

    Raises:
        PlanError: Wrong shape or character, no pick or drop dock, two-way cells without reverse or passing place, or
            cells of a size that is out of range.
        StationError: A dock, its arm, slots and tray do not fit together, arms stand too near each other, or a name is
            that of no station.
        LaneError: A station, parking, charging or storage cell is a dead end or not connected to the rest, or lanes
            that are given are not connected.
    """
    from maps.orientation import given_lanes, orient_lanes  # it needs packages that load for half a second

    where = where or f"site {name}"
    options = dict(options or {})
    plan = parse_plan(lines, where=where)
    if not 1.0 <= cell_m <= MAX_CELL_M:
        raise PlanError(f"{where}: cell_m is {cell_m:g}; valid: {_VALID['cell_m']}")
    grid = GridMap(plan.open, cell_m=cell_m)
    _check_two_way(plan, grid, allow_reverse, where)
    arm_sides = match_arms(plan, grid, where=where)
    if lanes is None:
        orientation = orient_lanes(plan, arm_sides)
    else:
        check_lanes(lanes, plan.open, grid, where=where)
        _check_given(lanes, grid, allow_reverse, where)
        orientation = given_lanes(plan, lanes)
    stations = place_stations(plan, grid, arm_sides, orientation.lanes, options, where=where)
    _check_names(names or {}, stations, where)
    parking, chargers = tuple(plan.cells("K")), tuple(plan.cells("C"))
    _check_bays(plan, grid, orientation.lanes, where)
    if lanes is not None or plan.mask("x").any():
        _check_states(plan, grid, arm_sides, orientation.lanes, where)
    return Site(
        name=name,
        grid=grid,
        walls=plan.mask("#"),
        shelves=plan.mask("="),
        lanes=orientation.lanes,
        stations=stations,
        parking=parking,
        chargers=chargers,
        cut_cells=orientation.cut_cells,
        allow_reverse=allow_reverse,
        plan=plan.lines,
        options=options,
        against=orientation.against,
        lanes_given=lanes is not None,
        names=dict(names or {}),
        storage=tuple(plan.cells("S")),
    )


def _first_problem(error: ValidationError) -> str:
    # A word that is not known may be the one that is missing, spelt wrongly.
    problem = min(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    path = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        model = _StationTable if len(problem["loc"]) > 1 else _SiteTable
        known = model.model_fields
        meant = hint(problem["loc"][-1], known)
        return f"{named(path)} is not a known entry{meant}; valid: one of {', '.join(known)}"
    # Of `stations.pick_1` itself, the last known word is that of the tables; of an entry in a list, that of the list.
    valid = next((_VALID[part] for part in reversed(problem["loc"]) if part in _VALID), _FORM)
    if problem["type"] == "missing":
        return f"{named(path)} is missing; valid: {valid}"
    return f"{named(path)} is {shown(problem['input'])}; valid: {valid}"


def _check_two_way(plan: FloorPlan, grid: GridMap, allow_reverse: bool, where: str) -> None:
    """Two cars can meet in a two-way part: one must be able to back out and step aside."""
    cells = plan.cells("x")
    if cells and not allow_reverse:
        raise PlanError(
            f"{where}: two-way cell 'x' at {grid.words(cells[0])} without allow_reverse = true; "
            "valid: with it, or a one-way cell (one of . > < ^ v)"
        )
    open_cells = plan.open.ravel()
    unseen = set(cells)
    while unseen:
        part, frontier = [], [min(unseen)]
        unseen.discard(frontier[0])
        while frontier:
            cell = frontier.pop()
            part.append(cell)
            for heading in range(4):
                other = grid.neighbour(cell, heading)
                if other in unseen:
                    unseen.discard(other)
                    frontier.append(other)
        ways = [sum(grid.neighbour(c, h) >= 0 and open_cells[grid.neighbour(c, h)] for h in range(4)) for c in part]
        if max(ways) < _PASSING_WAYS:
            raise PlanError(
                f"{where}: the two-way part at {grid.words(min(part))} has no passing place; valid: a "
                "cell with at least three open neighbours so that a car can step aside"
            )


def _check_given(lanes: npt.NDArray[np.int32], grid: GridMap, allow_reverse: bool, where: str) -> None:
    """Lanes that are given lead from every cell to every other; two-way ones need cars that can back out."""
    from maps.orientation import weakly_joined

    if len(lanes) == 0:
        raise LaneError(f"{where}: no lanes; valid: lanes on which every cell leads to every other")
    known = {(int(a), int(b)) for a, b in lanes}
    both = next((cell for cell, other in sorted(known) if (other, cell) in known), None)
    if both is not None and not allow_reverse:
        raise LaneError(
            f"{where}: the two-way lane at {grid.words(both)} without allow_reverse = true; valid: with it, or "
            "one-way lanes"
        )
    apart = weakly_joined(lanes)
    if len(apart):
        raise LaneError(
            f"{where}: {grid.words(int(apart[0]))} is a dead end or cut off from the largest connected part of "
            f"the lanes, with {len(apart)} cells in all; valid: lanes on which every cell leads to every other"
        )


def _check_names(names: Mapping[str, str], stations: Sequence[StationPlace], where: str) -> None:
    """Names of others are of stations that there are, each its own."""
    known = [station.name for station in stations]
    for name in names:
        if name not in known:
            raise StationError(f"{where}: names.{named(name)} is no station; valid: one of {', '.join(known)}")
    twice = next((theirs for theirs in names.values() if list(names.values()).count(theirs) > 1), None)
    if twice is not None:
        raise StationError(f"{where}: names has {shown(twice)} twice; valid: a name of its own for each station")


def _check_bays(plan: FloorPlan, grid: GridMap, lanes: npt.NDArray[np.int32], where: str) -> None:
    """Parking, charging and storage cells can be entered and left by different lanes."""
    entered, left = set(lanes[:, 1].tolist()), set(lanes[:, 0].tolist())
    for character, what in (("K", "parking"), ("C", "charger"), ("S", "storage")):
        for cell in plan.cells(character):
            if cell not in entered or cell not in left:
                raise LaneError(
                    f"{where}: {what} cell at {grid.words(cell)} is a dead end or cut off from the largest "
                    "connected part of the lanes; valid: one cell to come from and another to go on to"
                )


def _check_states(
    plan: FloorPlan,
    grid: GridMap,
    arm_sides: Mapping[int, tuple[int, ...]],
    lanes: npt.NDArray[np.int32],
    where: str,
) -> None:
    """With two-way lanes, cells may be connected while cars, which cannot turn round, are not: check their moves."""
    pairs = [(int(a), int(b)) for a, b in lanes]
    number = {lane: i for i, lane in enumerate(pairs)}
    leaving: dict[int, list[int]] = {}
    for a, b in pairs:
        leaving.setdefault(a, []).append(b)
    follow = [(number[a, b], number[b, c]) for a, b in pairs for c in leaving.get(b, ()) if c != a]
    # Backing up ends in the state that lies one cell straight behind.
    follow += [(number[a, b], number[2 * a - b, a]) for a, b in pairs if (2 * a - b, a) in number]
    row, col = np.array(follow).T
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    graph = csr_array((np.ones(len(follow), dtype=np.int8), (row, col)), shape=(len(pairs), len(pairs)))
    _, label = connected_components(graph, directed=True, connection="strong")
    main = np.bincount(label).argmax()
    reached = {b for (_, b), part in zip(pairs, label, strict=True) if part == main}
    names = name_stations(plan, arm_sides)
    for cell in [*names, *plan.cells("KCS")]:
        if cell not in reached:
            what = " and ".join(names.get(cell, ("parking, charger or storage cell",)))
            raise LaneError(
                f"{where}: {what} at {grid.words(cell)} cannot be reached and left by a car that cannot "
                "turn round; valid: one-way lanes that lead to it and on"
            )
