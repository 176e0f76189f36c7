"""Recording: its share of a run's computing time, the size of its file, and what a killed run loses.

Shares are of computing time, counted in one run: what its thread spends in ticks, and what this process spends outside
of them, in looks, in the threads that write, and in compacting the file, less the same of a run that is not recorded.
Between two runs the ticks alone differ by some percent. The loss is wall time, and on a machine that is busy with
other things it is theirs too.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.harness import Kind, Row, Trial, computing_s
from fleet.config import Fidelity, RunConfig
from fleet.recording import RECORDING, NullRecorder, Recorder
from fleet.recording.check import verify_recording
from fleet.session.frames import Watch, open_recorder
from fleet.simulation import Simulation
from maps.site import save_site
from maps.warehouse import generate_warehouse

_SIM_S, _QUICK_S = 60.0, 10.0
"""Simulated time of a run [s]."""
_WARM_S = 2.0
"""The same of a run that is not measured [s]."""
_PAIRS = {Fidelity.PHYSICS: 2, Fidelity.KINEMATIC: 3}
"""Runs with and without recording, in turn; the least of each counts."""
_KILLED_AFTER_S = (2.0, 6.0)
"""Wall time until a run is killed, from its first tick [s]."""


@dataclass(frozen=True, kw_only=True)
class _Run:
    ticks_s: float
    """Computing time of the run's thread in ticks [s]."""
    rest_s: float
    """The same of this process outside of them, all threads, until the file is finished, and of compacting it [s]."""
    open_s: float
    """Computing time of opening the recording, which writes meshes and layout [s]."""
    size_mb: float
    n_frames: int


def measure_recording(trial: Trial) -> Iterable[Row]:
    """Run fleets with and without recording, one after the other, and compare; kill others."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        hall = out / "hall.toml"
        save_site(generate_warehouse(rows=44, cols=70, pick=10, drop=10, parking=110), hall)
        sim_s = _QUICK_S if trial.quick else _SIM_S
        for fidelity in (Fidelity.PHYSICS, Fidelity.KINEMATIC):
            for site, robots, target in (("medium", 20, "<= 3"), (str(hall), 100, "<= 5")):
                config = RunConfig(
                    site=site, robots=robots, tasks=3 * robots, fidelity=fidelity, duration_s=sim_s, seed=trial.seeds[0]
                )
                # Kernels are compiled, files are read.
                _run(replace(config, duration_s=_WARM_S), out / RECORDING)
                runs = [(_run(config, None), _run(config, out / RECORDING)) for _ in range(_PAIRS[fidelity])]
                bare, full = zip(*runs, strict=True)
                idle = min(run.rest_s / run.ticks_s for run in bare)
                share = min(run.rest_s / run.ticks_s for run in full) - idle
                ticks_s = min(run.ticks_s for run in (*bare, *full))
                where = f"{robots} cars, {fidelity}"
                trial.check(full[0].n_frames > 0, f"{where}: the recording has no frames")
                yield Row(name=f"recording, {where}", value=100 * share, unit="% of CPU", target=target)
                yield Row(
                    name=f"recording, {where}, a frame",
                    value=1000 * share * ticks_s / full[0].n_frames,
                    unit="ms",
                    kind=Kind.TIME,
                )
                yield Row(
                    name=f"recording, {where}, opened",
                    value=1000 * min(run.open_s for run in full),
                    unit="ms",
                    kind=Kind.TIME,
                )
                size = "<= 10" if robots == 100 else ""
                yield Row(name=f"file, {where}, {sim_s:g} s", value=full[0].size_mb, unit="MB", target=size)
        yield Row(name="not recording, 20 cars", value=_idle_share(), unit="% of CPU", target="<= 0.5")
        for fidelity in (Fidelity.PHYSICS, Fidelity.KINEMATIC):
            kills = range(2 if trial.quick else 8)
            losses_s = [_lost(fidelity, out / f"killed_{k}", random.Random(k), trial) for k in kills]
            yield Row(
                name=f"lost by kill -9, {fidelity}, most",
                value=max(losses_s),
                unit="s",
                kind=Kind.PLAIN,
                target="<= 0.5",
            )


def _run(config: RunConfig, path: Path | None) -> _Run:
    # Loading rerun is no part of the run.
    import fleet.recording.rerun_stream.stream  # noqa: F401

    with Simulation(config) as simulation:
        begin_s = computing_s()
        recorder: Recorder = NullRecorder() if path is None else open_recorder(simulation.view, path)
        open_s = computing_s() - begin_s
        watch = Watch(simulation.view, simulation.figures, recorder)
        begin_s = computing_s()
        ticks_s = 0.0
        while not simulation.finished:
            tick_s = time.thread_time()
            simulation.tick()
            ticks_s += time.thread_time() - tick_s
            watch.look()
        recorder.close()
        rest_s = computing_s() - begin_s - ticks_s
    if path is None:
        return _Run(ticks_s=ticks_s, rest_s=rest_s, open_s=open_s, size_mb=0.0, n_frames=0)
    n_frames = verify_recording(path).frames
    size_mb = path.stat().st_size / 1e6
    return _Run(ticks_s=ticks_s, rest_s=rest_s, open_s=open_s, size_mb=size_mb, n_frames=n_frames)


def _idle_share() -> float:
    """Time of the looks of a run that is not recorded, over the time of its ticks [%]."""
    config = RunConfig(site="medium", robots=20, fidelity=Fidelity.KINEMATIC, duration_s=_QUICK_S)
    with Simulation(config) as simulation:
        watch = Watch(simulation.view, simulation.figures, NullRecorder())
        begin_s = time.process_time()
        while not simulation.finished:
            simulation.tick()
        ticks_s = time.process_time() - begin_s
        begin_s = time.process_time()
        for _ in range(simulation.now):
            watch.look()
        return 100 * (time.process_time() - begin_s) / ticks_s


_KILLED = """
import os, sys, time
from pathlib import Path
from fleet.config import Fidelity, RunConfig
from fleet.simulation import Simulation
from fleet.session.frames import Watch, open_recorder
config = RunConfig(site="medium", robots=20, fidelity=Fidelity(sys.argv[2]), duration_s=600.0)
with Simulation(config) as simulation:
    watch = Watch(simulation.view, simulation.figures, open_recorder(simulation.view, Path(sys.argv[1])))
    for _ in range(20):  # kernels are compiled
        simulation.tick()
    begin_s = time.perf_counter() - simulation.sim_s
    while not simulation.finished:
        simulation.tick()
        watch.look()
        os.write(1, f"{simulation.sim_s:.6f} {time.perf_counter()}\\n".encode())
        time.sleep(max(0.0, begin_s + simulation.sim_s - time.perf_counter()))
"""


def _lost(fidelity: Fidelity, path: Path, rng: random.Random, trial: Trial) -> float:
    """Kill a run that goes no faster than the clock, at any time, and see how much of what it recorded is in the file.

    Returns:
        Wall time from the last frame in the file to the last one that was made [s].
    """
    command = [sys.executable, "-c", _KILLED, str(path), str(fidelity)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        if process.stdout is None:
            raise RuntimeError("the run has no output")
        process.stdout.readline()
        time.sleep(rng.uniform(*_KILLED_AFTER_S))
        process.send_signal(signal.SIGKILL)
        ticks = np.array([line.split() for line in process.stdout if line.endswith("\n")], dtype=np.float64)
    report = verify_recording(path)
    trial.check(report.frames > 0, "the file of a killed run has no frames")
    sim_s, wall_s = ticks.T
    return float(wall_s[-1] - np.interp(report.last_sim_s, sim_s, wall_s))
