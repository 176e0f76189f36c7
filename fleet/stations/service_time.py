"""ServiceTimes: how long a station's arm is taken by one transfer, learnt while the run goes on."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from fleet.robots.arms.spec import UsualService

N_RECENT_TRANSFERS = 32
"""Transfers that count: few enough to notice within minutes that an arm has become slow."""
N_LAST_TRANSFERS = 4
"""Transfers that tell how long the one under way will take."""
PRIOR_MEAN_S = 7.0
"""Mean of a transfer where no model of arm is known [s]: on shipped sites with suction means were 6.5 to 7.1 s."""


class Direction(StrEnum):
    """Which way the parcel goes."""

    TO_CAR = "to_car"
    FROM_CAR = "from_car"


@dataclass
class ServiceTime:
    """Mean and 90th percentile of the last `N_RECENT_TRANSFERS` samples.

    The window bounds the memory, and old samples leave it in the order they came, so equal runs learn the same. The
    percentile is the nearest rank: the smallest sample that at least 90 % of the window do not exceed.
    """

    mean_s: float
    """Mean [s]; that of the arm's model before the first sample."""
    p90_s: float
    """90th percentile [s]; that of the arm's model before the first sample."""
    recent_s: float
    """Mean of the last `N_LAST_TRANSFERS` samples [s]: what an arm does that has just become slow, or quick again."""
    n: int = 0
    """Samples ever taken."""
    _window: deque[float] = field(default_factory=deque)
    _sorted: list[float] = field(default_factory=list)

    @classmethod
    def before(cls, usual: UsualService) -> ServiceTime:
        """Before the first transfer."""
        return cls(mean_s=usual.mean_s, p90_s=usual.p90_s, recent_s=usual.mean_s)

    def add(self, took_s: float) -> None:
        """Learn from one transfer."""
        self.n += 1
        self._window.append(took_s)
        insort(self._sorted, took_s)
        if len(self._window) > N_RECENT_TRANSFERS:
            del self._sorted[bisect_left(self._sorted, self._window.popleft())]
        recent = list(self._window)[-N_LAST_TRANSFERS:]
        self.mean_s = math.fsum(self._sorted) / len(self._sorted)
        self.p90_s = self._sorted[math.ceil(0.9 * len(self._sorted)) - 1]
        self.recent_s = math.fsum(recent) / len(recent)


@dataclass
class _Running:
    direction: Direction
    since_s: float
    complete: bool = False


class ServiceTimes:
    """Service times of all arms, in each direction.

    A service lasts from the moment the car stands ready at the dock until the arm is home again and could serve the
    next one, repeated attempts included; one whose parcel did not arrive teaches nothing.

    Args:
        usual: What is known of the model of each arm.
    """

    def __init__(self, usual: Sequence[UsualService]) -> None:
        self._n_arms = len(usual)
        self._learnt = [{direction: ServiceTime.before(own) for direction in Direction} for own in usual]
        self._running: dict[int, _Running] = {}

    def of(self, arm: int, direction: Direction) -> ServiceTime:
        """What has been learnt about an arm."""
        return self._learnt[arm][direction]

    def begin(self, arm: int, direction: Direction, now_s: float) -> None:
        """A car stands ready at the dock and the arm is asked."""
        self._running[arm] = _Running(direction, now_s)

    def complete(self, arm: int) -> None:
        """The parcel is where it should be; the arm may still be on its way home."""
        if arm in self._running:
            self._running[arm].complete = True

    def end(self, arm: int, now_s: float) -> None:
        """The arm is home, and done with the car."""
        running = self._running.pop(arm, None)
        if running is not None and running.complete:
            self._learnt[arm][running.direction].add(now_s - running.since_s)

    def left_s(self, arm: int, now_s: float) -> float:
        """Time until the arm is likely to be free [s]; 0 when it is, and when it should have been already."""
        running = self._running.get(arm)
        if running is None:
            return 0.0
        return max(0.0, self.of(arm, running.direction).recent_s - (now_s - running.since_s))

    def each_left_s(self, arms: npt.NDArray[np.int64], now_s: float) -> npt.NDArray[np.float64]:
        """What `left_s` says of some arms, shape (k,) [s]."""
        return np.array([self.left_s(arm, now_s) for arm in arms.tolist()])

    def all_left_s(self, now_s: float) -> npt.NDArray[np.float64]:
        """What `left_s` says of each arm, shape (n_arms,) [s]."""
        left_s = np.zeros(self._n_arms)
        for arm in self._running:
            left_s[arm] = self.left_s(arm, now_s)
        return left_s
