"""RobotWaits: the waits of robots in a run, each as long as it took, whatever it was for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from fleet.arrays import BoolArray
from fleet.insight.cause_log import ROBOT, TICK, CauseLog
from fleet.insight.causes import HOLDS_UP, Column
from fleet.insight.codebook import Codebook

LEAST_S = 1.0
"""Shorter waits are in the sums, but not in the list [s]."""
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
    of_cars = (wait for wait in waits(log, codebook) if wait.robot.startswith("car"))
    return max(of_cars, key=lambda wait: (wait.lasts_s, -wait.from_s), default=None)


def waits(log: CauseLog, codebook: Codebook) -> Iterator[RobotWait]:
    """All waits of a second or more, robot by robot."""
    in_order = log.since(0)
    by_robot = in_order[np.argsort(in_order[:, ROBOT], kind="stable")]
    firsts = np.searchsorted(by_robot[:, ROBOT], np.arange(len(codebook.robots) + 1))
    for robot, begin, end in zip(codebook.robots, firsts[:-1].tolist(), firsts[1:].tolist(), strict=True):
        changes = by_robot[begin:end]
        ends = np.append(changes[1:, TICK], log.end_tick)
        waiting = HOLDS_UP[changes[:, _FIRST + Column.CAUSE]]
        for first, last in _stretches(waiting):
            from_tick, to_tick = int(changes[first, TICK]), int(ends[last - 1])
            if (to_tick - from_tick) * codebook.tick_s < LEAST_S:
                continue
            # Told as it was for the longest part of the wait, in the middle of that part.
            longest = first + int(np.argmax(ends[first:last] - changes[first:last, TICK]))
            at = (int(changes[longest, TICK]) + int(ends[longest]) - 1) // 2
            yield RobotWait(robot, from_tick * codebook.tick_s, to_tick * codebook.tick_s, (at + 0.5) * codebook.tick_s)


def _stretches(flags: BoolArray) -> list[tuple[int, int]]:
    """Beginnings and ends of stretches of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
