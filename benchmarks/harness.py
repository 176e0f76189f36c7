"""Harness: what every benchmark shares - rows with targets, checks before figures, one table and one JSON file.

A benchmark module holds a function that measures and ends with two lines::

    BENCHMARK = Benchmark(name="tracking", summary="How closely a car follows its lane", measure=measure)

    if __name__ == "__main__":
        raise SystemExit(main(BENCHMARK))
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

EXIT_OK = 0
EXIT_WRONG_RESULT = 1
EXIT_BAD_INPUT = 2

_REPOSITORY = Path(__file__).resolve().parent.parent
_PLAIN_WIDTH = 120
"""Columns of a table that goes to a file or a pipe."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One figure."""

    name: str
    value: float
    unit: str
    target: str = ""
    """``<= x`` or ``>= x``; empty for a figure without a promise."""

    def __post_init__(self) -> None:
        if self.target:
            _limit(self.target)

    @property
    def met(self) -> bool | None:
        """Whether the value keeps the target; None without one. A value that is not a number keeps none."""
        if not self.target:
            return None
        sign, bound = _limit(self.target)
        return self.value <= bound if sign == "<=" else self.value >= bound

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON knows it; a value that is not finite becomes null."""
        value = self.value if math.isfinite(self.value) else None
        return {"name": self.name, "value": value, "unit": self.unit, "target": self.target or None, "met": self.met}


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


def in_groups(groups: Mapping[str, Callable[[Trial], Iterable[Row]]]) -> Callable[[Trial], Iterable[Row]]:
    """A benchmark's `measure` that runs the groups that were asked for, in the order they were asked for.

    Args:
        groups: What measures each group, by name.
    """

    def measure(trial: Trial) -> Iterable[Row]:
        for name in trial.groups:
            yield from groups[name](trial)

    return measure


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
    trial = Trial(quick=options.quick, seeds=seeds, groups=groups)
    rows = list(benchmark.measure(trial))
    if trial.failures:
        for failure in trial.failures:
            console.print(f"{benchmark.name}: wrong result: {failure}", highlight=False, markup=False, soft_wrap=True)
        return EXIT_WRONG_RESULT

    console.print(_table(benchmark, rows))
    for note in trial.notes:
        console.print(note, highlight=False, markup=False, soft_wrap=True)
    if options.json is not None:
        write_json(options.json, report(benchmark, trial, rows))
    return EXIT_OK


def report(benchmark: Benchmark, trial: Trial, rows: Sequence[Row]) -> dict[str, Any]:
    """Return what the JSON file holds: the rows, and what is needed to measure them again."""
    return {
        "name": benchmark.name,
        "quick": trial.quick,
        "rows": [row.to_json() for row in rows],
        "machine": machine(),
        "commit": commit(),
        "seeds": list(trial.seeds),
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


def commit() -> str | None:
    """Return the commit of the source tree, with ``-dirty`` if files differ from it; None outside a git clone."""
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"],
            cwd=_REPOSITORY,
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError:
        return None
    return found.stdout.strip() or None


def plain_console() -> Console:
    """Return a console on standard output that does not fold a table only because it is read by a program."""
    return Console() if sys.stdout.isatty() else Console(width=_PLAIN_WIDTH)


def write_problem(path: Path) -> str | None:
    """Return why `path` cannot be written, or None; asked before minutes are spent on measuring."""
    folder = path.parent
    if path.is_dir():
        return "is a folder; name a file"
    if not folder.is_dir():
        return f"the folder {folder} does not exist"
    if not os.access(path if path.exists() else folder, os.W_OK):
        return "is not writable"
    return None


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write `content` as JSON, whole or not at all."""
    part = path.with_name(f".{path.name}.part")
    part.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    part.replace(path)


def _limit(target: str) -> tuple[str, float]:
    """Split a target into its sign and its bound."""
    sign, _, bound = target.partition(" ")
    try:
        if sign not in ("<=", ">="):
            raise ValueError(sign)
        return sign, float(bound)
    except ValueError:
        raise ValueError(f"target is {target!r}; valid: '<= x' or '>= x' with a number x") from None


def _table(benchmark: Benchmark, rows: Sequence[Row]) -> Table:
    missed = sum(row.met is False for row in rows)
    table = Table(title=escape(f"{benchmark.name}: {benchmark.summary}"), title_justify="left")
    table.caption = f"{missed} of {len(rows)} rows miss their target" if missed else None
    table.add_column("name")
    table.add_column("value", justify="right")
    table.add_column("unit")
    table.add_column("target")
    table.add_column("met")
    for row in rows:
        met = {True: "yes", False: "[bold red]NO[/]", None: ""}[row.met]
        table.add_row(escape(row.name), f"{row.value:.4g}", escape(row.unit), row.target, met)
    return table


def _cpu_name() -> str:
    """Return the processor's own name where Linux tells it, else the platform's word for it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"
