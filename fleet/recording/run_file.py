"""RunFile: what decided a run and what happened in it, line by line, beside the recording."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import platform
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from importlib import metadata
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from fleet.recording.errors import OutputError
from fleet.recording.output_file import OutputFile, require_room
from fleet.recording.trace_file import TRACE
from fleet.whole_file import write_whole
from maps.reading.shown import shown
from maps.reading.text_file import FileError, parse_json, read_lines, read_text

RECORDING = "recording.rrd"
EVENTS = "run.jsonl"
RESULT = "result.json"
VIOLATION = "violation.json"
DECISIONS = "decisions.json"
RUN_FILES = (RECORDING, EVENTS, TRACE, RESULT, DECISIONS, VIOLATION)
_FIGURES = "the figures of a run as one JSON object"
_SOURCE = Path(__file__).resolve().parents[2]
_PACKAGES = (
    "pybullet",
    "ompl",
    "numpy",
    "numba",
    "scipy",
    "networkx",
    "pettingzoo",
    "pydantic",
    "rerun-sdk",
)


@cache
def versions() -> dict[str, str]:
    """Versions of Python and of what can change a result, looked up once; an absent package is left out."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def commit() -> str | None:
    """Commit of the source, with `-dirty` where files differ from it; None outside a git clone."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        found = subprocess.run(command, cwd=_SOURCE, capture_output=True, text=True, check=False)
    except OSError:
        return None
    return found.stdout.strip() or None


_KNOWN = frozenset({int, str, bool, type(None)})
"""Types that JSON knows as they are."""


def plain(value: object) -> Any:
    """Turn a value into what JSON knows.

    Dataclasses become objects, enumerations their values, paths text, arrays lists; a number that JSON has no word for
    (infinite, not a number) becomes null.

    Args:
        value: Any tree of settings or results.

    Returns:
        Dicts, lists, text, numbers, booleans, None.
    """
    # Most of what is written in every tick is told apart first.
    if type(value) in _KNOWN:
        made: Any = value
    elif type(value) is list:
        made = [item if type(item) in _KNOWN else plain(item) for item in value]
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        made = {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    elif isinstance(value, Enum):
        made = plain(value.value)
    elif isinstance(value, Mapping):
        made = {str(plain(key)): plain(item) for key, item in value.items()}
    elif isinstance(value, np.ndarray | np.generic):
        made = plain(value.tolist())
    elif isinstance(value, list | tuple | set | frozenset):
        made = [plain(item) for item in (sorted(value) if isinstance(value, set | frozenset) else value)]
    elif isinstance(value, float):
        made = value if math.isfinite(value) else None
    elif value is None or isinstance(value, bool | int | str):
        made = value
    elif isinstance(value, PurePath):
        made = value.as_posix()
    else:
        made = str(value)
    return made


def prepare_output(directory: Path) -> Path:
    """Make sure that a run can write its files, and remove those of an earlier run.

    Call it when everything else is known to be right: a run that is refused must leave earlier results alone.

    Args:
        directory: Created with its parents if it does not exist.

    Returns:
        The directory.

    Raises:
        OutputError: It cannot be created or written; then nothing was changed.
    """
    missing = [path for path in (directory, *directory.parents) if not path.exists()]
    require_room(next(path for path in (directory, *directory.parents) if path.exists()))
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        for path in missing:
            if path.is_dir():
                path.rmdir()
        reason = error.strerror or str(error)
        raise OutputError(f"--out {directory}: {reason}; valid: a directory that can be written") from error
    old = [directory / name for name in RUN_FILES]
    for path in old:
        if path.is_dir():
            raise OutputError(f"--out {directory}: {path.name} is a directory; valid: a file, or nothing there")
    try:
        for path in old:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"--out {directory}: the file of an earlier run cannot be replaced: {error}") from error
    return directory


def discard_output(directory: Path) -> None:
    """Remove the files of a run that could not begin."""
    for name in RUN_FILES:
        (directory / name).unlink(missing_ok=True)


class RunFile(OutputFile):
    """Writes ``run.jsonl`` and ``result.json``; use as a context manager, or call `close`.

    Every line is written out at once, so a killed process leaves all events that happened.

    Args:
        directory: As returned by `prepare_output`.
        config: Resolved settings, a dataclass or a mapping.
        seed: Seed of the run.

    Raises:
        OutputError: The file cannot be opened.
    """

    def __init__(self, directory: Path, *, config: object, seed: int) -> None:
        super().__init__(directory, EVENTS)
        self._directory = directory
        head = self._write({"kind": "run", "config": config, "seed": seed, "versions": versions()})
        self.name = _name_of(head)
        """Stands in every file of the run, so that files of two runs are told apart, see `RunRecord.name`."""

    def event(self, tick: int, sim_s: float, kind: str, **details: object) -> None:
        """Append one event.

        Args:
            tick: When, in ticks.
            sim_s: When, in simulated time [s].
            kind: What, one word.
            details: Whatever belongs to it.
        """
        self._write({"tick": tick, "sim_s": round(sim_s, 6), "kind": kind, **details})

    def result(self, result: object) -> None:
        """Write ``result.json`` in one step: readers see the whole of it or nothing."""
        self._write_whole(RESULT, result)

    def violation(self, **evidence: object) -> None:
        """Write ``violation.json`` in the same way: which invariant did not hold, when, where and with which values."""
        self._write_whole(VIOLATION, {"run": self.name, **evidence})

    def _write_whole(self, name: str, item: object) -> None:
        write_whole(self._directory / name, json.dumps(plain(item), indent=2, allow_nan=False) + "\n")

    def _write(self, item: Mapping[str, object]) -> str:
        line = json.dumps(plain(item), allow_nan=False, separators=(",", ":"))
        self._append(line.encode() + b"\n")
        return line


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A run as its files tell it."""

    config: dict[str, Any]
    seed: int
    versions: dict[str, str]
    name: str
    """Digest of settings, seed and versions: runs that differ in any of them have other names."""
    events: tuple[dict[str, Any], ...]
    result: dict[str, Any] | None
    """None if the run did not come to its end."""


