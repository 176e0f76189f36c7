"""The files of the League of Robot Runners: keys of a problem file, and tables of cells, whatever the edition."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from maps.errors import MapsError
from maps.grid import GridMap
from maps.reading.shown import shown
from maps.reading.text_file import FileError, is_file, parse_json, read_lines, read_text

Ints = npt.NDArray[np.int32]

_FORM = "a JSON object with teamSize, mapFile, agentFile and taskFile"


class LeagueError(MapsError):
    """A problem of the League is malformed; the message names file, line and field."""


class ProblemKeys:
    """The keys of a problem file, and where they stand in it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._text = _read(path)
        try:
            keys = parse_json(self._text, str(path), valid=_FORM)
        except FileError as error:
            raise LeagueError(str(error)) from error
        if not isinstance(keys, dict):
            raise LeagueError(f"{path}: line 1: {type(keys).__name__}; valid: {_FORM}")
        self._keys: dict[str, Any] = keys
        self._section, self._begin = "", 0

    def section(self, key: str) -> ProblemKeys:
        """The keys of an object that is the value of a key."""
        value = self._keys.get(key)
        if not isinstance(value, dict):
            raise self.error(key, "an object")
        inner = copy(self)
        inner._keys, inner._section, inner._begin = value, f"{self._section}{key}.", self._place(key)
        return inner

    def error(self, key: str, valid: str) -> LeagueError:
        """What to raise about the value of a key."""
        name = self._section + key
        if key not in self._keys:
            return LeagueError(f"{self.path}: {name} is missing; valid: {valid}")
        line = 1 + self._text.count("\n", 0, self._place(key))
        return LeagueError(f"{self.path}: line {line}: {name} = {shown(self._keys[key])}; valid: {valid}")

    def text(self, key: str, *, default: str | None) -> str | None:
        """A text, or the default where the key is missing."""
        value = self._keys.get(key, default)
        if value is not None and not isinstance(value, str):
            raise self.error(key, "a text")
        return value

    def choice(self, key: str, choices: Sequence[str]) -> str:
        """One of some words."""
        value = self._keys.get(key)
        if not isinstance(value, str) or value not in choices:
            raise self.error(key, f"one of {', '.join(map(repr, choices))}")
        return value

    def number(self, key: str, *, default: float, most: float) -> float:
        """A number > 0, or the default where the key is missing."""
        value = self._keys.get(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value <= most:
            raise self.error(key, f"a number > 0 and <= {most}")
        return float(value)

    def share(self, key: str, *, most: float = 1.0) -> float:
        """A number from 0 to `most`."""
        value = self._keys.get(key)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= most:
            raise self.error(key, f"a number from 0 to {most:g}")
        return float(value)

    def whole(self, key: str, *, least: int, most: int | None = None, default: int | None = None) -> int:
        """A whole number, or the default where the key is missing and there is one."""
        value = self._keys.get(key, default)
        high = most is not None and isinstance(value, int) and value > most
        if isinstance(value, bool) or not isinstance(value, int) or value < least or high:
            raise self.error(key, f"an integer >= {least}" if most is None else f"an integer from {least} to {most}")
        return value

    def file(self, key: str) -> Path:
        """A file that exists."""
        value = self._keys.get(key)
        if not isinstance(value, str) or not value:
            raise self.error(key, "the path of a file, relative to this one")
        path = self.path.parent / value
        if not is_file(path):
            raise self.error(key, "the path of a file, relative to this one")
        return path

    def _place(self, key: str) -> int:
        """Where a key stands in the text."""
        return max(self._text.find(f'"{key}"', self._begin), 0)


class CellTable:
    """An agent or task file: comments, the number of entries, and an entry a line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: list[int] = []
        """Line number of each entry that was read."""
        numbered = enumerate(_lines(path), start=1)
        self._entries = ((number, line) for number, line in numbered if not line.startswith("#"))
        self.count_line, line = next(self._entries, (1, ""))
        try:
            self.count = int(line)
        except ValueError:
            raise LeagueError(
                f"{path}: line {self.count_line}: {shown(line)}; valid: the number of entries that follow"
            ) from None

    def cells(self, n: int, grid: GridMap, *, most: int | None) -> tuple[Ints, Ints]:
        """Read n entries of at most `most` cells each: their CSR, shapes (n + 1,) and (k,).

        Raises:
            LeagueError: An entry is missing or malformed, or a cell is not on the free floor; names the line.
        """
        ptr, cells = [0], []
        for number, line in self._entries:
            if len(self.lines) == n:
                break
            fields = line.strip().removesuffix(",").split(",")
            try:
                cells += [int(field) for field in fields]
            except ValueError:
                what = "a location" if most == 1 else "locations, separated by commas"
                raise LeagueError(f"{self.path}: line {number}: {shown(line)}; valid: {what}") from None
            if most is not None and len(fields) > most:
                raise LeagueError(f"{self.path}: line {number}: {len(fields)} locations; valid: {most}")
            ptr.append(len(cells))
            self.lines.append(number)
        if len(self.lines) < n:
            raise LeagueError(f"{self.path}: ends after {len(self.lines)} entries; valid: {self.count}, as it promises")
        return np.array(ptr, dtype=np.int32), self._checked(ptr, cells, grid)

    def _checked(self, ptr: list[int], cells: list[int], grid: GridMap) -> Ints:
        """Cells on the free floor, shape (k,)."""
        location = np.array([cell if 0 <= cell < grid.n_cells else -1 for cell in cells], dtype=np.int32)
        outside = location < 0
        bad = outside | ~grid.free.ravel()[location]
        if bad.any():
            at = int(np.flatnonzero(bad)[0])
            line = self.lines[int(np.searchsorted(ptr, at, side="right")) - 1]
            why = f"outside 0..{grid.n_cells - 1}" if outside[at] else "an obstacle"
            raise LeagueError(f"{self.path}: line {line}: location {shown(cells[at])} is {why}; valid: a free cell")
        return location


def _lines(path: Path) -> list[str]:
    try:
        return read_lines(path, str(path), valid="a file of the League of Robot Runners")
    except FileError as error:
        raise LeagueError(str(error)) from error


def _read(path: Path) -> str:
    try:
        return read_text(path, str(path), valid="a file of the League of Robot Runners")
    except FileError as error:
        raise LeagueError(str(error)) from error
