"""Export: a recorded run as an MCAP file of ROS 2 messages, to the last bit of what the run was.

A recording keeps what a viewer draws, to a quarter of a millimetre and without joint angles. A run is made again from
its settings instead, as `fleet replay` does, and each of its ticks has to have the digest that the run left.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fleet.recording import OutputError
from fleet.recording.ros2.mcap_file import McapFile
from fleet.recording.ros2.messages import INFO, WARN
from fleet.recording.run_file import plain
from fleet.recording.trace_file import read_trace
from fleet.replay.again import CutSimulation, Recorded
from fleet.run.events import Event
from fleet.session.frames import LOUD
from fleet.session.trace import Tracer


@dataclass(frozen=True, kw_only=True)
class Exported:
    """What became of a run."""

    n_messages: int
    n_samples: int
    """Moments at which everything was written."""
    sim_s: float
    """Time up to which the run is known [s]."""


def export_mcap(
    recorded: Recorded, path: Path, *, rate_hz: float, look: Callable[[int], None] | None = None
) -> Exported:
    """Make a run again and write it down.

    Args:
        recorded: The run, as `fleet.replay.again.load_recorded` reads it; it may have been killed.
        path: File to write; replaced if it exists.
        rate_hz: Samples per simulated second at most; a slower tick gives a sample each.
        look: Called with the number of ticks made so far.

    Raises:
        OutputError: The run is not the same when it is made again.
        RecordingError: The file cannot be written, or the package `mcap` is not installed.
    """
    trace = recorded.run.trace
    every = max(1, round(1.0 / (rate_hz * trace.tick_s)))
    events: list[Event] = []
    n_samples = 0
    with (
        tempfile.TemporaryDirectory() as scratch,
        CutSimulation(recorded.config, trace.n_ticks, on_event=events.append) as simulation,
        McapFile(path, simulation.view.scene) as file,
    ):
        world = simulation.world
        with Tracer(simulation.view, Path(scratch), trace.run) as tracer:
            while True:
                for event in events:
                    level = WARN if event.kind in LOUD else INFO
                    file.event(event.sim_s, level, event.kind, json.dumps(plain(event.facts), allow_nan=False))
                events.clear()
                if simulation.now % every == 0:
                    n_samples += 1
                    file.write(
                        simulation.sim_s,
                        world.car_poses(),
                        world.car_speeds(),
                        world.car_steering(),
                        world.arm_positions(),
                        world.arm_velocities(),
                    )
                if simulation.finished:
                    break
                simulation.tick()
                tracer.tick()
                if look is not None:
                    look(simulation.now)
        again = read_trace(Path(scratch)).digests
        n_known = min(len(again), trace.n_ticks)
        differ = np.flatnonzero(again[:n_known] != trace.digests[:n_known])
        if len(differ) or len(again) != trace.n_ticks:
            first = int(differ[0]) if len(differ) else n_known
            raise OutputError(
                f"made again, the run differs from tick {first} on ({first * trace.tick_s:.2f} s); valid: "
                "a run of this version of fleet on this kind of machine (fleet replay tells more)"
            )
        return Exported(n_messages=file.n_messages, n_samples=n_samples, sim_s=simulation.sim_s)
