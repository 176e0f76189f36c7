"""One hash: a run in many processes on a machine with too few cores, some of whose planning processes are killed."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.harness import Row, Trial
from benchmarks.reliability.processes import children_of, kill
from fleet.recording import OutputError
from fleet.recording.run_file import RESULT
from fleet.recording.trace_file import TRACE, read_trace

ROBOTS = 8
TASKS = 64
"""More than can be done in the time."""
RUN_SEED = 41_000
"""Nothing was developed on it."""
KILL_SEED = 7
BEYOND_CORES = 2
"""More processes at a time than there are cores."""
KILLED_WITHIN = 0.05, 0.8
"""Shares of the simulated time between which workers are killed: later there may be nothing left to plan."""
LOOK_S = 0.05
"""Wall time between two looks at a run [s]."""
LONGEST_S = 3_600.0
"""Wall time after which a run hangs [s]."""
STARTED_AGAIN = "arm planning process ended with status -9; start "
"""What a run warns of when it has found its worker killed."""


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much is done."""

    runs: int
    sim_s: float
    moments: tuple[int, ...]
    """In the first runs: how many times the worker is killed in each."""


FULL = Effort(runs=20, sim_s=120.0, moments=(1, 1, 2, 2, 3))
QUICK = Effort(runs=2, sim_s=20.0, moments=(1,))


@dataclass(frozen=True, kw_only=True)
class Played:
    """What a process left."""

    state_hash: str
    """Of the last state; empty if the run did not come to its end."""
    trace_hash: str
    """Of every tick: of all motion, and of what was decided."""
    killed: int
    """Times at which its worker was there and was killed."""
    started_again: int
    why: str
    """Its last words, if it failed."""


def measure_one_hash(trial: Trial) -> Iterator[Row]:
    """Measure whether processes that have nothing in common but the seed make the same run."""
    effort = QUICK if trial.quick else FULL
    rng = np.random.default_rng(KILL_SEED)
    low, high = KILLED_WITHIN
    afflicted = [np.sort(rng.uniform(low * effort.sim_s, high * effort.sim_s, n)).tolist() for n in effort.moments]
    moments = [*afflicted, *([] for _ in range(effort.runs - len(afflicted)))]
    # Those that are afflicted are spread over the whole time, beside others that are not.
    order = rng.permutation(effort.runs)
    at_a_time = min(effort.runs, len(os.sched_getaffinity(0)) + BEYOND_CORES)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(at_a_time) as pool:
        played = list(pool.map(lambda k: play(Path(folder) / f"run_{k}", effort.sim_s, moments[k]), order.tolist()))
    for run in played:
        trial.check(bool(run.state_hash), f"hash: a run did not come to its end: {run.why}")
    what = f"hash, physics, {effort.runs} processes, {at_a_time} at a time"
    for name, hashes in (
        ("last states", {run.state_hash for run in played}),
        ("runs, tick by tick", {run.trace_hash for run in played}),
    ):
        yield Row(name=f"{what}: different {name}", value=float(len(hashes)), unit="hashes", target="<= 1")
    killed = sum(run.killed for run in played)
    yield Row(
        name=f"{what}: planning processes killed",
        value=float(killed),
        unit="processes",
        target=f">= {sum(effort.moments)}",
    )
    yield Row(
        name=f"{what}: killed ones that were not started again",
        value=float(killed - sum(run.started_again for run in played)),
        unit="processes",
        target="<= 0",
    )


def play(out: Path, sim_s: float, moments_s: Sequence[float]) -> Played:
    """Play the run in a process of its own.

    Args:
        out: Folder for its files.
        sim_s: Simulated time [s].
        moments_s: When its planning process is killed, in simulated time, ascending [s].
    """
    words = f"--site small --robots {ROBOTS} --tasks {TASKS} --seed {RUN_SEED} --duration {sim_s} --no-record"
    command = [sys.executable, "-m", "fleet", "demo", *words.split(), "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        late = threading.Timer(LONGEST_S, process.kill)
        late.start()
        try:
            killed = sum(_killed_at(process, out, moment_s) for moment_s in moments_s)
            _, said = process.communicate()
        finally:
            late.cancel()
    why = (said.strip().splitlines() or [""])[-1]
    if process.returncode:
        return Played(state_hash="", trace_hash="", killed=killed, started_again=0, why=f"{process.returncode}: {why}")
    return Played(
        state_hash=json.loads((out / RESULT).read_text(encoding="utf-8"))["state_hash"],
        trace_hash=hashlib.sha256((out / TRACE).read_bytes()).hexdigest(),
        killed=killed,
        started_again=said.count(STARTED_AGAIN),
        why=why,
    )


def _killed_at(process: subprocess.Popen[str], out: Path, moment_s: float) -> bool:
    """Wait until a run is so far and has a worker, and kill it; False if the run has ended before."""
    while process.poll() is None:
        if _reached_s(out) >= moment_s and any([kill(child) for child in children_of(process.pid)]):
            return True
        time.sleep(LOOK_S)
    return False


def _reached_s(out: Path) -> float:
    """How far a run is, as far as it has written [s]."""
    try:
        trace = read_trace(out)
    except OutputError:
        return 0.0
    return trace.n_ticks * trace.tick_s
