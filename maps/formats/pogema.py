"""The maps of POGEMA (maps.yaml): several in one file, some with cells where robots begin and cells that are goals.

`.` is free, `#` an obstacle; robots begin on `$` and are sent to `@` where a map has them, else anywhere. Read so, the
warehouse map gives what was published for it; the marks are free cells, too.

Source: Skrynnik et al., "POGEMA: A Benchmark Platform for Cooperative Multi-Agent Pathfinding", ICLR 2025,
https://arxiv.org/abs/2407.14931; files: https://github.com/CognitiveAISystems/pogema-benchmark.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maps.errors import MapsError
from maps.formats.movingai import read_map
from maps.grid import BoolGrid, GridMap
from maps.reading.shown import shown
from maps.reading.text_file import FileError, read_lines

_NAME = re.compile(r"""(?P<quote>["']?)(?P<name>[^"':]+)(?P=quote):\s*\|-?\s*""")
_MARKS = ".#@$"


class PogemaError(MapsError):
    """A file of maps is malformed, or has no such map; the message names file, line and what is valid."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenFloor:
    """A floor without lanes: robots step to any free neighbouring cell."""

    name: str
    grid: GridMap
    starts: BoolGrid
    """Free cells where robots may begin, shape (rows, cols)."""
    goals: BoolGrid
    """Free cells that they may be sent to, shape (rows, cols)."""


def read_floor(word: str | os.PathLike[str]) -> OpenFloor:
    """Read one floor.

    Args:
        word: Path of a MovingAI .map; or `FILE:NAME`, a file of POGEMA's maps and a name in it, the name only where
            there are several.

    Raises:
        PogemaError: The file cannot be read, is malformed or has no such map.
        MovingAiError: The same of a .map file.
    """
    text = os.fspath(word)
    file, _, name = text.partition(":")
    if file.endswith(".map"):
        grid = read_map(file)
        return OpenFloor(name=Path(file).stem, grid=grid, starts=grid.free, goals=grid.free)
    floors = read_floors(file)
    if not name and len(floors) == 1:
        return next(iter(floors.values()))
    if name not in floors:
        names = [*floors] if len(floors) <= 4 else [*list(floors)[:3], "..."]
        raise PogemaError(f"{file}: no map {shown(name)}; valid: {file}:NAME with one of {', '.join(names)}")
    return floors[name]


def read_floors(path: str | os.PathLike[str]) -> dict[str, OpenFloor]:
    """Read all floors of a file, by name.

    Raises:
        PogemaError: The file cannot be read or is malformed.
    """
    try:
        lines = read_lines(path, str(path), valid="a file of POGEMA's maps")
    except FileError as reason:
        raise PogemaError(str(reason)) from reason
    drawn: dict[str, list[str]] = {}
    rows: list[str] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        if not line[0].isspace():
            match = _NAME.fullmatch(line)
            if match is None:
                raise PogemaError(f"{path}: line {number} is {shown(line)}; valid: a name followed by ': |-'")
            if match["name"] in drawn:
                raise PogemaError(
                    f"{path}: line {number}: {match['name']} again; valid: a name of its own for each map"
                )
            rows = drawn[match["name"]] = []
            continue
        row = line.strip()
        if not drawn:
            raise PogemaError(f"{path}: line {number} is {shown(line)}, a row of no map; valid: rows below a name")
        if set(row) - set(_MARKS):
            raise PogemaError(f"{path}: line {number} is {shown(row)}; valid: cells {' '.join(_MARKS)}")
        if rows and len(row) != len(rows[0]):
            raise PogemaError(f"{path}: line {number} has {len(row)} cells; valid: {len(rows[0])} as the rows above")
        rows.append(row)
    if not drawn or not all(drawn.values()):
        raise PogemaError(f"{path}: a map without rows; valid: names, each with rows of {' '.join(_MARKS)}")
    return {name: _floor(name, rows) for name, rows in drawn.items()}


def _floor(name: str, rows: list[str]) -> OpenFloor:
    marks = np.array([list(row) for row in rows])
    free = marks != "#"
    starts, goals = marks == "$", marks == "@"
    return OpenFloor(
        name=name,
        grid=GridMap(free),
        starts=starts if starts.any() else free,
        goals=goals if goals.any() else free,
    )
