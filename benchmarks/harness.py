"""Harness: what every benchmark shares - rows with targets, checks before figures, one table and one JSON file.

Times of computing are shown as measured, and scaled to a machine on which a plain loop takes 0.3 s (`calibration`);
targets hold for that machine. The loop is timed before and after what is measured, so that a machine that was busy
with something else in between is seen.

A benchmark module holds a function that measures and ends with two lines::

    BENCHMARK = Benchmark(name="tracking", summary="How closely a car follows its lane", measure=measure)

    if __name__ == "__main__":
        raise SystemExit(main(BENCHMARK))
"""

from __future__ import annotations

import argparse
import cProfile
import io
import json
import math
import os
import platform
import pstats
import resource
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.calibration import REFERENCE_S, calibrate
from fleet.whole_file import require_place, write_whole

EXIT_OK = 0
EXIT_WRONG_RESULT = 1
EXIT_BAD_INPUT = 2

_PLAIN_WIDTH = 120
"""Columns of a table that goes to a file or a pipe."""
_STRETCH_S = 0.5
"""Wall time that a row takes after the one before, if it was measured after it [s]."""
_NOISE = 0.15
"""A calibration that has changed by such a share from before to after a measurement makes it uncertain."""
_TIMES = ("s", "ms", "us", "ns", "min")
_PROFILED = 25
"""Functions that a profile names."""


class Kind(StrEnum):
    """How a figure depends on the speed of the machine."""

    TIME = "time"
    """Of computing: longer on a slower machine."""
    RATE = "rate"
    """Work per time of computing: less on a slower machine."""
    PLAIN = "plain"
    """Not at all: counts, shares and ratios, lengths, simulated times, waits for a clock."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One figure.

    Raises:
        ValueError: The target has another form, or the unit is one of time and `kind` is not given.
    """

    name: str
    value: float
    """As measured."""
    unit: str
    target: str = ""
    """``<= x`` or ``>= x``; empty for a figure without a promise."""
    kind: Kind | None = None
    """None = plain; has to be given where the unit is one of time, because simulated times are plain."""
    calibration_s: tuple[float, float] | None = None
    """Time of the calibration before and after the figure was measured [s]; None = the harness tells."""

    def __post_init__(self) -> None:
        if self.target:
            _limit(self.target)
        if self.kind is None and _is_of_time(self.unit):
            raise ValueError(f"kind of row {self.name!r} in {self.unit!r} is None; valid: {', '.join(Kind)}")

    @property
    def scaled(self) -> float | None:
        """The value on the machine that targets hold for; None of a figure that does not depend on the machine."""
        if self.kind not in (Kind.TIME, Kind.RATE):
            return None
        factor = REFERENCE_S / (0.5 * sum(self.calibration_s)) if self.calibration_s else 1.0
        return self.value * factor if self.kind is Kind.TIME else self.value / factor

    @property
    def met(self) -> bool | None:
        """Whether the scaled value, or a plain one, keeps the target; None without one.

        A value that is not a number keeps none.
        """
        if not self.target:
            return None
        sign, bound = _limit(self.target)
        value = self.value if self.scaled is None else self.scaled
        return value <= bound if sign == "<=" else value >= bound

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON knows it; what is not finite is null, as is the scaled value of a plain figure."""
        scaled = self.scaled
        return {
            "name": self.name,
            "value": self.value if math.isfinite(self.value) else None,
            "scaled": scaled if scaled is not None and math.isfinite(scaled) else None,
            "unit": self.unit,
            "target": self.target or None,
            "met": self.met,
            "calibration_s": None if scaled is None else self.calibration_s,
        }


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What a benchmark's `measure` is told, and where it reports wrong results."""

    quick: bool
    """Shrink the repetitions, keep every row."""
    seeds: tuple[int, ...]
    groups: tuple[str, ...] = ()
    """Groups of rows that are wanted, of a benchmark that has groups."""
    failures: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """Said below the table, such as rows that are left out and why."""
    profile: bool = False
    """Say below the table where the time went."""

    @contextmanager
    def profiled(self, what: str) -> Iterator[None]:
        """Around what is measured: with `profile`, note the functions that took most of it; else nothing.

        Args:
            what: Heads the note.
        """
        if not self.profile:
            yield
            return
        profiler = cProfile.Profile()
        with profiler:
            yield
        for order in ("tottime", "cumulative"):
            text = io.StringIO()
            pstats.Stats(profiler, stream=text).strip_dirs().sort_stats(order).print_stats(_PROFILED)
            self.notes.append(f"{what}:\n{text.getvalue().strip()}")

    def check(self, ok: bool, what: str) -> None:
        """Note a wrong result; figures measured on wrong results are not shown.

        Args:
            ok: Whether the result is right.
            what: What is wrong where, such as ``seed 3: 5 of 6 tasks done``; shown when `ok` is false.
        """
        if not ok:
            self.failures.append(what)


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """One module's promise, and how it is measured."""

    name: str
    summary: str
    measure: Callable[[Trial], Iterable[Row]]
    """Runs the cases, calls `Trial.check` on each result, and returns the figures."""
    seeds: tuple[int, ...] = (0,)
    quick_seeds: tuple[int, ...] = (0,)
    groups: tuple[str, ...] = ()
    """Names of groups of rows that can be run alone, in the order of the table."""
    profiles: bool = False
    """Whether it can say where the time went."""


