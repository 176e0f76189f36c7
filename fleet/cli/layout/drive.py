"""The layout drive command: cars drive on a layout as it is."""

from __future__ import annotations

import functools
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from fleet.cli.layout.lanes_file import lane_figures, read_lanes
from fleet.cli.run_output import figure_table, least_clearance, plain_console
from fleet.cli.site import FORMATS
from fleet.config import require
from fleet.config.settings import positive
from fleet.outputs import require_file
from fleet.terminal.progress_bar import Bar
from fleet.whole_file import write_whole

if TYPE_CHECKING:
    from fleet.free_lanes.run import LayoutResult
    from fleet.session.car_watch import CarWatch

DONE, NOT_DONE = 0, 1


@dataclass(frozen=True, kw_only=True)
class LayoutDrive:
    """Let cars drive on a layout of another fleet manager, as it is; prints a table.

    They go from stations to pick at to stations to drop at, and from node to node where there are none of both.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """A layout: LIF, an openTCS plant model, a navigation graph or building map of Open-RMF, a Nav2 route graph."""
    format: FORMATS | None = None
    """What the file is; default: what its name says."""
    level: str | None = None
    """Of several levels the one to drive on."""
    cars: int = 4
    """Number of cars."""
    trips: int = 40
    """Trips to a node after which the run ends; a delivery is two."""
    duration: float = 3600.0
    """Simulated time after which it ends at the latest [s]."""
    fidelity: Literal["physics", "kinematic"] = "kinematic"
    """`physics`: cars drive on their wheels in PyBullet; `kinematic`: as bicycles, which pass through each other."""
    seed: int = 0
    """Seed of where cars start and of the nodes they choose."""
    json: Path | None = None
    """File for the result (JSON)."""
    record: Path | None = None
    """File for a recording (.rrd), which `fleet view` opens and `fleet shot` paints; default none."""

    def run(self) -> int:
        """Run and print; returns the exit status."""
        positive("--duration", self.duration)
        require(self.trips >= 1, "--trips", self.trips, "an integer >= 1")
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        for name, file in (("--json", self.json), ("--record", self.record)):
            require_file(name, file, self.file)
        lanes = read_lanes(self.file, self.format, self.level)
        from fleet.free_lanes.run import LayoutRun
        from fleet.recording.run_file import plain
        from fleet.world import plain_world

        make_world = functools.partial(plain_world, physics=self.fidelity == "physics")
        run = LayoutRun(lanes, self.cars, make_world, seed=self.seed)
        watch: CarWatch | None = None
        try:
            if self.record is not None:
                # It loads what writes recordings, and that takes a second.
                from fleet.session.car_watch import CarWatch
                from fleet.session.drawn_floors import lane_floor

                watch = CarWatch(run, lane_floor(lanes), self.record)
            with Bar(self.trips, "trips", shown=True) as bar:
                while run.trips < self.trips and run.time_s < self.duration:
                    run.tick()
                    if watch is not None:
                        watch.look()
                    if bar.due():
                        bar.show(run.trips, f"{run.time_s:.0f} s", f"{run.time_s:.0f} s, {run.trips} trips")
            result = run.result()
        finally:
            run.world.close()
            if watch is not None:
                watch.close()
        plain_console().print(figure_table(lane_figures(lanes) | _figures(result)))
        sys.stdout.writelines(f"note: {note}\n" for note in lanes.notes)
        if self.json is not None:
            write_whole(self.json, json.dumps(plain(result), indent=2) + "\n")
        return DONE if result.trips >= self.trips and not result.contacts else NOT_DONE


def _figures(result: LayoutResult) -> dict[str, str]:
    """The figures of a run."""
    return {
        "simulated": f"{result.duration_s:.0f} s",
        "trips": f"{result.trips}, {result.deliveries} of them deliveries",
        "contacts": f"{result.contacts}",
        "least clearance": least_clearance(result.min_clearance_m),
        "longest that a car on its way stood": f"{result.longest_still_s:.1f} s",
        "plans": f"{result.plans}, {result.plans_cut} cut short",
    }
