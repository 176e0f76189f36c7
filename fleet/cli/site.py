"""The site commands: look at, make and convert sites."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from fleet.config import ArmConfig, Grip, require
from fleet.errors import FleetError
from fleet.outputs import require_file
from fleet.whole_file import write_whole

if TYPE_CHECKING:
    from maps.site import Site

FORMATS = Literal["lif", "opentcs", "rmf", "building", "nav2"]
"""Names in `maps.layouts.formats.LAYOUT_FORMATS`."""
MOST = 1000
"""Greatest side of a generated floor [cells], and number of places that a converted map is given."""


@dataclass(frozen=True, kw_only=True)
class SiteCheck:
    """Check a site and print its lanes, mean path lengths and whether its arms can serve their stations."""

    site: Annotated[str, tyro.conf.Positional]
    """Name of a shipped site or path of a site file."""
    no_draw: bool = False
    """Leave out the floor plan with its lane directions."""
    graphml: Path | None = None
    """A file to write the lane graph to, for graph tools: states and moves with their poses, lengths and paths."""
    grip: Grip | None = None
    """The only tool whose reach counts; default: both."""
    arms: str = ArmConfig.model
    """Arm of every station whose site names none: iiwa, panda, xarm, or package.module.NAME."""

    def run(self) -> int:
        """Print the report; a bad site raises, also one whose arms cannot serve their stations."""
        from rich.table import Table

        from fleet.cli.run_output import plain_console
        from maps.report import check_site, draw_site
        from maps.site import load_site

        require_file("--graphml", self.graphml, Path(self.site))
        site = load_site(self.site)
        report, refused = check_site(site), _unreached(site, self.grip, ArmConfig(model=self.arms))
        console = plain_console()
        if not self.no_draw:
            sys.stdout.write(draw_site(site) + "\n")
        table = Table(title=f"site {site.name}", show_header=False)
        for name, value in vars(report).items():
            table.add_row(name.replace("_", " "), _text(value))
        for grip, refusals in refused.items():
            table.add_row(f"arms, grip {grip}", "\n".join(refusals) or f"serve all {len(site.stations)} stations")
        console.print(table)
        if self.graphml is not None:
            from maps.graphml import write_graphml
            from maps.lane_graph import build_lane_graph

            graph = build_lane_graph(site)
            write_graphml(graph, self.graphml)
            sys.stdout.write(f"{self.graphml}: {graph.n_states} states, {graph.n_moves} moves\n")
        _require_reach(refused)
        return 0


@dataclass(frozen=True, kw_only=True)
class SiteList:
    """List the shipped sites."""

    def run(self) -> int:
        """Print one line per site."""
        from maps.site import outline, site_names

        names = site_names()
        width = max(map(len, names))
        for name in names:
            site = outline(name)
            metres = _metres(site.rows, site.cols, site.cell_m)
            stations = f"{site.n_pick} pick and {site.n_drop} drop station{'s' if site.n_drop > 1 else ''}"
            sys.stdout.write(f"{name:{width}} {metres}, {stations}, parking for {site.n_parking} cars\n")
        return 0


@dataclass(frozen=True, kw_only=True)
class SiteGenerate:
    """Generate a warehouse and save it as a site file."""

    out: Annotated[Path, tyro.conf.Positional]
    """The file to write."""
    rows: int = 24
    """Height [cells]."""
    cols: int = 40
    """Width [cells]."""
    pick: int = 6
    """Pick stations."""
    drop: int = 6
    """Drop stations."""
    parking: int = 24
    """Parking cells."""
    chargers: int = 0
    """Charging cells; none if cars have no batteries."""
    sides: Literal["we", "nesw", "none"] = "we"
    """Walls along which stations stand: west (picks) and east (drops), also north (picks) and south (drops), or
    none."""
    islands: bool = False
    """Stations for which the walls have no room stand inside the floor, between the racks."""
    lanes: int = 1
    """Lanes side by side between two blocks of racks."""
    cell: float = 1.0
    """Edge of a cell, and width of a lane, 1 to 1.25 [m]; wide vehicles need 1.25."""

    def run(self) -> int:
        """Write the file."""
        from maps.site import MAX_CELL_M
        from maps.warehouse import generate_warehouse

        for name in ("rows", "cols"):
            value = getattr(self, name)
            require(1 <= value <= MOST, f"--{name}", value, f"an integer from 1 to {MOST}")
        for name, least in (("pick", 1), ("drop", 1), ("parking", 1), ("chargers", 0), ("lanes", 1)):
            value = getattr(self, name)
            require(value >= least, f"--{name}", value, f"an integer of at least {least}")
        require(1.0 <= self.cell <= MAX_CELL_M, "--cell", self.cell, f"a number from 1 to {MAX_CELL_M}")
        require(self.islands or self.sides != "none", "--sides", self.sides, "we or nesw, or none with --islands")
        site = generate_warehouse(
            rows=self.rows,
            cols=self.cols,
            pick=self.pick,
            drop=self.drop,
            parking=self.parking,
            chargers=self.chargers,
            sides=self.sides,
            islands=self.islands,
            lanes=self.lanes,
            cell_m=self.cell,
            name=self.out.stem,
        )
        return _save(site, self.out)


@dataclass(frozen=True, kw_only=True)
class SiteConvert:
    """Turn a MovingAI map into a site: adds stations, parking and chargers."""

    map: Annotated[Path, tyro.conf.Positional]
    """The .map file."""
    out: Annotated[Path, tyro.conf.Positional]
    """The site file to write."""
    pick: int = 4
    """Pick stations."""
    drop: int = 4
    """Drop stations."""
    parking: int = 20
    """Parking cells."""
    chargers: int = 0
    """Charging cells; none if cars have no batteries."""
    grip: Grip | None = None
    """The only tool whose reach counts; default: both."""

    def run(self) -> int:
        """Write the file; a site whose arms cannot serve their stations raises."""
        from maps.formats.movingai import site_from_map

        for name, least in (("pick", 1), ("drop", 1), ("parking", 1), ("chargers", 0)):
            value = getattr(self, name)
            require(least <= value <= MOST, f"--{name}", value, f"an integer from {least} to {MOST}")
        require_file("OUT", self.out, self.map)
        site = site_from_map(self.map, pick=self.pick, drop=self.drop, parking=self.parking, chargers=self.chargers)
        _require_reach(_unreached(site, self.grip))
        return _save(site, self.out)


@dataclass(frozen=True, kw_only=True)
class SiteExport:
    """Write a site as a layout of another fleet manager: LIF, openTCS, Open-RMF or Nav2."""

    site: Annotated[str, tyro.conf.Positional]
    """Name of a shipped site or path of a site file."""
    file: Annotated[Path, tyro.conf.Positional]
    """The file to write."""
    format: FORMATS | None = None
    """What to write; default: what the name of the file says."""

    def run(self) -> int:
        """Write the file."""
        from maps.layouts.formats import LAYOUT_FORMATS, format_of
        from maps.site import load_site

        require_file("FILE", self.file, Path(self.site))
        name = self.format or format_of(self.file.name)
        layout_format = LAYOUT_FORMATS[name]
        text = layout_format.write(load_site(self.site))
        write_whole(self.file, text)
        sys.stdout.write(f"{self.file}: {layout_format.title}, {len(text.encode()):,} bytes\n")
        return 0


@dataclass(frozen=True, kw_only=True)
class SiteImport:
    """Turn a layout of another fleet manager whose nodes lie on a grid into a site."""

    file: Annotated[Path, tyro.conf.Positional]
    """A layout: LIF, an openTCS plant model, a navigation graph or building map of Open-RMF, a Nav2 route graph."""
    out: Path
    """The site file to write."""
    format: FORMATS | None = None
    """What the file is; default: what its name says."""
    level: str | None = None
    """Of several levels the one that becomes the site."""
    redraw: bool = False
    """Draw the ways anew, cell by cell, if nodes lie on no grid: what leads where stays, lengths do not."""
    grip: Grip | None = None
    """The only tool whose reach counts; default: both."""

    def run(self) -> int:
        """Write the file; a site whose arms cannot serve their stations raises."""
        from maps.layouts.formats import LAYOUT_FORMATS, format_of
        from maps.layouts.layout import one_level
        from maps.layouts.redraw import redrawn
        from maps.layouts.to_site import site_of_layout
        from maps.reading.text_file import read_text

        require_file("--out", self.out, self.file)
        layout_format = LAYOUT_FORMATS[self.format or format_of(self.file.name)]
        text = read_text(self.file, str(self.file), valid=layout_format.title)
        layout = one_level(layout_format.read(text, str(self.file)), self.level, str(self.file))
        notes: list[str] = []
        if self.redraw:
            drawn = redrawn(layout, str(self.file))
            layout = drawn.layout
            notes += drawn.notes()
        made = site_of_layout(layout, name=self.out.stem, where=str(self.file))
        _require_reach(_unreached(made.site, self.grip))
        status = _save(made.site, self.out)
        sys.stdout.write(f"path ratio {made.path_ratio:.2f}\n")
        sys.stdout.writelines(f"{own}: {foreign}\n" for own, foreign in made.names.items() if own != foreign)
        sys.stdout.writelines(f"note: {note}\n" for note in (*notes, *made.notes))
        return status


def _text(value: object) -> str:
    """A figure of the report; lists one below the other."""
    if isinstance(value, tuple):
        items = [item if isinstance(item, str) else f"row {item[0]}, column {item[1]}" for item in value]
        return "\n".join(items) or "none"
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _unreached(site: Site, grip: Grip | None, arms: ArmConfig | None = None) -> dict[Grip, tuple[str, ...]]:
    """For one tool or for each: what its arms cannot serve."""
    from fleet.stations.reach import reach_refusals
    from fleet.terminal.progress_bar import Bar

    grips = tuple(Grip) if grip is None else (grip,)
    total = len(grips) * len(site.stations)
    looked = 0
    with Bar(total, "stations", shown=sys.stdout.isatty()) as bar:

        def told(station: str) -> None:
            nonlocal looked
            if looked and bar.due():
                bar.show(looked, f"arm of {station}", f"arms looked at: {looked} of {total}")
            looked += 1

        return reach_refusals(site, grips, told, arms)


def _require_reach(refused: dict[Grip, tuple[str, ...]]) -> None:
    """Refuse what a run would refuse, in its words."""
    for refusals in refused.values():
        if refusals:
            raise FleetError(refusals[0])


def _metres(rows: int, cols: int, cell_m: float) -> str:
    """Width and depth of a floor in words."""
    return f"{cols * cell_m:g} x {rows * cell_m:g} m"


def _save(site: Site, out: Path) -> int:
    from maps.site import save_site

    save_site(site, out)
    grid = site.grid
    metres = _metres(grid.rows, grid.cols, grid.cell_m)
    sys.stdout.write(f"{out}: {metres}, {len(site.stations)} stations\n")
    return 0
