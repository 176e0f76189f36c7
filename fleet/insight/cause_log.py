"""CauseLog: the causes of all robots over a run, kept where they change."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.insight.causes import NONE, CauseRows, Column

SLACK_TICKS = 2
"""An end that moves by no more than this is the same end: steps of an arm end between two ticks."""
TICK, ROBOT = 0, 1
"""Columns of a change before those of `Column`."""
_WIDTH = 2 + len(Column)
_UNTIL = int(Column.UNTIL)

Changes = npt.NDArray[np.int32]
"""Tick, robot, and then the columns of `Column`; shape (k, 2 + len(Column))."""


class CauseLog:
    """Changes of the causes of all robots, in the order of time.

    A change takes 36 bytes; 100 robots in dense traffic make two or three per second each.

    Args:
        n_robots: Number of cars and arms.
    """

    def __init__(self, n_robots: int) -> None:
        self.n_robots = n_robots
        self.end_tick = 0
        """Ticks so far."""
        self._n = 0
        self._table: Changes = np.empty((1024, _WIDTH), dtype=np.int32)
        self._last = np.full((n_robots, len(Column)), NONE, dtype=np.int32)

    def __len__(self) -> int:
        return self._n

    def append(self, tick: int, rows: CauseRows) -> None:
        """Keep what has changed; ticks come in order, and each comes once."""
        if self._n + self.n_robots > len(self._table):
            self._table = np.concatenate([self._table, np.empty_like(self._table)])
        self._n = _append(self._table, self._n, self._last, rows, tick)
        self.end_tick = tick + 1

    def extend(self, changes: Changes, end_tick: int) -> None:
        """Keep changes that are read from a file, those of one robot in order."""
        short = self._n + len(changes) - len(self._table)
        if short > 0:
            more = np.empty((max(short, len(self._table)), _WIDTH), dtype=np.int32)
            self._table = np.concatenate([self._table, more])
        self._table[self._n : self._n + len(changes)] = changes
        self._n += len(changes)
        self.end_tick = max(self.end_tick, end_tick)

    def since(self, first: int) -> Changes:
        """Changes from a number on, a view, shape (k, 2 + len(Column))."""
        return self._table[first : self._n]

    def at(self, tick: int) -> CauseRows:
        """The row of every robot in a tick; `NONE` throughout for one that has none yet."""
        rows = np.full((self.n_robots, len(Column)), NONE, dtype=np.int32)
        until = int(np.searchsorted(self._table[: self._n, TICK], tick, side="right"))
        newest_first = self._table[:until][::-1]
        robots, newest = np.unique(newest_first[:, ROBOT], return_index=True)
        rows[robots] = newest_first[newest, 2:]
        return rows

    def of(self, robot: int, tick: int | None = None) -> Changes:
        """Changes of one robot, up to a tick if one is given, shape (k, 2 + len(Column))."""
        table = self._table[: self._n]
        if tick is not None:
            table = table[: int(np.searchsorted(table[:, TICK], tick, side="right"))]
        return table[table[:, ROBOT] == robot]


@njit(cache=True)
def _append(table, n, last, rows, tick):
    for robot in range(len(rows)):
        same = True
        for k in range(rows.shape[1]):
            away = abs(rows[robot, k] - last[robot, k])
            if away > (SLACK_TICKS if k == _UNTIL and rows[robot, k] >= 0 and last[robot, k] >= 0 else 0):
                same = False
        if same:
            continue
        table[n, 0] = tick
        table[n, 1] = robot
        for k in range(rows.shape[1]):
            table[n, 2 + k] = rows[robot, k]
            last[robot, k] = rows[robot, k]
        n += 1
    return n
