"""The yard demo command: cars deliver over a floor without lanes."""

from __future__ import annotations

import functools
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from fleet.cli.run_output import figure_table, least_clearance, plain_console
from fleet.config import require
from fleet.config.settings import positive
from fleet.outputs import require_file
from fleet.terminal.progress_bar import Bar
from fleet.whole_file import write_whole

if TYPE_CHECKING:
    from fleet.session.car_watch import CarWatch
    from fleet.yard.run import YardResult

DONE, TOUCHED = 0, 1


@dataclass(frozen=True, kw_only=True)
class YardDemo:
    """Let cars deliver between spots of a yard, over a floor without lanes; prints a table."""

    yard: str = "depot"
    """A yard that ships, or a file."""
    cars: int = 20
    """Number of cars, fewer than the yard has spots."""
    duration: float = 120.0
    """Simulated time [s]."""
    fidelity: Literal["physics", "kinematic"] = "physics"
    """`physics`: cars drive on their wheels in PyBullet; `kinematic`: as bicycles, which pass through each other."""
    seed: int = 0
    """Seed of where cars stand at first and of the spots they choose."""
    json: Path | None = None
    """File for the result (JSON)."""
    record: Path | None = None
    """File for a recording (.rrd), which `fleet view` opens and `fleet shot` paints; default none."""

    def run(self) -> int:
        """Run and print; returns the exit status."""
        positive("--duration", self.duration)
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        for name, file in (("--json", self.json), ("--record", self.record)):
            require_file(name, file, Path(self.yard))
        from fleet.recording.run_file import plain
        from fleet.world import plain_world
        from fleet.world.kinematic import KinematicWorld
        from fleet.yard.run import YardRun
        from maps.yard import load_yard

        yard = load_yard(self.yard)
        make_world = functools.partial(plain_world, physics=self.fidelity == "physics")
        run = YardRun(yard, self.cars, make_world, seed=self.seed, clock=time.process_time)
        n_ticks = max(1, round(self.duration / run.world.tick_s))
        watch: CarWatch | None = None
        try:
            if self.record is not None:
                # It loads what writes recordings, and that takes a second.
                from fleet.session.car_watch import CarWatch
                from fleet.session.drawn_floors import yard_floor

                watch = CarWatch(run, yard_floor(yard), self.record)
            YardRun(yard, 1, KinematicWorld).tick_until_planned()  # loads the kernels
            with Bar(n_ticks, "ticks", shown=True) as bar:
                for tick in range(n_ticks):
                    run.tick()
                    if watch is not None:
                        watch.look()
                    if bar.due():
                        done = f"{run.deliveries} deliveries"
                        bar.show(tick + 1, done, f"{run.time_s:.0f} of {self.duration:g} s, {done}")
            result = run.result()
        finally:
            run.world.close()
            if watch is not None:
                watch.close()
        console = plain_console()
        console.print(figure_table(_figures(result)))
        if self.json is not None:
            write_whole(self.json, json.dumps(plain(result), indent=2) + "\n")
        return TOUCHED if result.contacts else DONE


def _figures(result: YardResult) -> dict[str, str]:
    """The figures of a run."""
    rows = {
        "simulated": f"{result.duration_s:g} s",
        "deliveries": f"{result.deliveries}",
        "contacts": f"{result.contacts}",
        "least clearance": least_clearance(result.min_clearance_m),
        "longest that a car stood": f"{result.longest_still_s:.1f} s",
        "furthest beside its way": f"{result.most_beside_m:.3f} m",
        "plans": f"{result.plans}, {result.refused} without a way",
    }
    if result.plan_s:
        ordered = sorted(result.plan_s)
        rows["computing time of a plan"] = f"{ordered[len(ordered) // 2]:.3f} s, at most {ordered[-1]:.3f} s"
    return rows
