"""CauseLog: one that forgets tells of the last changes what one that keeps all tells."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.insight.cause_log import ROBOT, TICK, CauseLog
from fleet.insight.causes import NONE, Column

N_ROBOTS, N_TICKS, KEEPS = 5, 400, 40


def lives(log: CauseLog, robot: int, tick: int) -> list[list[int]]:
    """What a robot was about in a tick and before, as far as the log knows."""
    number, found = log.number(robot, tick), []
    while number != NONE:
        found.append(log.change(number))
        number = log.before(number)
    return found


@pytest.fixture
def logs() -> tuple[CauseLog, CauseLog]:
    rng = np.random.default_rng(3)
    full, short = CauseLog(N_ROBOTS), CauseLog(N_ROBOTS, KEEPS)
    rows = np.zeros((N_ROBOTS, len(Column)), dtype=np.int32)
    for tick in range(N_TICKS):
        robot = 0 if tick == 0 else int(rng.integers(1, N_ROBOTS))  # robot 0 stays as it is
        rows[robot] = rng.integers(0, 9, len(Column))
        for log in (full, short):
            log.append(tick, rows)
    return full, short


def test_it_is_bounded_and_counts_on(logs: tuple[CauseLog, CauseLog]) -> None:
    full, short = logs
    assert len(short) == len(full) > 5 * KEEPS
    assert KEEPS <= len(short.since(0)) <= 2 * KEEPS + N_ROBOTS


def test_what_is_new_is_the_same(logs: tuple[CauseLog, CauseLog]) -> None:
    full, short = logs
    first = len(full) - KEEPS
    assert short.since(first).tolist() == full.since(first).tolist()
    assert np.array_equal(short.at(N_TICKS), full.at(N_TICKS))


def test_what_is_kept_is_linked(logs: tuple[CauseLog, CauseLog]) -> None:
    full, short = logs
    since = int(full.since(len(full) - KEEPS)[0, TICK])
    for robot in range(N_ROBOTS):
        for tick in range(since, N_TICKS, 7):
            known = lives(short, robot, tick)
            assert known == lives(full, robot, tick)[: len(known)]
            assert known[0][ROBOT] == robot


def test_who_has_not_changed_for_long_is_known(logs: tuple[CauseLog, CauseLog]) -> None:
    full, short = logs
    assert lives(short, 0, N_TICKS) == lives(full, 0, N_TICKS)
