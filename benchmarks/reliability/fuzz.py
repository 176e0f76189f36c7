"""Fuzz: mutated files are read as commands read them; each is taken, or refused by name with what would be valid."""

from __future__ import annotations

import math
import re
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from benchmarks.harness import Kind, Row, Trial
from benchmarks.reliability.file_kinds import FILE_KINDS, contents
from benchmarks.reliability.mutation import Draw, mutated
from fleet.errors import FleetError
from maps.errors import MapsError
from planners.errors import PlanningError

FILES, QUICK_FILES = 10_000, 1_500
"""Files that are read in this process, of all kinds together."""
COMMANDS, QUICK_COMMANDS = 6, 1
"""Files of each kind in `WORDS` that are handed to a command."""
_DEMO = ("demo", "--site=small", "--fidelity=grid", "--duration=2", "--no-record", "--out={folder}/out")
WORDS = {
    "site": ("site", "check", "{folder}/site.toml", "--no-draw"),
    "map": ("site", "convert", "{folder}/room.map", "{folder}/room.toml", "--pick=1", "--drop=1", "--parking=1"),
    "lif": ("site", "import", "{folder}/floor", "--format=lif", "--out={folder}/out.toml", "--grip=suction"),
    "plan": ("plan", "--map={folder}/room.map", "--scen={folder}/room.scen", "--budget-s=0.2", "--output={folder}/out"),
    "lorr": ("lorr", "{folder}/room.json", "--steps=5"),
    "lorr_2026": ("lorr", "{folder}/room.json", "--steps=5"),
    "why": ("why", "car_0", "{folder}"),
    "run": ("report", "{folder}"),
    "orders_json": (*_DEMO, "--orders={folder}/orders.json"),
    "events": (*_DEMO, "--events={folder}/events.toml"),
}
"""Command that reads the files of a kind."""
BAD_INPUT = 2
"""Exit status of a command that refuses."""
LONGEST_COMMAND_S = 300.0
"""Wall time after which a command hangs, kernels that it compiles included [s]."""
SLOWEST_S = 5.0
"""Promise for one file, on the machine that targets hold for [s]."""
LONGEST_CPU_S = 30.0
"""Time of computing after which reading a file is a hang [s]."""
LONGEST_MESSAGE = 1500
"""Characters that a refusal may have; longer ones bury what is valid."""
TAKEN, REFUSED = "taken", "refused"
_NAMES_VALID = re.compile(r"\bvalid: \S")

Files = dict[str, bytes]


class Hang(BaseException):
    """Reading took too long; nothing that is read may catch it."""


@dataclass(kw_only=True)
class Tally:
    """What became of the files of a kind."""

    counts: Counter[str] = field(default_factory=Counter)
    faults: dict[str, Files] = field(default_factory=dict)
    """The first files that showed each fault, by a line that tells it."""
    slowest_s: float = 0.0
    """Most time of computing that one file took [s]."""


@st.composite
def wrong_files(draw: Draw, kind: str) -> Files:
    """Those files of a kind that are not as its valid example has them, by name."""
    found = FILE_KINDS[kind]
    name = draw(st.sampled_from(list(found.forms)))
    return {name: mutated(draw, contents(kind)[name], found.forms[name])}


def verdict(kind: str, files: Files, folder: Path) -> tuple[str, str]:
    """Read the files of a kind, some of them mutated.

    Args:
        kind: A name in `FILE_KINDS`.
        files: The mutated ones, by name.
        folder: Where they can be written.

    Returns:
        `TAKEN` or `REFUSED`, and what is wrong about that; empty if nothing is.
    """
    for name, content in (dict(contents(kind)) | files).items():
        (folder / name).write_bytes(content)
    with warnings.catch_warnings(), at_most(LONGEST_CPU_S):
        warnings.simplefilter("error")
        try:
            parts = FILE_KINDS[kind].read(folder) or []
        except (FleetError, MapsError, PlanningError) as refusal:
            return REFUSED, message_fault(kind, str(refusal), folder)
        except Hang:
            return REFUSED, f"{kind}: reading took more than {LONGEST_CPU_S:.0f} s"
        except Exception as error:
            return REFUSED, traceback_line(error)
    return TAKEN, next(filter(None, (message_fault(kind, part, folder) for part in parts)), "")


def message_fault(kind: str, message: str, folder: Path) -> str:
    """What a refusal lacks: the file, what is valid, or an end; empty if nothing."""
    text = " ".join(message.split())
    lacks = [
        what
        for ok, what in (
            (_NAMES_VALID.search(text), "does not say what is valid"),
            (any(word in text for word in (folder.name, *FILE_KINDS[kind].where)), "does not name the file"),
            (len(text) <= LONGEST_MESSAGE, f"has {len(text)} characters"),
            (_is_text(text), "cannot be written in UTF-8"),
        )
        if not ok
    ]
    return f"{', '.join(lacks)}: {ascii(text.replace(str(folder), '...'))[:300]}" if lacks else ""


