"""Yard: a floor without lanes, with spots along which cars pick up and set down."""

from __future__ import annotations

import math
import os
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from maps.errors import SiteFileError, UnknownSiteError
from maps.reading.near import hint
from maps.reading.shown import shown
from maps.reading.text_file import FileError, is_file, parse_toml, read_text

FloatArray = npt.NDArray[np.float64]

PICK, DROP = KINDS = ("pick", "drop")
_FOLDER = Path(__file__).parent / "yards"
_VALID = "a yard: size_m = [x, y], and tables [[spots]] with kind, x, y, heading_deg, and perhaps count and step_m"
_SPOT = {"kind", "x", "y", "heading_deg", "count", "step_m"}
_PILLAR = {"x", "y", "radius_m"}
_LARGEST_M, _MOST_SPOTS = 1000.0, 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class Yard:
    """A rectangle with walls, round pillars and spots."""

    name: str
    size_m: tuple[float, float]
    """x and y of the corner opposite to (0, 0) [m]."""
    spots: FloatArray
    """Pose of the rear axle of a car that stands there, x, y [m], yaw [rad], shape (n, 3)."""
    kinds: tuple[str, ...]
    """`pick` or `drop` of each spot."""
    pillars: FloatArray
    """x, y and radius [m], shape (k, 3)."""

    @cached_property
    def picks(self) -> npt.NDArray[np.int64]:
        """Numbers of the pick spots."""
        return np.flatnonzero(np.array(self.kinds) == PICK)

    @cached_property
    def drops(self) -> npt.NDArray[np.int64]:
        """Numbers of the drop spots."""
        return np.flatnonzero(np.array(self.kinds) == DROP)


def yard_names() -> list[str]:
    """The yards that ship."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def load_yard(name: str | os.PathLike[str]) -> Yard:
    """Load a yard.

    Args:
        name: Of a yard that ships, or a file.

    Raises:
        UnknownSiteError: There is neither.
        SiteFileError: The file is malformed; the message names it and the entry.
    """
    path = Path(name) if is_file(name) else _FOLDER / f"{name}.toml"
    if not is_file(path):
        names = yard_names()
        raise UnknownSiteError(
            f"yard {shown(str(name))} is unknown{hint(name, names)}; valid: {', '.join(names)}, or a file"
        )
    where = f"yard {path.name}"
    try:
        content = parse_toml(read_text(path, where, valid=_VALID), where, valid=_VALID)
    except FileError as error:
        raise SiteFileError(str(error)) from error
    if unknown := sorted(content.keys() - {"size_m", "spots", "pillars"}):
        raise SiteFileError(f"{where}: unknown entry {shown(unknown[0])}; valid: size_m, spots, pillars")
    size = content.get("size_m")
    if (
        not isinstance(size, list)
        or len(size) != 2
        or not all(_is_number(side) and 0 < side <= _LARGEST_M for side in size)
    ):
        raise SiteFileError(f"{where}: size_m is {shown(size)}; valid: two lengths up to {_LARGEST_M:g}")
    spots: list[list[float]] = []
    kinds: list[str] = []
    for number, table in enumerate(_tables(content, "spots", where)):
        row, kind = _row(table, f"{where}: spots[{number}]")
        spots += row
        kinds += [kind] * len(row)
    pillars = [
        _numbers(table, _PILLAR, ("x", "y", "radius_m"), f"{where}: pillars[{number}]")
        for number, table in enumerate(_tables(content, "pillars", where))
    ]
    if not (PICK in kinds and DROP in kinds) or len(kinds) > _MOST_SPOTS:
        raise SiteFileError(f"{where}: {len(kinds)} spots; valid: a pick and a drop at least, {_MOST_SPOTS} at most")
    for number, pillar in enumerate(pillars):
        if pillar[2] <= 0:
            raise SiteFileError(f"{where}: pillars[{number}].radius_m is {pillar[2]}; valid: a number > 0")
    return Yard(
        name=path.stem,
        size_m=(float(size[0]), float(size[1])),
        spots=np.array(spots),
        kinds=tuple(kinds),
        pillars=np.array(pillars).reshape(-1, 3),
    )


def _row(table: dict[str, Any], where: str) -> tuple[list[list[float]], str]:
    """Poses of one table of spots, and their kind: as many as it says, side by side from left to right or down."""
    kind = table.get("kind")
    if kind not in KINDS:
        raise SiteFileError(f"{where}.kind is {shown(kind)}; valid: {', '.join(KINDS)}")
    x, y, heading_deg = _numbers(table, _SPOT, ("x", "y", "heading_deg"), where)
    count, step = table.get("count", 1), table.get("step_m", [0.0, 0.0])
    if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= _MOST_SPOTS:
        raise SiteFileError(f"{where}.count is {shown(count)}; valid: an integer from 1 to {_MOST_SPOTS}")
    if not isinstance(step, list) or len(step) != 2 or not all(_is_number(part) for part in step):
        raise SiteFileError(f"{where}.step_m is {shown(step)}; valid: x and y from a spot to the next")
    yaw = math.radians(heading_deg)
    return [[x + k * step[0], y + k * step[1], yaw] for k in range(count)], str(kind)


def _tables(content: dict[str, Any], key: str, where: str) -> list[dict[str, Any]]:
    tables = content.get(key, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise SiteFileError(f"{where}: {key} is {shown(tables)}; valid: tables [[{key}]]")
    return tables


def _numbers(table: dict[str, Any], known: set[str], keys: tuple[str, ...], where: str) -> list[float]:
    if unknown := sorted(table.keys() - known):
        raise SiteFileError(f"{where}: unknown entry {shown(unknown[0])}; valid: {', '.join(sorted(known))}")
    for key in keys:
        if not _is_number(table.get(key)):
            raise SiteFileError(f"{where}.{key} is {shown(table.get(key))}; valid: a number")
    return [float(table[key]) for key in keys]


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= sys.float_info.max  # `isfinite` raises of integers that no float can hold
