"""Killed runs: a run is killed with all its processes at any moment, and what it leaves is read, mended and replayed.

Of a recording, half a second is one of wall time: a run that simulates a minute in a second may lose a minute. Its
first tick that cannot be read must not have been over for longer when the run was killed. Of the trace it is simulated
time, because ticks are written in blocks of so many. How far a run had come is known from `TickNotes`, not from its
files.
"""

from __future__ import annotations

import io
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.reliability.fuzz import Hang, at_most, traceback_line
from benchmarks.reliability.processes import children_of, kill
from benchmarks.reliability.tick_notes import TickNotes
from fleet.arrays import FloatArray
from fleet.cli.main import BAD_INPUT, main
from fleet.errors import FleetError
from fleet.recording import RECORDING, OutputError, read_run
from fleet.recording.check import verify_recording
from fleet.recording.run_file import EVENTS, RESULT
from fleet.recording.trace_file import TRACE, read_trace

CASES = (
    "--site small --robots 8 --fidelity kinematic --tasks 16",
    "--site cell --robots 3 --fidelity grid --tasks 12",
    "--site small --robots 4 --fidelity kinematic --duration 8 --speed 1",
    "--site cell --robots 3 --fidelity kinematic --tasks 12",
    "--site small --robots 6 --fidelity grid --tasks 16",
    "--site small --robots 5 --fidelity physics --duration 20",
)
"""Words of the demo; one that is as fast as the clock, as nothing hides behind the speed of the others there."""
KILLS, QUICK_KILLS = 50, 4
QUICK_CASES = 2
SEED, DRAWN_FROM = 43_000, 11
"""Of the runs, on which nothing was developed, and of the moments."""
START_UP = 0.2
"""Share of the moments that fall before the first tick, which takes longer than some of the runs."""
LOOK_S = 0.002
"""Wall time between two looks at a run [s]."""
LONGEST_S = 600.0
"""Wall time of a run, or time of computing of a command, after which it hangs [s]."""
TRACEBACK = 99
"""Stands for the exit status of a command that ends in an error nobody has named."""
DRAFTS = ".part", ".mended"
"""Ends of names of files that have not taken their place yet, and say so."""


@dataclass(kw_only=True)
class Found:
    """What the killed runs have left."""

    killed: int = 0
    before_files: int = 0
    """Of these: before there was a run file."""
    unreadable: list[str] = field(default_factory=list)
    """What could not be read, of which run, and why; so in the others."""
    lost_wall_s: list[float] = field(default_factory=list)
    """Of each recording of a run that has ticked: how long its first tick that is lost was over."""
    lost_sim_s: list[float] = field(default_factory=list)
    """Of each trace of such a run: how much it lacks."""
    replayed: int = 0
    refused: list[str] = field(default_factory=list)
    """Runs that had not come so far that there is something to replay, and what is said of them."""
    not_replayed: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class Moment:
    """When a run is killed: some time after so many of its ticks were over, however fast the machine is."""

    n_ticks: int
    then_s: float
    """Wall time since then; since the start if there was no tick [s]."""

    def __str__(self) -> str:
        return f"killed {self.then_s:.3f} s after {f'tick {self.n_ticks}' if self.n_ticks else 'its start'}"


@dataclass(frozen=True, kw_only=True)
class Killed:
    """A run that was killed."""

    out: Path
    words: str
    """How it was started and when it was killed."""
    notes: TickNotes
    killed_s: float
    """When it was killed, by `time.monotonic` [s]."""


def measure_killed_runs(trial: Trial) -> Iterator[Row]:
    """Measure what is left of runs that are killed."""
    rng = np.random.default_rng(DRAWN_FROM)
    cases = [f"{case} --seed {SEED}" for case in (CASES[:QUICK_CASES] if trial.quick else CASES)]
    found = Found()
    with tempfile.TemporaryDirectory() as folder:
        courses = [_course(Path(folder) / f"whole_{k}", case) for k, case in enumerate(cases)]
        for k, share in enumerate(rng.uniform(0.0, 1.0, QUICK_KILLS if trial.quick else KILLS).tolist()):
            case = k % len(cases)
            judge(_killed(Path(folder) / f"run_{k}", cases[case], _moment(courses[case], share)), found)
    yield from _rows(trial, found)


def _course(out: Path, words: str) -> FloatArray:
    """Wall times from the start of a run that nobody kills to the end of each tick, and to its own end at last [s]."""
    begin_s = time.monotonic()
    with _started(out, words) as process:
        process.wait(LONGEST_S)
    end_s = time.monotonic()
    return np.append(TickNotes.opened(_notes(out)).over_s, end_s) - begin_s


def _moment(course: FloatArray, share: float) -> Moment:
    """The moment at a share of a run, of which its start-up takes `START_UP`."""
    moment_s = float(np.interp(share, [0.0, START_UP, 1.0], [0.0, course[0], course[-1]]))
    n_ticks = int(np.searchsorted(course[:-1], moment_s, side="right"))
    return Moment(n_ticks=n_ticks, then_s=moment_s - (float(course[n_ticks - 1]) if n_ticks else 0.0))


