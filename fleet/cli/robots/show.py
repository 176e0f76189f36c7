"""The command that shows one robot."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table

from fleet.cli.arguments import require_with
from fleet.cli.run_output import PLAIN_WIDTH, plain_console
from fleet.config import require
from fleet.outputs import require_folder
from fleet.whole_file import write_whole

DONE, FAILED = 0, 1
MOST_PUSH_MPS = 3.0


@dataclass(frozen=True, kw_only=True)
class RobotShow:
    """Show a robot: its figures with their sources, a picture, and the loop that it drives alone, in physics.

    Vehicles drive a course of straights, curves and, where they can, turns on the spot to a dock, in physics and in
    their kinematic model. Arms swing all their joints. The others stand, and are pushed. The exit status is 1 if a
    vehicle does not arrive or a robot falls.
    """

    name: Annotated[str, tyro.conf.Positional]
    """Name of a robot, as `robots list` prints it."""
    load: float = 0.0
    """Mass of a parcel in a vehicle's tray [kg]."""
    lanes: bool = False
    """A vehicle that turns on the spot drives fifty metres of lanes with four corners instead of its course."""
    push: float = 0.0
    """By how much a push changes a vehicle's speed on its way [m/s]; the seed says in which direction."""
    seed: int = 0
    """Of the errors of a vehicle's sensors; the same seed gives the same figures."""
    out: Path = Path("runs/robots")
    """Directory for the picture, which is called as the robot."""

    def run(self) -> int:
        """Drive, paint and print."""
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        from fleet.proving.sheets import robot_sheet

        sheet = robot_sheet(self.name)
        most = sheet.payload_kg if sheet.kind == "vehicle" and sheet.payload_kg else 0.0
        require(0.0 <= self.load <= most, "--load", self.load, f"a number from 0 to {most:g} with {sheet.name}")
        require(0.0 <= self.push <= MOST_PUSH_MPS, "--push", self.push, f"a number from 0 to {MOST_PUSH_MPS:g}")
        drives, needs = sheet.kind == "vehicle", f"with a vehicle, and {sheet.name} is of kind {sheet.kind}"
        for option, given in (("--lanes", self.lanes), ("--push", self.push > 0.0), ("--seed", self.seed > 0)):
            require_with(option, given, drives, needs)
        require_folder("--out", self.out)
        console = plain_console(columns=PLAIN_WIDTH)
        about = Table(title=f"{sheet.name}: {sheet.kind}, {sheet.drive}")
        for heading in ("figure", "value", "source"):
            about.add_column(heading, no_wrap=heading != "source", overflow="fold")
        for figure in sheet.figures:
            about.add_row(figure.name, figure.value, figure.source)
        from PIL import Image

        from fleet.proving.show import ShowConfig, show

        config = ShowConfig(seed=self.seed, load_kg=self.load, lanes=self.lanes, push_mps=self.push)
        with console.status("driving in physics"):
            shown = show(sheet, config)
        console.print(about)
        done = Table(title="alone on a bare floor", show_header=False)
        for what, value in shown.figures:
            done.add_row(what, value)
        console.print(done)
        self.out.mkdir(parents=True, exist_ok=True)
        path = self.out / f"{sheet.name}.png"
        picture = BytesIO()
        Image.fromarray(shown.picture).save(picture, "png")
        write_whole(path, picture.getvalue())
        console.print(f"picture: {path}", soft_wrap=True)
        return DONE if shown.ok else FAILED
