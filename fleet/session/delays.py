"""DelayWatch: how much later cars come to where they were sent than they could have."""

from __future__ import annotations

import numpy as np

from fleet.arrays import FloatArray
from fleet.run.view import RunView
from fleet.traffic.drivers import MOVE_S
from planners.mapf.distance_table import UNREACHABLE
from planners.mapf.problem import NO_GOAL

EACH_CAR = 30
"""Fleets up to so many cars have a line for each; in larger ones nobody could tell them apart."""
MEAN, MOST = "mean_delay_s", "most_delay_s"


def delay_names(n_cars: int) -> tuple[str, ...]:
    """Names of the figures of a fleet: one for each car, or two for all."""
    return tuple(f"car_{car}" for car in range(n_cars)) if n_cars <= EACH_CAR else (MEAN, MOST)


class DelayWatch:
    """The delay of each car on the way to its goal, as an observer sees it.

    When a car is sent somewhere it is due after a second for each move of the shortest way, which is what plans hold to
    where nobody is in the way. It is as late as what is left of its way makes it: waits, detours and slow driving add
    up, and a new goal begins with none. Within a move metres count, so turns and docks make a second of difference.

    Args:
        run: The run.
    """

    def __init__(self, run: RunView) -> None:
        n_cars = run.world.n_cars
        self._names = delay_names(n_cars)
        self._run = run
        self._goals = np.full(n_cars, NO_GOAL, dtype=np.int32)
        self._due_s = np.zeros(n_cars)

    def look(self, lines: tuple[FloatArray, ...]) -> FloatArray:
        """The delays now.

        Args:
            lines: Granted polyline ahead of each car [m], each (k, 2).

        Returns:
            Seconds, shape (n_cars,); not a number for a car that has arrived, or has nowhere to go.
        """
        traffic, states = self._run.traffic, self._run.executor.granted_states()
        goals = traffic.goals
        ahead_m = _lengths(lines)
        left = np.full(len(goals), np.nan)
        sent = np.flatnonzero(goals != NO_GOAL)
        if len(sent):
            rows, row = traffic.tables.rows(goals[sent])
            moves = rows[row, states[sent]].astype(np.float64)
            moves[moves >= UNREACHABLE] = np.nan
            left[sent] = moves
        comes_s = self._run.sim_s + (left + ahead_m / self._run.site.grid.cell_m) * MOVE_S
        # A way that was blocked for a while is due from the moment at which it is known again.
        anew = (goals != self._goals) | np.isnan(self._due_s)
        self._goals[anew] = goals[anew]
        self._due_s[anew] = comes_s[anew]
        delays: FloatArray = comes_s - self._due_s
        delays[(left == 0.0) & (ahead_m == 0.0)] = np.nan
        return delays

    def figures(self, lines: tuple[FloatArray, ...]) -> dict[str, float]:
        """The delays now by name: of each car, or mean and most of those that are on their way."""
        delays = self.look(lines)
        if len(delays) > EACH_CAR:
            known = delays[~np.isnan(delays)]
            delays = np.array([known.mean(), known.max()]) if len(known) else np.full(2, np.nan)
        return dict(zip(self._names, delays.tolist(), strict=True))


def _lengths(lines: tuple[FloatArray, ...]) -> FloatArray:
    """Length of each polyline, (k, 2) [m]; all in one go, as each is asked for twice a second."""
    n_points = np.array([len(line) for line in lines], dtype=np.int64)
    points = np.concatenate((*lines, np.zeros((1, 2))))  # one more, so that there is a first one of an empty line too
    way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    ends = np.cumsum(n_points)
    begins = ends - n_points
    lengths: FloatArray = way[np.maximum(ends - 1, begins)] - way[begins]
    return lengths
