"""Crew: every agent is worked on once, however many parts there are."""

from __future__ import annotations

import numpy as np
import pytest

from planners.mapf.multi_step.crew import Crew


@pytest.mark.parametrize(("n", "parts"), [(0, 1), (1, 1), (1999, 1), (2000, 2), (4001, 2)])
def test_every_agent_is_worked_on_once(n: int, parts: int) -> None:
    crew, seen, begun = Crew(n), np.zeros(n, dtype=np.int64), []

    def work(begin: int, end: int) -> None:
        begun.append(begin)
        seen[begin:end] += 1

    crew.each(work)
    assert seen.tolist() == [1] * n
    assert len(begun) == parts


def test_what_goes_wrong_in_a_part_is_not_lost() -> None:
    def work(begin: int, end: int) -> None:
        raise ValueError(begin)

    with pytest.raises(ValueError, match="0"):
        Crew(4000).each(work)
