"""Compare sixty runs with what was recorded of them: `python -m benchmarks.behaviour [--record] [--only NAME ...]`."""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from importlib import metadata
from pathlib import Path
from typing import Any

from llvmlite.binding import get_host_cpu_name
from rich.console import Console

from benchmarks.behaviour.cases import CASES
from benchmarks.behaviour.digest import differences, to_record
from benchmarks.behaviour.play import REPOSITORY, Played
from benchmarks.harness import EXIT_OK, EXIT_WRONG_RESULT, plain_console, write_json

RECORDED = Path(__file__).with_name("recorded.json")
LONGEST_S = 900.0
"""Wall time after which a case has hung; kernels that must be compiled first take a minute or two [s]."""
_DECIDING = ("numpy", "numba", "pybullet", "scipy", "ompl", "pettingzoo", "gymnasium")
"""Packages whose version can change what a run does."""


def main(argv: Sequence[str] | None = None) -> int:
    """Play the cases, each in a process of its own, and compare or record them.

    Returns:
        Exit status: 0 if all are as recorded, 1 if one is not or did not come to its end, 2 for bad input.
    """
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.behaviour", description="Compare what sixty runs do with what was recorded of them."
    )
    parser.add_argument("--record", action="store_true", help="record what they do now, in place of comparing it")
    parser.add_argument("--only", nargs="+", metavar="NAME", default=list(CASES), help="cases; default: all")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="cases at once; default: 2")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep all files, to compare them with those of others")
    parser.add_argument("--list", action="store_true", help="list the cases and what they show")
    options = parser.parse_args(argv)
    unknown = [name for name in options.only if name not in CASES]
    if unknown:
        parser.error(f"--only: no case {unknown[0]!r}; valid: {', '.join(CASES)}")
    if options.jobs < 1:
        parser.error(f"--jobs is {options.jobs}; valid: an integer >= 1")
    console = plain_console()
    if options.list:
        for name, one in CASES.items():
            _say(console, f"{name:24s} {one.what}")
        return EXIT_OK
    recorded = json.loads(RECORDED.read_text(encoding="utf-8")) if RECORDED.exists() else {"cases": {}}
    with ExitStack() as stack:
        folder = options.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        pool = stack.enter_context(ThreadPoolExecutor(options.jobs))
        names = list(dict.fromkeys(options.only))
        played = zip(names, pool.map(lambda name: _play(name, folder / name), names), strict=True)
        wrong = _record(console, recorded, played) if options.record else _compare(console, recorded, played)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    _say(
        console, f"{len(names) - wrong} of {len(names)} cases; {used.ru_utime + used.ru_stime:.0f} s of processor time"
    )
    return EXIT_WRONG_RESULT if wrong else EXIT_OK


def _record(console: Console, recorded: dict[str, Any], played: Any) -> int:
    """Take what was played into the file; returns how many cases did not come to their end."""
    wrong = 0
    cases = dict(recorded["cases"])
    for name, found in played:
        if isinstance(found, Played):
            _say(console, f"recorded {name}")
            cases[name] = to_record(found.parts, found.figures)
        else:
            _say(console, f"FAILED   {name}: {found}")
            wrong += 1
    cases = {name: cases[name] for name in CASES if name in cases}
    write_json(RECORDED, {"versions": _versions(), "cases": cases})
    return wrong


def _compare(console: Console, recorded: dict[str, Any], played: Any) -> int:
    """Say of each case whether it is as it was recorded; returns how many are not."""
    wrong = 0
    for name, found in played:
        if not isinstance(found, Played):
            parts = [found]
        elif name not in recorded["cases"]:
            parts = ["it was never recorded; --record does it"]
        else:
            parts = differences(recorded["cases"][name], found.parts, found.figures)
        _say(console, f"{'DIFFERS:' if parts else 'same    '} {name}")
        for part in parts:
            _say(console, f"    {part}")
        wrong += bool(parts)
    versions = _versions()
    others = {name: version for name, version in recorded.get("versions", {}).items() if versions.get(name) != version}
    if wrong and others:
        told = ", ".join(f"{name} {version}" for name, version in others.items())
        _say(console, f"it was recorded with: {told}")
    return wrong


def _play(name: str, folder: Path) -> Played | str:
    """What a case does in a fresh process, or why it did not come to its end."""
    command = [sys.executable, "-m", "benchmarks.behaviour.play", name, str(folder.resolve())]
    surroundings = {**os.environ, "PYTHONPATH": os.pathsep.join([str(REPOSITORY), os.environ.get("PYTHONPATH", "")])}
    try:
        done = subprocess.run(
            command, cwd=REPOSITORY, env=surroundings, capture_output=True, text=True, timeout=LONGEST_S, check=False
        )
    except subprocess.TimeoutExpired:
        return f"it has not ended after {LONGEST_S:.0f} s"
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        return f"it ended with status {done.returncode}: {last}"
    return Played.read(folder)


def _versions() -> dict[str, str]:
    """What decides the last bit of a run: kernels are compiled for the processor, whose instructions round unlike."""
    found = {"processor": get_host_cpu_name(), "python": sys.version.split()[0]}
    for package in _DECIDING:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def _say(console: Console, line: str) -> None:
    console.print(line, highlight=False, markup=False, soft_wrap=True)


if __name__ == "__main__":
    raise SystemExit(main())