def read_run(directory: Path) -> RunRecord:
    """Read the files of a run; the half line of a killed process is skipped.

    Args:
        directory: The run's output directory.

    Returns:
        Header, events and result.

    Raises:
        OutputError: There is no run file, it has no header, or a file of the run is something else; names the line.
    """
    path = directory / EVENTS
    valid = "the --out directory of a run"
    try:
        lines = read_lines(path, f"no run in {directory}: {EVENTS}", valid=valid)
    except FileError as error:
        raise OutputError(str(error)) from error
    items: list[dict[str, Any]] = []
    for number, line in enumerate(lines, start=1):
        try:
            item = parse_json(line, f"{path}, line {number}", valid="one JSON object per line")
        except FileError as error:
            if number == len(lines) and items:
                break
            raise OutputError(str(error)) from error
        if not isinstance(item, dict) or not isinstance(item.get("kind"), str):
            raise OutputError(f"{path}, line {number}: {shown(line)}; valid: one JSON object with its kind per line")
        items.append(item)
    header = items[0] if items else {}
    if header.get("kind") != "run" or not {"config", "seed", "versions"} <= header.keys():
        found = shown(lines[0]) if lines else "an empty file"
        raise OutputError(f"{path}, line 1: {found}; valid: the object of kind 'run' with config, seed and versions")
    return RunRecord(
        config=header["config"],
        seed=header["seed"],
        versions=header["versions"],
        name=_name_of(lines[0]),
        events=tuple(items[1:]),
        result=_read_result(directory / RESULT),
    )


def _name_of(head: str) -> str:
    """The name of a run, from the first line of its run file."""
    return hashlib.sha256(head.encode()).hexdigest()[:16]


def _read_result(path: Path) -> dict[str, Any] | None:
    """The figures of a run, None if it has none."""
    if not path.is_file():
        return None
    try:
        result = parse_json(read_text(path, str(path), valid=_FIGURES), str(path), valid=_FIGURES)
    except FileError as error:
        raise OutputError(str(error)) from error
    if not isinstance(result, dict):
        raise OutputError(f"{path}: is {shown(result)}; valid: {_FIGURES}")
    return result
