"""Cause file: causes as lines of the run file, and back."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from fleet.errors import FleetError
from fleet.insight.cause_log import CauseLog, Changes
from fleet.insight.causes import DETAILS, NONE, Cause, Column
from fleet.insight.codebook import Codebook
from maps.reading.shown import shown

LEGEND, CAUSES = "causes_legend", "causes"
"""Kinds of the lines."""
VERSION = 1
MOST = 2**16
"""Most cars, arms and columns of a floor."""
_TASK = 1 + int(Column.TASK)


class CauseFileError(FleetError):
    """A run tells no causes, or tells them in another way."""


class CauseWriter:
    """Turns what was logged since the last time into lines of the run file.

    Args:
        log: Of a run that goes on.
        codebook: What its numbers stand for.
    """

    def __init__(self, log: CauseLog, codebook: Codebook) -> None:
        self._log = log
        self._codebook = codebook
        self._written = 0
        self._named: set[int] = set()

    def head(self) -> dict[str, object]:
        """The facts of the line that comes before all others."""
        codebook = self._codebook
        return {
            "version": VERSION,
            "tick_s": codebook.tick_s,
            "cols": codebook.cols,
            "cars": codebook.n_cars,
            "arms": codebook.n_arms,
            "places": codebook.places,
            "columns": ["robot", *(column.name.lower() for column in Column)],
            "causes": [cause.name.lower() for cause in Cause],
            "details": DETAILS,
        }

    def lines(self) -> Iterable[tuple[int, dict[str, object]]]:
        """Ticks with changes since the last call, and the facts of their lines."""
        changes = self._log.since(self._written).tolist()
        self._written = len(self._log)
        rows_of: dict[int, list[list[int]]] = {}
        for tick, *row in changes:
            rows_of.setdefault(tick, []).append(row)
        for tick, rows in rows_of.items():
            fresh = {row[_TASK] for row in rows} - self._named - {NONE}
            self._named |= fresh
            names = {str(task): self._codebook.task_name(task) for task in sorted(fresh)}
            yield tick, {"rows": rows} | ({"tasks": names} if names else {})


def read_causes(events: Iterable[Mapping[str, Any]], where: str) -> tuple[CauseLog, Codebook]:
    """Read causes back.

    Args:
        events: Lines of a run file after the first.
        where: Opens every message, such as the path.

    Returns:
        The causes, and what their numbers stand for. The run ends with the last line that has a tick.

    Raises:
        CauseFileError: There are none, they are of another version, or a line is not as it should be.
    """
    head: Mapping[str, Any] | None = None
    names: dict[int, str] = {}
    changes: list[list[int]] = []
    end_tick = 0
    try:
        for event in events:
            kind = event["kind"]
            end_tick = max(end_tick, int(event["tick"]))
            if kind == LEGEND:
                head = event
            elif kind == CAUSES:
                changes += [[event["tick"], *row] for row in event["rows"]]
                names |= {int(task): _word(name) for task, name in event.get("tasks", {}).items()}
                end_tick = max(end_tick, int(event["tick"]) + 1)
        if end_tick > np.iinfo(np.int32).max:
            raise OverflowError(f"tick {end_tick}")
        if head is None:
            raise CauseFileError(f"{where}: tells no causes; valid: a run of this version of fleet that began")
        _check(head, where)
        _check_sizes(head)
        codebook = Codebook(
            tick_s=float(head["tick_s"]),
            cols=int(head["cols"]),
            n_cars=int(head["cars"]),
            n_arms=int(head["arms"]),
            places=tuple(map(_word, head["places"])),
            task_name=lambda task: names.get(task, f"task {task}"),
        )
        log = CauseLog(codebook.n_cars + codebook.n_arms)
        table = np.array(changes, dtype=np.int32).reshape(-1, 2 + len(Column))
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise CauseFileError(
            f"{where}: causes cannot be read ({shown(str(error))}); valid: a run file as it was written"
        ) from error
    _check_rows(table, codebook, where)
    log.extend(table, end_tick)
    return log, codebook


def _check(head: Mapping[str, Any], where: str) -> None:
    if head["version"] != VERSION:
        raise CauseFileError(f"{where}: causes of version {shown(head['version'])}; valid: {VERSION}")
    known = [cause.name.lower() for cause in Cause]
    if list(head["causes"]) != known or tuple(head["details"]) != DETAILS:
        raise CauseFileError(f"{where}: other causes than this version of fleet knows; valid: a run of this version")


def _check_sizes(head: Mapping[str, Any]) -> None:
    """Refuse numbers that no floor has, with the error of a wrong value: whoever reads causes divides by them."""
    if not 0.0 < float(head["tick_s"]) < math.inf:
        raise ValueError(f"tick_s is {head['tick_s']}")
    for name, least in (("cols", 1), ("cars", 0), ("arms", 0)):
        if not least <= int(head[name]) <= MOST:
            raise ValueError(f"{name} is {head[name]}")


def _word(name: object) -> str:
    if not isinstance(name, str):
        raise TypeError(f"a name is {name!r}")
    return name


def _check_rows(table: Changes, codebook: Codebook, where: str) -> None:
    """Refuse numbers that stand for nothing."""
    n_robots = codebook.n_cars + codebook.n_arms
    highest = {1: n_robots, 2: len(Cause), 2 + Column.BY: n_robots, 2 + Column.DETAIL: len(DETAILS)}
    for column, end in highest.items():
        least = NONE if column == 2 + Column.BY else 0
        wrong = np.flatnonzero((table[:, column] < least) | (table[:, column] >= end))
        if wrong.size:
            tick, value = table[wrong[0], 0], table[wrong[0], column]
            raise CauseFileError(f"{where}: causes of tick {tick}: {value}; valid: {least} to {end - 1}")
    late = np.flatnonzero(np.diff(table[:, 0]) < 0)
    if late.size:
        raise CauseFileError(f"{where}: causes of tick {table[late[0] + 1, 0]} come late; valid: ticks in order")
