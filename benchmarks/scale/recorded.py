"""Recorded: what a recording costs a fast run, and how fast a thousand cars are with one."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from benchmarks.harness import Kind, Row, Trial, computing_s
from benchmarks.scale.medium_fleet import CARS, SITE, medium_fleet
from fleet.config import Fidelity, RunConfig
from fleet.recording import RECORDING
from fleet.recording.check import verify_recording
from fleet.scale.floors import floor_for
from fleet.session import SessionConfig, run_session
from fleet.session.runner import Result
from maps.site import save_site

MANY = 1_000
SIM_S, QUICK_SIM_S = 120.0, 10.0
"""Simulated time of a run [s]."""
PAIRS = 3
"""Runs with and without a recording, in turn; the least of each counts."""


def measure_recorded(trial: Trial) -> Iterator[Row]:
    """Share of a recorded run of 20 cars that is the recording, and the speed of one of 1,000."""
    sim_s = QUICK_SIM_S if trial.quick else SIM_S
    config = medium_fleet(trial, Fidelity.KINEMATIC, sim_s)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        _cpu_s(replace(config, duration_s=2.0), out, record=True)  # kernels are compiled, files are read
        pairs = [[_cpu_s(config, out, record=record)[0] for record in (False, True)] for _ in range(PAIRS)]
        bare_s, full_s = (min(times) for times in zip(*pairs, strict=True))
        trial.check(verify_recording(out / RECORDING).frames > 0, "the recording has no frames")
        where = f"{CARS} cars on {SITE}, kinematic"
        yield Row(name=f"{where}: recording", value=100.0 * (1.0 - bare_s / full_s), unit="% of CPU", target="<= 35")
        if trial.quick:
            trial.notes.append(f"{MANY:,} cars with a recording: not with --quick")
            return
        floor = out / "floor.toml"
        save_site(floor_for(MANY), floor)
        _, result = _cpu_s(replace(config, site=str(floor), robots=MANY, tasks=2 * MANY), out, record=True)
        name = f"{MANY:,} cars, kinematic, recorded: real-time factor"
        yield Row(name=name, value=result.real_time_factor, unit="x", kind=Kind.RATE, target=">= 10")
        size_mb = (out / RECORDING).stat().st_size / 1e6
        yield Row(name=f"{MANY:,} cars, kinematic: recording of {sim_s:g} s", value=size_mb, unit="MB")


def _cpu_s(config: RunConfig, out: Path, *, record: bool) -> tuple[float, Result]:
    """Computing time of a session with all its files, of all threads and of programs that it ran [s]."""
    begin = computing_s()
    result = run_session(config, SessionConfig(out=out, record=record, progress=False))
    return computing_s() - begin, result
