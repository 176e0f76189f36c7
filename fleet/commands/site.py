"""The site commands: look at, make and convert sites."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from fleet.config import require
from fleet.errors import FleetError
from maps.movingai import site_from_map
from maps.report import check_site, draw_site
from maps.site import Site, load_site, save_site, site_names
from maps.warehouse import generate_warehouse


@dataclass(frozen=True, kw_only=True)
class SiteCheck:
    """Check a site and print its lanes, stations and mean path lengths."""

    site: Annotated[str, tyro.conf.Positional]
    """Name of a shipped site or path of a site file."""
    draw: bool = True
    """Print the floor plan with lane directions."""

    def run(self) -> int:
        """Print the report; a bad site raises."""
        site = load_site(self.site)
        console = Console(file=sys.stdout)
        if self.draw:
            sys.stdout.write(draw_site(site) + "\n")
        report = check_site(site)
        table = Table(title=f"site {site.name}", show_header=False)
        for name, value in vars(report).items():
            text = f"{value:.2f}" if isinstance(value, float) else str(value)
            table.add_row(name.replace("_", " "), text)
        console.print(table)
        return 0


@dataclass(frozen=True, kw_only=True)
class SiteList:
    """List the shipped sites."""

    def run(self) -> int:
        """Print one line per site."""
        for name in site_names():
            site = load_site(name)
            kinds = [station.kind for station in site.stations]
            sys.stdout.write(
                f"{name:10s} {site.grid.cols} x {site.grid.rows} m, {kinds.count('pick')} pick and "
                f"{kinds.count('drop')} drop stations, up to {len(site.parking)} cars\n"
            )
        return 0


@dataclass(frozen=True, kw_only=True)
class SiteGenerate:
    """Generate a warehouse and save it as a site file."""

    out: Annotated[Path, tyro.conf.Positional]
    """The file to write."""
    rows: int = 24
    """Height [cells of 1 m]."""
    cols: int = 40
    """Width [cells of 1 m]."""
    pick: int = 6
    """Pick stations."""
    drop: int = 6
    """Drop stations."""
    parking: int = 24
    """Parking cells."""

    def run(self) -> int:
        """Write the file."""
        for name in ("rows", "cols", "pick", "drop", "parking"):
            value = getattr(self, name)
            require(value >= 1, f"--{name}", value, "an integer >= 1")
        site = generate_warehouse(
            rows=self.rows, cols=self.cols, pick=self.pick, drop=self.drop, parking=self.parking, name=self.out.stem
        )
        return _save(site, self.out)


@dataclass(frozen=True, kw_only=True)
class SiteConvert:
    """Turn a MovingAI map into a site: adds stations and parking."""

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

    def run(self) -> int:
        """Write the file."""
        for name in ("pick", "drop", "parking"):
            value = getattr(self, name)
            require(value >= 1, f"--{name}", value, "an integer >= 1")
        return _save(site_from_map(self.map, pick=self.pick, drop=self.drop, parking=self.parking), self.out)


def _save(site: Site, out: Path) -> int:
    try:
        save_site(site, out)
    except OSError as error:
        raise FleetError(f"site file {out}: cannot be written ({error.strerror}); valid: a writable path") from error
    sys.stdout.write(f"{out}: {site.grid.cols} x {site.grid.rows} m, {len(site.stations)} stations\n")
    return 0