def _rows(trial: Trial, found: Found) -> Iterator[Row]:
    for what, runs in (
        ("cannot be read", found.unreadable),
        ("nothing to replay", found.refused),
        ("not replayed", found.not_replayed),
    ):
        trial.notes.extend(f"killed: {what}: {run}" for run in runs)
    for name, value, target in (
        ("runs killed", found.killed, ""),
        ("of these, before there was a run file", found.before_files, ""),
        ("files that cannot be read", len(found.unreadable), "<= 0"),
        ("runs replayed to where they were killed", found.replayed, ""),
        ("runs with nothing to replay, which is said", len(found.refused), ""),
        ("replays that failed", len(found.not_replayed), "<= 0"),
    ):
        yield Row(
            name=f"killed: {name}", value=float(value), unit="files" if "files" in name else "runs", target=target
        )
    for name, lost_s in (
        ("recording, wall time lost", found.lost_wall_s),
        ("trace, simulated time lost", found.lost_sim_s),
    ):
        yield Row(
            name=f"killed: {name} at most",
            value=max(lost_s, default=math.nan),
            unit="s",
            target="<= 0.5",
            kind=Kind.PLAIN,
        )


def _killed(out: Path, words: str, moment: Moment) -> Killed:
    """Kill a run; one that is faster than it was when the moment was drawn is killed so much sooner."""
    run = kill_at(out, words, moment)
    return run or _killed(out, words, replace(moment, then_s=0.5 * moment.then_s))


def kill_at(out: Path, words: str, moment: Moment) -> Killed | None:
    """Start a run and kill it, or None if it was over before.

    Args:
        out: Its folder.
        words: Of the demo.
        moment: When it is killed.
    """
    with _started(out, words) as process:
        notes = TickNotes.opened(_notes(out))
        while notes.n_ticks < moment.n_ticks and process.poll() is None:
            time.sleep(LOOK_S)
        try:
            process.wait(moment.then_s)
        except subprocess.TimeoutExpired:
            killed_s = time.monotonic()
            _kill_all(process)
            return Killed(out=out, words=f"{words}, {moment}", notes=notes, killed_s=killed_s)
    return None


def judge(run: Killed, found: Found) -> None:
    """Read, mend and replay what a killed run has left.

    Args:
        run: The run.
        found: Where to note what came of it.
    """
    found.killed += 1
    names = sorted(path.name for path in run.out.iterdir()) if run.out.exists() else []
    for name in names:
        try:
            _read(run, name, found)
        except FleetError as error:
            found.unreadable.append(f"{run.words}: {name}: {error}")
    if EVENTS in names:
        _replay(run, found)
    else:
        found.before_files += 1


def _read(run: Killed, name: str, found: Found) -> None:
    """Read one file to its end.

    Raises:
        FleetError: It cannot be read.
    """
    notes = run.notes
    if name == RECORDING:
        _mend(run.out)
        report = verify_recording(run.out / RECORDING)
        # The first picture is of the beginning, when no tick is over yet.
        n_read = round(report.last_sim_s / notes.tick_s) if report.frames and notes.n_ticks else 0
        found.lost_wall_s.append(notes.age_s(n_read + 1, run.killed_s))
    elif name == TRACE:
        found.lost_sim_s.append((notes.n_ticks - read_trace(run.out).n_ticks) * notes.tick_s)
    elif name in (EVENTS, RESULT):
        read_run(run.out)
    elif not name.endswith(DRAFTS):
        raise FleetError(f"{name} is no file of a run")


def _replay(run: Killed, found: Found) -> None:
    """Replay a run: where there are ticks they are to be the same ones, else one line says that there are none."""
    status, said = _fleet("replay", str(run.out))
    last = (said or ["nothing was said"])[-1]
    if status == 0:
        found.replayed += 1
    elif status == BAD_INPUT and len(said) == 1 and "valid:" in last and not _has_ticks(run.out):
        found.refused.append(f"{run.words}: {last}")
    else:
        found.not_replayed.append(f"{run.words}: status {status}: {last}")


def _has_ticks(out: Path) -> bool:
    try:
        return read_trace(out).n_ticks > 0
    except OutputError:
        return False


def _mend(out: Path) -> None:
    """Mend the recording of a run as a user does.

    Raises:
        FleetError: It cannot be mended.
    """
    status, said = _fleet("mend", str(out))
    if status:
        raise FleetError((said or ["nothing was said"])[-1])


def _fleet(*words: str) -> tuple[int, list[str]]:
    """Exit status of a command and the lines it says, in this process: kernels are loaded once for all of them."""
    status, said = TRACEBACK, io.StringIO()
    try:
        with redirect_stdout(said), redirect_stderr(said), at_most(LONGEST_S):
            main(words)
    except SystemExit as end:
        status = int(str(end.code))
    except Hang:
        said.write(f"has not ended after {LONGEST_S:.0f} s of computing")
    except Exception as error:
        said.write(traceback_line(error))
    return status, said.getvalue().strip().splitlines()


def _started(out: Path, words: str) -> subprocess.Popen[bytes]:
    """A run in a group of processes of its own, which notes its ticks."""
    notes = _notes(out)
    TickNotes.made(notes)
    command = [sys.executable, "-m", "benchmarks.reliability.noted_run", str(notes), "demo", *words.split()]
    return subprocess.Popen(
        [*command, "--out", str(out)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def _kill_all(process: subprocess.Popen[bytes]) -> None:
    """Kill a run and its arm planning process, which has a group of its own."""
    workers = children_of(process.pid)
    os.killpg(process.pid, signal.SIGKILL)
    for worker in workers:
        kill(worker)


def _notes(out: Path) -> Path:
    return out.with_suffix(".notes")
