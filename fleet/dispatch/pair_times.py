"""Pair times: when each car could be served at both ends of each task, for all pairs of a car and a task at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import FloatArray, IntArray
from fleet.dispatch.fitness import Codes
from fleet.dispatch.situation import CAN_TAKE
from fleet.missions.admission import CALL_EARLY_S
from fleet.missions.turns import FreeTimes, free_turn
from fleet.missions.ways import MOVE_S

LONG_WAIT_COST = 3.0
"""What a second of waiting for an arm costs beyond itself, past the wait that keeps arms from waiting for cars: so a
car goes further to an arm that is idle, rather than to wait as long for one that is not."""


class CarSide(NamedTuple):
    """What is known of cars, shape (n_cars,) each."""

    free_s: FloatArray
    """Time until each can begin [s]."""
    own: IntArray
    """Column of the task that it has and may give away, -1 = none."""
    early_s: FloatArray
    """How long before its turn it comes with that one [s]."""


class TaskSide(NamedTuple):
    """What is known of tasks, shape (n_tasks,) each."""

    begin: IntArray
    """Where each begins: a row of moves."""
    pick: IntArray
    drop: IntArray
    """Stations of both ends, -1 = it is a visit, for which nobody waits."""
    way_s: FloatArray
    """Time on the way between [s]."""
    not_before_s: FloatArray
    """Time before which its pick station cannot begin with it [s]."""


class PairTimes(NamedTuple):
    """Times of all pairs, tasks in the rows, shape (n_tasks, n_cars) each [s]."""

    travel_s: FloatArray
    """Until the car is where the task begins, the waits at both ends counted in; inf = not allowed."""
    dear_s: FloatArray
    """What long waits cost beyond that."""


def pair_times(moves: FloatArray, codes: Codes, cars: CarSide, tasks: TaskSide, free: FreeTimes) -> PairTimes:
    """Find the times of all pairs.

    Args:
        moves: From each car to where tasks begin, shape (n_rows, n_cars).
        codes: `CAN_TAKE` where a pair is allowed, shape (n_tasks, n_cars).
        cars: The cars.
        tasks: The tasks.
        free: What turns arms have left.
    """
    times = PairTimes(np.empty(codes.shape), np.zeros(codes.shape))
    _pair_times(moves, codes, cars, tasks, free, times)
    return times


@njit(cache=True, nogil=True)
def _pair_times(
    moves: FloatArray, codes: Codes, cars: CarSide, tasks: TaskSide, free: FreeTimes, times: PairTimes
) -> None:  # pragma: no cover - compiled
    for k in range(codes.shape[0]):
        pick, drop, begin = tasks.pick[k], tasks.drop[k], tasks.begin[k]
        for car in range(codes.shape[1]):
            if codes[k, car] != CAN_TAKE:
                times.travel_s[k, car] = np.inf
                continue
            comes_s = cars.free_s[car] + moves[begin, car] * MOVE_S
            wait_s = 0.0
            if pick >= 0:
                picked_s = free_turn(free, pick, max(comes_s, tasks.not_before_s[k]))
                arrives_s = picked_s + free.pace.cycle_s[pick] + tasks.way_s[k]
                wait_s = picked_s - comes_s + free_turn(free, drop, arrives_s) - arrives_s
            if cars.own[car] == k:
                # Its own turn does not keep it. Who would take the task over is kept by it: without that brake, tasks
                # of a fleet that sets off at once change hands so often that 300 cars deliver an eighth less.
                wait_s = min(wait_s, cars.early_s[car])
            times.travel_s[k, car] = comes_s + wait_s
            if wait_s > CALL_EARLY_S:
                times.dear_s[k, car] = LONG_WAIT_COST * (wait_s - CALL_EARLY_S)
