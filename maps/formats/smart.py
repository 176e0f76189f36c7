"""The path files of SMART: one line per agent, the cells it stands in, with or without timesteps."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from maps.errors import MapsError
from maps.reading.shown import shown
from maps.reading.text_file import FileError, read_lines

Cells = npt.NDArray[np.int32]
Order = Literal["xy", "yx"]

_STOP = re.compile(r"\(([^()]*)\)->")
_WITH_TIME = 3
MOST = 1_000_000
"""Greatest row, column and timestep; an agent that stood longer in a file of a few bytes would fill the memory."""


class SmartError(MapsError):
    """A path file is malformed; the message names file, line and field."""


def read_paths(path: str | os.PathLike[str], *, order: Order = "xy") -> Cells:
    """Read a path file.

    A line is ``Agent 0:(x,y,t)->(x,y,t)->`` or ``Agent 0:(x,y)->(x,y)->``; without t there is an entry per timestep.
    An agent stands in its last cell until its next entry, and in the end until the last of all has arrived.

    Args:
        path: The file.
        order: "xy" = column first (their --flip_coord=0), "yx" = row first.

    Returns:
        Row and column of each agent at each timestep, shape (T + 1, n, 2).

    Raises:
        SmartError: The file cannot be read, an agent is missing or out of order, a field is no number, timesteps do
            not rise from 0, or two entries are not the same or neighbouring cells.

    Source: the example files and the server's parser of https://github.com/smart-mapf/smart.
    """
    try:
        lines = read_lines(path, str(path), valid="a path file with 'Agent 0:(x,y,t)->'")
    except FileError as error:
        raise SmartError(str(error)) from error
    agents: list[list[tuple[int, int]]] = []
    for number, line in enumerate(lines, start=1):
        if line.strip():
            agents.append(_agent(f"{path}: line {number}", line.strip(), len(agents), order))
    longest = max((len(cells) for cells in agents), default=0)
    padded = [cells + cells[-1:] * (longest - len(cells)) for cells in agents]
    return np.array(padded, dtype=np.int32).reshape(len(agents), longest, 2).transpose(1, 0, 2).copy()


def write_paths(
    path: str | os.PathLike[str], cells: npt.ArrayLike, *, order: Order = "xy", timesteps: bool = True
) -> None:
    """Write a path file; each agent's entries end where it arrives for the last time.

    Args:
        path: The file.
        cells: Row and column of each agent at each timestep, shape (T + 1, n, 2).
        order: "xy" = column first, "yx" = row first.
        timesteps: Write the timestep of each entry.

    Raises:
        SmartError: The shape is another one.
        OSError: The file cannot be written.
    """
    table = np.asarray(cells)
    if table.ndim != 3 or table.shape[2] != 2:
        raise SmartError(f"{path}: cells have shape {table.shape}; valid: (timesteps + 1, agents, 2)")
    lines = []
    for agent in range(table.shape[1]):
        stops = table[:, agent]
        changes = np.flatnonzero((stops[1:] != stops[:-1]).any(axis=1))
        arrived = int(changes[-1]) + 1 if changes.size else 0
        entries = []
        for t, (row, col) in enumerate(stops[: arrived + 1].tolist()):
            fields = [col, row] if order == "xy" else [row, col]
            entries.append("(" + ",".join(map(str, [*fields, t] if timesteps else fields)) + ")->")
        lines.append(f"Agent {agent}:" + "".join(entries))
    Path(path).write_text("".join(f"{line}\n" for line in lines), encoding="ascii")


def _agent(where: str, line: str, agent: int, order: Order) -> list[tuple[int, int]]:
    """Cells of one agent, one per timestep."""
    head, colon, body = line.partition(":")
    if not colon or head.split() != ["Agent", str(agent)]:
        raise SmartError(f"{where}: begins {shown(head)}; valid: 'Agent {agent}:'")
    if not body.endswith("->"):
        body += "->"
    if not body.strip() or _STOP.sub("", body):
        raise SmartError(f"{where}: {shown(_STOP.sub('', body))} is no entry; valid: (x,y,t)-> or (x,y)->")
    cells: list[tuple[int, int]] = []
    for number, found in enumerate(_STOP.finditer(body), start=1):
        fields = found[1].split(",")
        at = f"{where}, entry {number}"
        try:
            values = [int(field) for field in fields]
        except ValueError:
            raise SmartError(f"{at}: {shown(found[0])}; valid: whole numbers") from None
        if len(values) not in (2, _WITH_TIME):
            raise SmartError(f"{at}: {len(values)} fields; valid: x,y,t or x,y")
        cell = (values[1], values[0]) if order == "xy" else (values[0], values[1])
        time = values[2] if len(values) == _WITH_TIME else len(cells)
        if max(map(abs, cell)) > MOST:
            raise SmartError(f"{at}: cell {shown(cell)} (row, col); valid: numbers up to {MOST}")
        if not len(cells) <= time <= MOST or (not cells and time != 0):
            raise SmartError(f"{at}: timestep {shown(time)}; valid: {f'{len(cells)} to {MOST}' if cells else '0'}")
        if cells and abs(cells[-1][0] - cell[0]) + abs(cells[-1][1] - cell[1]) > 1:
            raise SmartError(f"{at}: {shown(cell)} follows {cells[-1]} (row, col); valid: the same cell or a neighbour")
        cells += cells[-1:] * (time - len(cells))
        cells.append(cell)
    return cells
