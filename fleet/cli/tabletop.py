"""The tabletop commands: arms that sort a table, or share a tray, in the physics engine."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypeVar

from rich.table import Table

from fleet.cli.run_output import plain_console
from fleet.config import Connect, require
from fleet.whole_file import write_whole

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from fleet.recording.rerun_stream.shapes import ShapeRecorder
    from fleet.robots.arms.spec import ArmSpec
    from fleet.tabletop.job import Tally
    from fleet.world.bullet.bench.table import DrawnShape, TableWorld
    from fleet.world.tabletop import TableScene

Result = TypeVar("Result")

ALL_SORTED, SOME_LEFT = 0, 1
WORDS = {
    "alone_s": "each arm alone [s]",
    "makespan_over_longer": "makespan, of the longer alone",
    "makespan_s": "makespan [s]",
    "rounds_together": "rounds of both arms at once",
    "sim_s": "simulated time [s]",
    "state_hash": "digest of the last state",
}
"""What the table calls figures whose names do not say it."""
MOST_SEED = 2**31 - 1
"""Searches count on from it, and take seeds of 32 bits."""
_FRAME_TICKS = 2
"""A recording has every second tick: 30 frames a second."""


@dataclass(frozen=True, kw_only=True)
class _Tabletop:
    """What the tables have in common."""

    seed: int = 0
    """Seed of what lies where, and of the searches."""
    gui: bool = False
    """Show PyBullet's own window."""
    out: Path = Path("runs/tabletop")
    """Directory for recording.rrd and result.json; those of an earlier run are replaced."""
    no_record: bool = False
    """Write no recording."""

    name: ClassVar[str]

    def _run(self, objects: int) -> int:
        """Sort the table; bad input raises."""
        # The engine and the kernels take a second to load: only for runs, not for --help.
        import numpy as np

        from fleet.tabletop.arm import load_model
        from fleet.tabletop.job import Job
        from fleet.tabletop.layout import LAYOUTS

        self._check()
        layout = LAYOUTS[self.name](self.seed, objects)
        model = load_model(layout.scene.arm, layout.scene.tool)
        start = np.tile(model.spec.home_rad, (len(layout.scene.arm_base), 1))

        def work(world: TableWorld, watch: Callable[[], None]) -> Tally:
            job = Job(layout, model, world, seed=self.seed, watch=watch)
            with closing(job):
                return job.run()

        began_s = time.perf_counter()
        tally, state = self._played(layout.scene, model.spec, start, work)
        figures = {
            "objects": objects,
            "sorted": tally.n_sorted,
            "rounds": tally.n_rounds,
            "rounds_together": tally.n_together,
            "missed": tally.n_missed,
            "paths_refused": tally.n_refused,
            "robot_contacts": tally.robot_contacts,
            "sim_s": round(tally.sim_s, 3),
            "state_hash": state,
        }
        remarks = [f"object {thing} is not where it belongs: {why}" for thing, why in tally.reasons.items()]
        self._tell(figures, {"reasons": tally.reasons}, remarks, time.perf_counter() - began_s)
        return ALL_SORTED if tally.done else SOME_LEFT

    def _check(self) -> None:
        require(0 <= self.seed <= MOST_SEED, "--seed", self.seed, f"an integer from 0 to {MOST_SEED}")

    def _played(
        self,
        scene: TableScene,
        spec: ArmSpec,
        start: npt.NDArray[np.float64],
        work: Callable[[TableWorld, Callable[[], None]], Result],
    ) -> tuple[Result, str]:
        """Do some work in the engine, and record it; what it gives, and a digest of the state at its end."""
        from fleet.recording.run_file import RECORDING, prepare_output
        from fleet.world.bullet.bench.table import TableWorld

        world = TableWorld(scene, spec, start, Connect.GUI if self.gui else Connect.DIRECT)
        try:
            prepare_output(self.out)
            film = None if self.no_record else _Film(self.out / RECORDING, f"tabletop {self.name}", world)
            try:
                result = work(world, film.frame if film else _nothing)
            finally:
                if film is not None:
                    film.close()
            return result, hashlib.sha256(world.state_bytes()).hexdigest()
        finally:
            world.close()

    def _tell(
        self, own: Mapping[str, object], more: Mapping[str, object], remarks: Sequence[str], wall_s: float
    ) -> None:
        """Print figures and remarks; write the figures, and more."""
        from fleet.recording.run_file import RECORDING, RESULT, versions

        figures = {"table": self.name, "seed": self.seed, **own}
        result = {**figures, **more, "settings": asdict(self), "versions": versions()}
        write_whole(self.out / RESULT, json.dumps(result, indent=2, default=str) + "\n")
        table = Table(title=f"tabletop {self.name}", show_header=False)
        for key, value in figures.items():
            table.add_row(WORDS.get(key, key.replace("_", " ")), str(value)[:16])
        table.add_row("wall time [s]", f"{wall_s:.1f}")
        console = plain_console()
        console.print(table)
        for remark in remarks:
            console.print(remark, soft_wrap=True)
        console.print(f"{self.out}: {RESULT}" + ("" if self.no_record else f", {RECORDING}"), soft_wrap=True)


