"""Waits: the waits of a run with their explanations, and where cars were meanwhile."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.insight.cause_log import ROBOT, TICK
from fleet.insight.causes import NONE, Cause, CauseRows, Column
from fleet.insight.explain import explain
from fleet.insight.robot_waits import waits
from fleet.recording.trace_file import Quantity
from fleet.report.loaded_run import Run
from fleet.report.table import Table, table

GROUPS: dict[str, frozenset[Cause]] = {
    "traffic": frozenset({Cause.CELL, Cause.TURN, Cause.YIELDS}),
    "station": frozenset(
        {Cause.CLOSED, Cause.STATION_FULL, Cause.ARM_BUSY, Cause.ARM, Cause.SLOT, Cause.CHARGER, Cause.OTHER_ARM}
    ),
    "plan": frozenset({Cause.PLAN_LATE}),
    "blocked": frozenset({Cause.BLOCKED, Cause.HALTED}),
}
"""What a wait is due to, in a word."""
_FIRST = 2
"""Column of a change of causes at which those of `Column` begin."""


def waits_of(run: Run) -> Table:
    """Waits of a second or more, each with its explanation, in the order in which they began."""
    log, codebook = run.causes, run.codebook
    found = []
    for wait in waits(log, codebook):
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
