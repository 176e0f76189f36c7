"""What a site is like for traffic: figures, warnings and a drawing of its lanes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maps.lane_drawing import draw_lanes
from maps.lane_graph import build_lane_graph
from maps.orientation import n_separated, path_lengths, separating
from maps.site import Site

MAX_PATH_RATIO = 1.5
"""One-way lanes should not make the mean path longer than this many times the two-way one."""


@dataclass(frozen=True, kw_only=True)
class SiteReport:
    """Figures of one site."""

    name: str
    rows: int
    cols: int
    cells: int
    """Cells a car can drive on: those that lanes touch."""
    lanes: int
    states: int
    moves: int
    picks: int
    drops: int
    parking: int
    chargers: int
    mean_one_way: float
    """Mean path between two cells over the lanes [cells]."""
    mean_two_way: float
    """The same if every lane could be driven both ways [cells]."""
    path_ratio: float
    cut_cells: tuple[tuple[int, int], ...]
    """(row, col) of floor cells that no lane touches."""
    warnings: tuple[str, ...]
    """One line each; empty for a site that is good for traffic."""


def check_site(site: Site) -> SiteReport:
    """Measure a site and list what may slow its traffic; what cannot work at all was refused when it was loaded."""
    graph = build_lane_graph(site)
    lengths = path_lengths(site.lanes, site.grid)
    cut = np.array(site.cut_cells, dtype=np.int64)
    row, col = site.grid.row_col(cut)
    kinds = [station.kind for station in site.stations]
    return SiteReport(
        name=site.name,
        rows=site.grid.rows,
        cols=site.grid.cols,
        cells=len(np.unique(site.lanes)),
        lanes=len(site.lanes),
        states=graph.n_states,
        moves=graph.n_moves,
        picks=kinds.count("pick"),
        drops=kinds.count("drop"),
        parking=len(site.parking),
        chargers=len(site.chargers),
        mean_one_way=lengths.one_way,
        mean_two_way=lengths.two_way,
        path_ratio=lengths.ratio,
        cut_cells=tuple(zip(row.tolist(), col.tolist(), strict=True)),
        warnings=_warnings(site, lengths.ratio),
    )


def draw_site(site: Site) -> str:
    """Draw the plan with its lanes: every other character is a cell, an arrow between two cells is their lane.

    Floor is '.', a cut cell ','; '-' and '|' are two-way lanes; blocked cells keep their character of the plan. Before
    each row stands its number, above every fifth column that one's, and behind a row the stations whose docks it has.
    """
    chars = np.array([list(line) for line in site.plan])
    chars[np.isin(chars, list("><^vx"))] = "."
    chars.reshape(-1)[list(site.cut_cells)] = ","
    rows, cols = site.grid.rows, site.grid.cols
    margin = len(str(rows - 1)) + 2
    heading = " " * margin + "".join(f"{col:<10}" for col in range(0, cols, 5))
    lines = [heading.rstrip()]
    for number, line in enumerate(draw_lanes(chars, site.lanes, site.grid)):
        row, between = divmod(number, 2)
        named = (
            [] if between else [station for station in site.stations if site.grid.row_col(station.dock.cell)[0] == row]
        )
        names = ", ".join(station.name for station in sorted(named, key=lambda station: int(station.dock.cell)))
        mark = "" if between else str(row)
        lines.append(f"{mark:>{margin - 2}}  {line:<{2 * cols - 1}}  {names}".rstrip())
    return "\n".join(lines)


def _warnings(site: Site, ratio: float) -> tuple[str, ...]:
    found = []
    if site.cut_cells:
        found.append(f"{len(site.cut_cells)} floor cells are cut off: no lane leads to them and away again")
    if ratio > MAX_PATH_RATIO:
        found.append(f"one-way lanes make the mean path {ratio:.2f} times longer, should be at most {MAX_PATH_RATIO}")
    if not site.parking:
        found.append("no parking cell: idle cars will wait in the lanes")
    docks = [station.dock.cell for station in site.stations]
    places = np.array([*docks, *site.parking, *site.chargers, *site.storage], dtype=np.int64)
    start, end = site.lanes.astype(np.int64).T
    lane_set = set(zip(start.tolist(), end.tolist(), strict=True))
    blocked = {cell: n_separated(start, end, cell, places) for cell in separating(start, end, places.tolist())}
    for station in site.stations:
        cell = station.dock.cell
        if (cell, site.grid.neighbour(cell, station.dock.heading)) not in lane_set:
            found.append(f"{station.name}: the dock is left by a turn, so cars stop short of the cell's centre")
        if blocked.get(cell):
            found.append(f"{station.name}: a car in the dock blocks the only lane to {_others(blocked[cell])}")
    for what, cells in (("parking", site.parking), ("charger", site.chargers), ("storage", site.storage)):
        for cell in cells:
            if blocked.get(cell):
                found.append(
                    f"{what} at {site.grid.words(cell)}: a car standing there blocks the only lane to "
                    f"{_others(blocked[cell])}"
                )
    return tuple(found)


def _others(n: int) -> str:
    return f"{n} other place" if n == 1 else f"{n} other places"
