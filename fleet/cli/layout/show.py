"""The layout show command: the lanes of a layout as it is, in figures and in a picture."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fleet.cli.layout.lanes_file import lane_figures, read_lanes
from fleet.cli.run_output import figure_table, plain_console
from fleet.cli.site import FORMATS
from fleet.config import require
from fleet.whole_file import write_whole


@dataclass(frozen=True, kw_only=True)
class LayoutShow:
    """Show the lanes that cars have on a layout of another fleet manager, as it is; prints a table."""

    file: Annotated[Path, tyro.conf.Positional]
    """A layout: LIF, an openTCS plant model, a navigation graph or building map of Open-RMF, a Nav2 route graph."""
    format: FORMATS | None = None
    """What the file is; default: what its name says."""
    level: str | None = None
    """Of several levels the one to drive on."""
    picture: Path | None = None
    """A file for a picture of the lanes (.svg); default none."""

    def run(self) -> int:
        """Print and write; returns the exit status."""
        if self.picture is not None:
            fits = self.picture.suffix == ".svg" and self.picture.parent.is_dir()
            require(fits, "--picture", str(self.picture), "a file that ends in .svg, in a folder there is")
        lanes = read_lanes(self.file, self.format, self.level)
        plain_console().print(figure_table(lane_figures(lanes)))
        sys.stdout.writelines(f"note: {note}\n" for note in lanes.notes)
        if self.picture is not None:
            from fleet.free_lanes.picture import lane_picture

            write_whole(self.picture, lane_picture(lanes).svg())
            sys.stdout.write(f"{self.picture}: the lanes\n")
        return 0
