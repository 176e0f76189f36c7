"""Instances and schedules of CL-CBS: cars on a floor without lanes, in YAML, whose yaw is clockwise.

The instances of CSDO have the same form, a radius for each obstacle, and a yaw that is counter-clockwise.
"""

from __future__ import annotations

import json
import math
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from maps.errors import MapsError
from maps.reading.aliases import check_aliases
from maps.reading.shown import shown
from maps.reading.text_file import FileError, read_text

FloatArray = npt.NDArray[np.float64]

OBSTACLE_RADIUS_M = 0.8
"""Of obstacles for which a file names none, as in CL-CBS's code."""
EXTRA = "pip install '.[open-floor]'"
_VALID = "an instance of CL-CBS with agents and map"
_FURTHEST_M = 100_000.0
_PLAIN = re.compile(r"[A-Za-z0-9_]+")


class ClcbsError(MapsError):
    """An instance is malformed; the message names file and entry."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CarInstance:
    """Cars that go from starts to goals on a rectangle with round obstacles."""

    size_m: tuple[float, float]
    """x and y of the corner opposite to (0, 0) [m]."""
    names: tuple[str, ...]
    """Of the cars."""
    starts: FloatArray
    """Poses of the rear axle, x, y [m], yaw [rad, counter-clockwise], shape (n, 3)."""
    goals: FloatArray
    """As `starts`."""
    discs: FloatArray
    """Obstacles: x, y and radius [m], shape (k, 3)."""


def read_car_instance(path: str | os.PathLike[str], *, clockwise: bool = True) -> CarInstance:
    """Read an instance.

    Args:
        path: The file.
        clockwise: Whether yaw in the file is, as in CL-CBS; in CSDO it is not.

    Returns:
        The instance; obstacles with a negative place, which stand for none, are left out.

    Raises:
        ClcbsError: The file cannot be read, an entry is missing or no number, or PyYAML is not installed.

    Source: the files in `benchmark` of https://github.com/APRIL-ZJU/CL-CBS and the place where its code reads them.
    """
    where = str(path)
    content = _parsed(path)
    agents, floor = content.get("agents"), content.get("map")
    if not isinstance(agents, list) or not agents:
        raise ClcbsError(f"{where}: agents is {shown(agents)}; valid: a list of agents")
    if not isinstance(floor, dict):
        raise ClcbsError(f"{where}: map is {shown(floor)}; valid: dimensions and obstacles")
    size = _numbers(floor.get("dimensions"), f"{where}: map.dimensions", (2,))
    if min(size) <= 0:
        raise ClcbsError(f"{where}: map.dimensions is {shown(size)}; valid: two lengths > 0")
    starts, goals = [], []
    names: list[str] = []
    for number, agent in enumerate(agents):
        at = f"{where}: agents[{number}]"
        if not isinstance(agent, dict):
            raise ClcbsError(f"{at} is {shown(agent)}; valid: name, start and goal")
        name = str(agent.get("name", f"agent{number}"))
        if name in names:
            raise ClcbsError(f"{at}.name is {shown(name)}, as of agents[{names.index(name)}]; valid: a name of its own")
        names.append(name)
        starts.append(_numbers(agent.get("start"), f"{at}.start", (3,)))
        goals.append(_numbers(agent.get("goal"), f"{at}.goal", (3,)))
    obstacles = floor.get("obstacles") or []
    if not isinstance(obstacles, list):
        raise ClcbsError(f"{where}: map.obstacles is {shown(obstacles)}; valid: a list of [x, y] or [x, y, radius]")
    discs = []
    for number, obstacle in enumerate(obstacles):
        at = f"{where}: map.obstacles[{number}]"
        disc = [*_numbers(obstacle, at, (2, 3)), OBSTACLE_RADIUS_M][:3]
        if disc[2] <= 0:
            raise ClcbsError(f"{at} has radius {disc[2]}; valid: a radius > 0")
        if disc[0] >= 0 and disc[1] >= 0:
            discs.append(disc)
    turn = np.array([1.0, 1.0, -1.0 if clockwise else 1.0])
    return CarInstance(
        size_m=(size[0], size[1]),
        names=tuple(names),
        starts=np.array(starts) * turn,
        goals=np.array(goals) * turn,
        discs=np.array(discs).reshape(-1, 3),
    )


def write_schedule(
    path: str | os.PathLike[str], names: tuple[str, ...], poses: FloatArray, *, clockwise: bool = True
) -> None:
    """Write where cars are after each step, as CL-CBS writes it.

    Args:
        path: The file.
        names: Of the cars.
        poses: x, y, yaw of each car after each step, shape (n, steps + 1, 3).
        clockwise: Whether yaw is to be, as in CL-CBS.

    Raises:
        OSError: The file cannot be written.
    """
    lines = ["statistics:", f"  makespan: {poses.shape[1] - 1}", "schedule:"]
    for name, way in zip(names, poses.tolist(), strict=True):
        # Plain where that is enough, as CL-CBS writes it.
        lines.append(f"  {name if _PLAIN.fullmatch(name) else json.dumps(name, ensure_ascii=False)}:")
        for t, (x, y, yaw) in enumerate(way):
            turned = math.remainder(-yaw if clockwise else yaw, 2 * math.pi)
            lines += [f"    - x: {x:.6f}", f"      y: {y:.6f}", f"      yaw: {turned:.6f}", f"      t: {t}"]
    Path(path).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def _parsed(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The mapping at the root of a YAML file."""
    try:
        import yaml
    except ImportError as error:
        raise ClcbsError(f"{path}: PyYAML is not installed, which reads it; valid: {EXTRA}") from error
    try:
        text = read_text(path, str(path), valid=_VALID)
        content = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        check_aliases(content)
    except FileError as error:
        raise ClcbsError(str(error)) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = "" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: "
        raise ClcbsError(f"{path}: {place}is no YAML; valid: {_VALID}") from error
    if not isinstance(content, dict):
        raise ClcbsError(f"{path}: is {shown(content)}; valid: {_VALID}")
    return content


def _numbers(value: object, where: str, lengths: tuple[int, ...]) -> list[float]:
    """A list of so many numbers."""
    valid = f"{' or '.join(map(str, lengths))} numbers up to {_FURTHEST_M:g}"
    if not isinstance(value, list) or len(value) not in lengths:
        raise ClcbsError(f"{where} is {shown(value)}; valid: {valid}")
    for number in value:
        sound = isinstance(number, int | float) and not isinstance(number, bool)
        if not sound or not abs(number) <= _FURTHEST_M:
            raise ClcbsError(f"{where} is {shown(value)}; valid: {valid}")
    return [float(number) for number in value]