@dataclass(frozen=True, kw_only=True)
class TabletopSort(_Tabletop):
    """Let a Kuka sort cubes, spheres and cylinders into places by kind."""

    name: ClassVar[str] = "sort"
    objects: int = 9
    """How many things lie on the table, at most 10."""

    def run(self) -> int:
        """Sort, print and write; returns the exit status."""
        return self._run(self.objects)


@dataclass(frozen=True, kw_only=True)
class TabletopTray(_Tabletop):
    """Let a Franka Panda empty a tray of pybullet_data's random objects into a box."""

    name: ClassVar[str] = "tray"
    objects: int = 6
    """How many objects lie in the tray, at most 8."""

    def run(self) -> int:
        """Sort, print and write; returns the exit status."""
        return self._run(self.objects)


@dataclass(frozen=True, kw_only=True)
class TabletopPair(_Tabletop):
    """Let two Kukas sort cubes and cylinders side by side, at the same time."""

    name: ClassVar[str] = "pair"
    objects: int = 10
    """How many things lie between them, at most 12."""

    def run(self) -> int:
        """Sort, print and write; returns the exit status."""
        return self._run(self.objects)


@dataclass(frozen=True, kw_only=True)
class TabletopExchange(_Tabletop):
    """Let two Kukas bring parcels to one tray that has room for one arm, as soon after each other as they can."""

    name: ClassVar[str] = "exchange"
    deliveries: int = 1
    """How many parcels each arm brings, at most 3."""

    def run(self) -> int:
        """Plan, play, print and write; returns the exit status."""
        import numpy as np

        from fleet.tabletop.exchange import SharedTray, play

        self._check()
        began_s = time.perf_counter()
        tray = SharedTray()
        places = tray.places(np.random.default_rng((0, self.seed)), self.deliveries)
        both = tray.plan(places, self.seed)
        start = np.array([trip.start for trip in tray.trips(places)])

        def work(world: TableWorld, watch: Callable[[], None]) -> int:
            play(world, both, watch)
            return world.robot_contacts

        contacts, state = self._played(tray.scene(), tray.spec, start, work)
        figures: dict[str, object] = {"deliveries_each": self.deliveries, "way": both.way.value}
        solved = both.found is not None
        if both.found is not None:
            bounds_s = tray.bounds_s(places, both, self.seed)
            figures |= {
                "makespan_s": round(both.found.makespan_s, 3),
                "alone_s": [round(own, 3) for own in bounds_s],
                "makespan_over_longer": round(both.found.makespan_s / max(bounds_s), 3),
            }
        figures |= {"robot_contacts": contacts, "state_hash": state}
        remarks = [] if solved else ["no schedule was found"]
        self._tell(figures, {}, remarks, time.perf_counter() - began_s)
        return ALL_SORTED if solved and contacts == 0 else SOME_LEFT


class _Film:
    """Keeps the poses of everything drawn."""

    def __init__(self, path: Path, title: str, world: TableWorld) -> None:
        from fleet.recording.rerun_stream.shapes import ShapeRecorder

        self._world = world
        self._shapes: list[DrawnShape] = world.drawn_shapes()
        self._recorder: ShapeRecorder = ShapeRecorder(path, title, self._shapes)

    def frame(self) -> None:
        """Note this moment, if it is one of the recording's."""
        from fleet.world.bullet.bench.table import TICK_S

        if self._world.ticks % _FRAME_TICKS == 0:
            self._recorder.record(self._world.ticks * TICK_S, self._world.drawn_poses(self._shapes))

    def close(self) -> None:
        """Write the file."""
        self._recorder.close()


def _nothing() -> None:
    pass