def grouped(
    groups: Mapping[str, Callable[[Trial], Iterable[Row]]],
    *,
    name: str,
    summary: str,
    seeds: tuple[int, ...] = (0,),
    quick_seeds: tuple[int, ...] = (0,),
    profiles: bool = False,
) -> Benchmark:
    """A benchmark that runs the groups that were asked for, in the order they were asked for.

    Args:
        groups: What measures each group, by name.
        name: As of `Benchmark`, like all that follows.
        summary: What it measures.
        seeds: Of its cases.
        quick_seeds: Those of a quick run.
        profiles: Whether it can say where the time went.
    """

    def measure(trial: Trial) -> Iterable[Row]:
        for group in trial.groups:
            yield from groups[group](trial)

    return Benchmark(
        name=name,
        summary=summary,
        measure=measure,
        seeds=seeds,
        quick_seeds=quick_seeds,
        groups=tuple(groups),
        profiles=profiles,
    )


def main(benchmark: Benchmark, argv: Sequence[str] | None = None, console: Console | None = None) -> int:
    """Run one benchmark from the command line.

    Args:
        benchmark: What to run.
        argv: Arguments after the program's name; None for those of the process.
        console: Where the table goes; None for standard output.

    Returns:
        Exit status: 0 if all results are right (also with a target missed, which the table says), 1 if a result is
        wrong, 2 if the JSON file cannot be written.
    """
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks.{benchmark.name}", description=benchmark.summary)
    parser.add_argument("--quick", action="store_true", help="the same rows from few repetitions, in about a minute")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write rows, machine, commit and seeds to FILE")
    if benchmark.groups:
        parser.add_argument(
            "--only", nargs="+", metavar="GROUP", help=f"of {', '.join(benchmark.groups)}; default: all"
        )
    if benchmark.profiles:
        parser.add_argument("--profile", action="store_true", help="also say which functions took most of the time")
    options = parser.parse_args(argv)
    groups = tuple(getattr(options, "only", None) or benchmark.groups)
    unknown = [group for group in groups if group not in benchmark.groups]
    if unknown:
        parser.error(f"--only: no group {unknown[0]!r}; valid: {', '.join(benchmark.groups)}")
    console = console or plain_console()

    if options.json is not None and (problem := write_problem(options.json)):
        console.print(f"--json {options.json}: {problem}", highlight=False, markup=False, soft_wrap=True)
        return EXIT_BAD_INPUT

    seeds = benchmark.quick_seeds if options.quick else benchmark.seeds
    trial = Trial(quick=options.quick, seeds=seeds, groups=groups, profile=getattr(options, "profile", False))
    rows = list(_calibrated(benchmark, trial))
    if trial.failures:
        for failure in trial.failures:
            console.print(f"{benchmark.name}: wrong result: {failure}", highlight=False, markup=False, soft_wrap=True)
        return EXIT_WRONG_RESULT

    console.print(_table(benchmark, rows))
    for note in (*_calibration_notes(rows), *trial.notes):
        console.print(note, highlight=False, markup=False, soft_wrap=True)
    if options.json is not None:
        write_json(options.json, report(benchmark, trial, rows))
    return EXIT_OK


