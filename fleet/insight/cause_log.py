"""CauseLog: the causes of all robots over a run, kept where they change."""

from __future__ import annotations

import sys

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


_ALL = sys.maxsize // 2
"""More changes than there can be."""


class CauseLog:
    """Changes of the causes of all robots, in the order of time.

    A change takes 40 bytes; 100 robots in dense traffic make two or three per second each.

    Args:
        n_robots: Number of cars and arms.
        keeps: So many of the last changes are kept at least; None = all. What every robot was about before the first
            of them is kept, too.
    """

    def __init__(self, n_robots: int, keeps: int | None = None) -> None:
        self.n_robots = n_robots
        self._keeps = _ALL if keeps is None else keeps
        self.end_tick = 0
        """Ticks so far."""
        self._n = 0
        self._n_forgotten = 0
        self._table: Changes = np.empty((1024, _WIDTH), dtype=np.int32)
        self._before = np.empty(1024, dtype=np.int32)
        """Number of the same robot's change before each, so that its history is walked without the others."""
        self._newest = np.full(n_robots, NONE, dtype=np.int32)
        self._last = np.full((n_robots, len(Column)), NONE, dtype=np.int32)

    def __len__(self) -> int:
        return self._n_forgotten + self._n

    def append(self, tick: int, rows: CauseRows) -> None:
        """Keep what has changed; ticks come in order, and each comes once."""
        self._make_room(self.n_robots)
        self._n = _append(self._table, self._before, self._newest, self._n, self._last, rows, tick)
        self.end_tick = tick + 1

    def extend(self, changes: Changes, end_tick: int) -> None:
        """Keep changes that are read from a file, in the order of time."""
        self._make_room(len(changes))
        _extend(self._table, self._before, self._newest, self._n, changes)
        self._n += len(changes)
        self.end_tick = max(self.end_tick, end_tick)

    def _make_room(self, n: int) -> None:
        most = self._keeps + max(self._keeps // 4, n)
        if self._n + n > most:
            self._forget(self._n - self._keeps)
        short = self._n + n - len(self._table)
        if short > 0:
            more = max(short, min(len(self._table), most - len(self._table)))
            self._table = np.concatenate([self._table, np.empty((more, _WIDTH), dtype=np.int32)])
            self._before = np.concatenate([self._before, np.empty(more, dtype=np.int32)])

    def _forget(self, n: int) -> None:
        """Forget the first changes, but for the last one of each robot among them."""
        newest_first = self._table[:n][::-1]
        last = n - 1 - np.unique(newest_first[:, ROBOT], return_index=True)[1]
        kept = np.concatenate([np.sort(last), np.arange(n, self._n)])
        place = np.full(self._n + 1, NONE, dtype=np.int32)  # the last entry stands for none
        place[kept] = np.arange(len(kept))
        self._table[: len(kept)] = self._table[kept]
        self._before[: len(kept)] = place[self._before[kept]]
        self._newest = place[self._newest]
        self._n_forgotten += self._n - len(kept)
        self._n = len(kept)

    def since(self, first: int) -> Changes:
        """Changes after so many, as far as they are kept, a view, shape (k, 2 + len(Column))."""
        return self._table[max(0, first - self._n_forgotten) : self._n]

    def at(self, tick: int) -> CauseRows:
        """The row of every robot in a tick; `NONE` throughout for one that has none yet."""
        rows = np.full((self.n_robots, len(Column)), NONE, dtype=np.int32)
        until = int(np.searchsorted(self._table[: self._n, TICK], tick, side="right"))
        newest_first = self._table[:until][::-1]
        robots, newest = np.unique(newest_first[:, ROBOT], return_index=True)
        rows[robots] = newest_first[newest, 2:]
        return rows

    def number(self, robot: int, tick: int) -> int:
        """Number of the change that tells what a robot is about in a tick, `NONE` if it has none yet.

        Numbers hold until the next tick.
        """
        return int(_number(self._table, self._before, self._newest[robot], tick))

    def before(self, number: int) -> int:
        """Number of the change of the same robot before one, `NONE` for the first."""
        return int(self._before[number])

    def change(self, number: int) -> list[int]:
        """Tick, robot, and the columns of `Column`."""
        row: list[int] = self._table[number].tolist()
        return row


@njit(cache=True)
def _append(table, before, newest, n, last, rows, tick):
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
        before[n] = newest[robot]
        newest[robot] = n
        n += 1
    return n


@njit(cache=True)
def _extend(table, before, newest, n, changes):
    for k in range(len(changes)):
        robot = changes[k, ROBOT]
        table[n + k] = changes[k]
        before[n + k] = newest[robot]
        newest[robot] = n + k


@njit(cache=True)
def _number(table, before, newest, tick):
    number = newest
    while number != NONE and table[number, TICK] > tick:
        number = before[number]
    return number