def fuzz(kind: str, n: int, folder: Path) -> Tally:
    """Read n mutated files of a kind; the same ones every time.

    Args:
        kind: A name in `FILE_KINDS`.
        n: How many.
        folder: Where they can be written.
    """
    tally = Tally()

    @reproducibly(n)
    @given(wrong_files(kind))
    def one(files: Files) -> None:
        begin_s = time.process_time()
        found, fault = verdict(kind, files, folder)
        tally.slowest_s = max(tally.slowest_s, time.process_time() - begin_s)
        tally.counts[found] += 1
        if fault:
            tally.faults.setdefault(_like(fault), files)

    one()
    return tally


def measure_fuzz(trial: Trial) -> Iterator[Row]:
    """Read mutated files of all kinds in this process, and a few of them through the command line."""
    each = math.ceil((QUICK_FILES if trial.quick else FILES) / len(FILE_KINDS))
    total: Counter[str] = Counter()
    for kind in FILE_KINDS:
        with tempfile.TemporaryDirectory(prefix="fuzz_") as folder:
            tally = fuzz(kind, each, Path(folder))
        for fault, files in tally.faults.items():
            sizes = ", ".join(f"{name} with {len(content)} bytes" for name, content in files.items())
            trial.check(False, f"{kind}: {fault} ({sizes})")
        total += tally.counts
        yield Row(name=f"{kind}: files", value=sum(tally.counts.values()), unit="")
        yield Row(name=f"{kind}: refused", value=tally.counts[REFUSED], unit="")
        yield Row(
            name=f"{kind}: slowest", value=tally.slowest_s, unit="s CPU", target=f"<= {SLOWEST_S:g}", kind=Kind.TIME
        )
    yield Row(name="all: files", value=sum(total.values()), unit="")
    yield Row(name="all: refused", value=total[REFUSED], unit="")
    n_told = commands_told(QUICK_COMMANDS if trial.quick else COMMANDS, trial)
    yield Row(name="all: files through the command line", value=n_told, unit="")


def commands_told(each: int, trial: Trial) -> int:
    """Hand mutated files to commands, each in a process of its own; returns how many."""
    n = 0
    for kind, words in WORDS.items():
        with tempfile.TemporaryDirectory(prefix="fuzz_") as name:
            folder = Path(name)
            for files in _some(kind, each):
                for file, content in (dict(contents(kind)) | files).items():
                    (folder / file).write_bytes(content)
                fault = command_fault([word.format(folder=folder) for word in words])
                trial.check(not fault, f"{kind}: {fault}")
                n += 1
    return n


def command_fault(words: Sequence[str]) -> str:
    """What is wrong about how a command ends; empty if nothing is.

    Args:
        words: After `python -m fleet`.
    """
    command = [sys.executable, "-m", "fleet", *words]
    try:
        done = subprocess.run(command, capture_output=True, timeout=LONGEST_COMMAND_S, check=False)
    except subprocess.TimeoutExpired:
        return f"{words}: has not ended after {LONGEST_COMMAND_S:.0f} s"
    said = done.stderr.decode(errors="replace")
    if done.returncode == BAD_INPUT:
        one_line = said.count("\n") == 1 and _NAMES_VALID.search(said)
        return "" if one_line else f"{words}: status {BAD_INPUT} with {said[-300:]!r}"
    return (
        "" if done.returncode in (0, 1) and "Traceback" not in said else f"{words}: {done.returncode}: {said[-300:]!r}"
    )


def _some(kind: str, n: int) -> list[Files]:
    """The first mutated files of a kind, by their number in the series that `fuzz` reads."""
    found: list[Files] = []

    @reproducibly(n)
    @given(wrong_files(kind))
    def one(files: Files) -> None:
        found.append(files)

    one()
    return found[:n]


def reproducibly(n: int) -> Any:
    """The same n examples every time, none of which is made smaller."""
    return settings(
        max_examples=n,
        derandomize=True,
        database=None,
        deadline=None,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )


@contextmanager
def at_most(cpu_s: float) -> Iterator[None]:
    """Raise `Hang` in what takes more time of computing than this; busy machines change nothing."""

    def ring(*_: Any) -> None:
        raise Hang

    before = signal.signal(signal.SIGVTALRM, ring)
    signal.setitimer(signal.ITIMER_VIRTUAL, cpu_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def traceback_line(error: Exception) -> str:
    """An error that should have been a refusal, with its place in the project."""
    at = error.__traceback__
    place = ""
    while at is not None:
        name = at.tb_frame.f_code.co_filename
        if "site-packages" not in name and "benchmarks" not in name:
            place = f"{Path(name).parent.name}/{Path(name).name}:{at.tb_lineno}"
        at = at.tb_next
    return f"{type(error).__name__} in {place}: {ascii(str(error))[:200]}"


def _like(fault: str) -> str:
    """The same for faults that differ in numbers and quoted values only."""
    return re.sub(r"""'[^']*'|"[^"]*"|\d+""", "_", fault.partition(": ")[0]) + ": " + fault.partition(": ")[2]


def _is_text(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True
