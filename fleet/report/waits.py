"""Waits: the waits of a run with their explanations, and where cars were meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from fleet.arrays import BoolArray, FloatArray, IntArray
from fleet.insight.cause_log import ROBOT, TICK, CauseLog
from fleet.insight.causes import NONE, OWN, Cause, CauseRows, Column
from fleet.insight.codebook import Codebook
from fleet.insight.explain import explain
from fleet.recording.trace_file import Quantity
from fleet.report.loaded_run import Run
from fleet.report.table import Table, table

LEAST_S = 1.0
"""Shorter waits are in the sums, but not in the list [s]."""
GROUPS: dict[str, frozenset[Cause]] = {
    "traffic": frozenset({Cause.CELL, Cause.TURN, Cause.YIELDS}),
    "station": frozenset(
        {Cause.CLOSED, Cause.STATION_FULL, Cause.ARM_BUSY, Cause.ARM, Cause.SLOT, Cause.CHARGER, Cause.OTHER_ARM}
    ),
    "plan": frozenset({Cause.PLAN_LATE}),
    "blocked": frozenset({Cause.BLOCKED, Cause.HALTED}),
}
"""What a wait is due to, in a word."""
_WAITS = np.array([cause not in OWN for cause in Cause])
_FIRST = 2
"""Column of a change of causes at which those of `Column` begin."""


class RobotWait(NamedTuple):
    """One wait of a robot."""

    robot: str
    from_s: float
    """When it began, in simulated time [s]."""
    to_s: float
    """When it was over, or the run [s]."""
    at_s: float
    """The middle of its longest part, at which it is told [s]."""

    @property
    def lasts_s(self) -> float:
        """How long it took [s]."""
        return self.to_s - self.from_s


def longest_wait(log: CauseLog, codebook: Codebook) -> RobotWait | None:
    """The longest wait of a car, of equal ones the first; None if none waited for a second."""
    waits = (wait for wait in _waits(log, codebook) if wait.robot.startswith("car"))
    return max(waits, key=lambda wait: (wait.lasts_s, -wait.from_s), default=None)


def waits_of(run: Run) -> Table:
    """Waits of a second or more, each with its explanation, in the order in which they began."""
    log, codebook = run.causes, run.codebook
    found = []
    for wait in _waits(log, codebook):
        told = explain(log, codebook, wait.robot, wait.at_s)
        link = told.chain[0]
        row, col = link.cell if link.cell is not None else (None, None)
        found.append(
            (
                wait.robot,
                round(wait.from_s, 6),
                round(wait.to_s, 6),
                round(wait.lasts_s, 6),
                link.cause.name.lower(),
                link.by,
                told.root.robot if not told.cycle else "a circle",
                link.place,
                row,
                col,
                round(wait.at_s, 3),
                str(told),
                told.release,
            )
        )
    found.sort(key=lambda wait: (wait[1], wait[0]))
    heads = ("robot", "from_s", "to_s", "seconds", "cause", "by", "root", "place", "row", "col", "at_s", "explanation")
    return table("waits", (*heads, "release"), found)


def _waits(log: CauseLog, codebook: Codebook) -> Iterator[RobotWait]:
    """All waits of a second or more, robot by robot."""
    for number, robot in enumerate(codebook.robots):
        changes = log.of(number)
        ends = np.append(changes[1:, TICK], log.end_tick)
        waiting = _WAITS[changes[:, _FIRST + Column.CAUSE]]
        for first, last in _stretches(waiting):
            from_tick, to_tick = int(changes[first, TICK]), int(ends[last - 1])
            if (to_tick - from_tick) * codebook.tick_s < LEAST_S:
                continue
            # Told as it was for the longest part of the wait, in the middle of that part.
            longest = first + int(np.argmax(ends[first:last] - changes[first:last, TICK]))
            at = (int(changes[longest, TICK]) + int(ends[longest]) - 1) // 2
            yield RobotWait(robot, from_tick * codebook.tick_s, to_tick * codebook.tick_s, (at + 0.5) * codebook.tick_s)


def standing_of(run: Run) -> dict[str, FloatArray]:
    """Time that cars stood and waited in each cell, for each of `GROUPS` [s], shape (n_cells,)."""
    codebook = run.codebook
    n_cells = len(run.trace.plan) * codebook.cols
    stood = {group: np.zeros(n_cells) for group in GROUPS}
    group_of = np.full(len(Cause), NONE)
    for number, causes in enumerate(GROUPS.values()):
        group_of[list(causes)] = number
    names = list(GROUPS)
    for rows, lasts, cells in _sweep(run):
        groups = group_of[rows[: codebook.n_cars, Column.CAUSE]]
        for car in np.flatnonzero((groups != NONE) & (cells >= 0)).tolist():
            stood[names[groups[car]]][cells[car]] += lasts
    return stood


def _sweep(run: Run) -> Iterator[tuple[CauseRows, float, IntArray]]:
    """Go through the run: causes of all robots, how long nothing changed [s], and the cell each car was in."""
    log, codebook, trace = run.causes, run.codebook, run.trace
    causes = log.since(0)
    moves = trace.changes[(trace.changes["quantity"] == Quantity.CELL) & (trace.changes["robot"] < trace.n_cars)]
    ticks = np.union1d(causes[:, TICK], moves["tick"])
    ends = np.append(ticks[1:], log.end_tick)
    cause_at = np.searchsorted(causes[:, TICK], ticks, side="right")
    move_at = np.searchsorted(moves["tick"], ticks, side="right")
    rows = np.full((log.n_robots, len(Column)), NONE, dtype=np.int32)
    rows[:, Column.CAUSE] = Cause.SETS_OFF
    cells = np.full(trace.n_cars, NONE, dtype=np.int64)
    a = b = 0
    for tick, end, next_a, next_b in zip(*(x.tolist() for x in (ticks, ends, cause_at, move_at)), strict=True):
        rows[causes[a:next_a, ROBOT]] = causes[a:next_a, _FIRST:]
        cells[moves["robot"][b:next_b]] = moves["value"][b:next_b]
        a, b = next_a, next_b
        if end > tick:
            yield rows, (end - tick) * codebook.tick_s, cells


def _stretches(flags: BoolArray) -> list[tuple[int, int]]:
    """Beginnings and ends of stretches of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