def _calibrated(benchmark: Benchmark, trial: Trial) -> Iterator[Row]:
    """Measure, with a calibration before and after each stretch of it that ends in a row.

    Rows that come right after one another have been measured in the same stretch.
    """
    before_s = calibrate()
    stretch_s, begin_s = (before_s, before_s), time.perf_counter()
    for row in benchmark.measure(trial):
        if time.perf_counter() - begin_s > _STRETCH_S:
            after_s = calibrate()
            stretch_s, before_s, begin_s = (before_s, after_s), after_s, time.perf_counter()
        yield row if row.calibration_s is not None else replace(row, calibration_s=stretch_s)


def report(benchmark: Benchmark, trial: Trial, rows: Sequence[Row]) -> dict[str, Any]:
    """Return what the JSON file holds: the rows, and what is needed to measure them again."""
    from fleet.recording.run_file import commit  # it brings the viewer's library along, which measured runs do without

    return {
        "name": benchmark.name,
        "quick": trial.quick,
        "rows": [row.to_json() for row in rows],
        "machine": machine(),
        "commit": commit(),
        "seeds": list(trial.seeds),
        "calibration_reference_s": REFERENCE_S,
        "notes": trial.notes,
    }


def machine() -> dict[str, Any]:
    """Return what the figures were measured on."""
    return {
        "cpu": _cpu_name(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def computing_s() -> float:
    """Computing time of this process so far, all threads, and of programs that it ran and that have ended [s]."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def plain_console() -> Console:
    """Return a console on standard output that does not fold a table only because it is read by a program."""
    return Console() if sys.stdout.isatty() else Console(width=_PLAIN_WIDTH)


def write_problem(path: Path) -> str | None:
    """Return why `path` cannot be written, or None; asked before minutes are spent on measuring."""
    try:
        require_place(path)
    except OSError as error:
        return error.strerror or str(error)
    return None


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write `content` as JSON, whole or not at all."""
    write_whole(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def _limit(target: str) -> tuple[str, float]:
    """Split a target into its sign and its bound."""
    sign, _, bound = target.partition(" ")
    try:
        if sign not in ("<=", ">="):
            raise ValueError(sign)
        return sign, float(bound)
    except ValueError:
        raise ValueError(f"target is {target!r}; valid: '<= x' or '>= x' with a number x") from None


def _is_of_time(unit: str) -> bool:
    """Whether a unit is one of time or of a rate per second, such as ``ms CPU`` or ``steps/s``."""
    first = unit.partition(" ")[0]
    return first in _TIMES or unit.endswith("/s")


def _table(benchmark: Benchmark, rows: Sequence[Row]) -> Table:
    missed = sum(row.met is False for row in rows)
    table = Table(title=escape(f"{benchmark.name}: {benchmark.summary}"), title_justify="left")
    table.caption = f"{missed} of {len(rows)} rows miss their target" if missed else None
    table.add_column("name")
    table.add_column("value", justify="right")
    table.add_column("scaled", justify="right")
    table.add_column("unit")
    table.add_column("target")
    table.add_column("met")
    for row in rows:
        met = {True: "yes", False: "[bold red]NO[/]", None: ""}[row.met]
        scaled = "" if row.scaled is None else f"{row.scaled:.4g}"
        table.add_row(escape(row.name), f"{row.value:.4g}", scaled, escape(row.unit), row.target, met)
    return table


def _calibration_notes(rows: Sequence[Row]) -> Iterator[str]:
    """How fast the machine was, and which figures it was not steady for."""
    timed = [(row, row.calibration_s) for row in rows if row.scaled is not None and row.calibration_s]
    if not timed:
        return
    least_s, most_s = (pick(second for _, pair in timed for second in pair) for pick in (min, max))
    yield (
        f"scaled = on a machine whose calibration, ten million additions in Python, takes {REFERENCE_S} s of CPU time; "
        f"here it took {least_s:.2f} to {most_s:.2f} s"
    )
    unsteady = [
        f"{row.name.strip()} ({before_s:.2f} s before, {after_s:.2f} s after)"
        for row, (before_s, after_s) in timed
        if max(before_s, after_s) > (1.0 + _NOISE) * min(before_s, after_s)
    ]
    if unsteady:
        yield f"uncertain, because the calibration changed meanwhile: {'; '.join(unsteady)}"


def _cpu_name() -> str:
    """Return the processor's own name where Linux tells it, else the platform's word for it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"
