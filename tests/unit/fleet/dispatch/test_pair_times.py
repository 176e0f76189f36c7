"""Times of pairs: the way, the waits at both ends, and what is not allowed."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.dispatch.pair_times import LONG_WAIT_COST, CarSide, PairTimes, TaskSide, pair_times
from fleet.dispatch.situation import CAN_TAKE
from fleet.missions.admission import CALL_EARLY_S
from fleet.missions.turns import ArmPace, TakenTurns, free_times
from fleet.missions.ways import MOVE_S
from fleet.tasks.reasons import CODE_OF_REASON, PairReason

NO_WAY = CODE_OF_REASON[PairReason.NO_WAY]
COMES_S = np.array([6.0, 15.0, 21.0])
"""When each of three cars can be where both tasks begin [s]."""


def times(codes: np.ndarray, *, pick: int = 0, own: int = -1, early_s: float = 0.0) -> PairTimes:
    """The arm of station 0 is taken from 5 s and that of station 1 from 30 s and 38 s on."""
    turns = TakenTurns(np.array([0, 1, 3]), np.array([5.0, 30.0, 38.0]), ArmPace(np.array([10.0, 8.0]), np.zeros(2)))
    ends = np.full(2, pick), np.full(2, 1 if pick == 0 else -1)
    tasks = TaskSide(np.zeros(2, dtype=np.int64), *ends, np.array([6.0, 40.0]), np.array([0.0, 20.0]))
    cars = CarSide(COMES_S - 2 * MOVE_S, np.array([own, -1, -1]), np.array([early_s, 0.0, 0.0]))
    return pair_times(np.full((1, 3), 2.0), codes, cars, tasks, free_times(turns))


ALL = np.full((2, 3), CAN_TAKE, dtype=np.int8)


def test_waits_at_both_ends_count() -> None:
    found = times(ALL)
    # The first is picked at 15 s, comes at 31 s to be unloaded at 46 s; the third is picked at once and comes at 37 s.
    assert found.travel_s[0] == pytest.approx(COMES_S + np.array([9.0 + 15.0, 0.0 + 15.0, 0.0 + 9.0]))
    # Of the second task others come first until 20 s, and at its end there is nobody any more.
    assert found.travel_s[1] == pytest.approx(COMES_S + np.array([14.0, 5.0, 0.0]))


def test_only_long_waits_are_dear() -> None:
    long_s = np.array([[24.0, 15.0, CALL_EARLY_S], [14.0, CALL_EARLY_S, CALL_EARLY_S]]) - CALL_EARLY_S
    assert times(ALL).dear_s == pytest.approx(LONG_WAIT_COST * long_s)


def test_the_turn_that_a_car_has_does_not_keep_it() -> None:
    found = times(ALL, own=0, early_s=4.0)
    assert found.travel_s[0, 0] == pytest.approx(COMES_S[0] + 4.0)
    assert found.travel_s[1, 0] == pytest.approx(COMES_S[0] + 14.0)


def test_nobody_waits_on_a_visit() -> None:
    assert times(ALL, pick=-1).travel_s == pytest.approx(np.array([COMES_S, COMES_S]))


def test_pairs_that_are_not_allowed_take_for_ever() -> None:
    codes = ALL.copy()
    codes[1, 2] = NO_WAY
    found = times(codes)
    assert np.isinf(found.travel_s).tolist() == [[False, False, False], [False, False, True]]
    assert found.dear_s[1, 2] == 0.0
