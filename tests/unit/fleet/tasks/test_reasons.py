"""How the cars were judged for a task is told when it is asked for, also after later rounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from fleet.tasks import reasons
from fleet.tasks.board import Task
from fleet.tasks.reasons import CODE_OF_REASON, Decision, PairReason, ReasonBook
from tests.unit.fleet.missions.floor import Floor, delivery


@dataclass
class Round:
    """A round in which every car was judged alike."""

    tasks: list[Task]
    time_s: float
    n_asked: int = 0

    def decisions(self, columns: list[int]) -> list[Decision]:
        """The verdicts on one car, told apart by their costs."""
        self.n_asked += len(columns)
        return [
            Decision(
                time_s=self.time_s,
                codes=np.array([CODE_OF_REASON[PairReason.CHOSEN]], dtype=np.int8),
                cars=np.array([0]),
                cost_s=np.array([10.0 * self.time_s + column]),
                took=np.array([self.tasks[column].index]),
                name_of=str,
                taker=0,
            )
            for column in columns
        ]


def test_the_last_round_that_considered_a_task_tells() -> None:
    floor = Floor(orders=[delivery(name) for name in "abc"])
    a, b, c = (floor.task(name) for name in "abc")
    book = ReasonBook(lambda *args, **facts: None)
    first, second = Round([a, b], 1.0), Round([b, c], 2.0)
    assert book.report(a).pairs == ()
    book.keep(first)
    assert first.n_asked == 0
    assert [book.report(b).pairs[0].cost_s for _ in range(2)] == [11.0, 11.0]
    assert first.n_asked == 1, "told once"
    book.keep(second)
    assert [book.report(task).pairs[0].cost_s for task in (a, b, c)] == [10.0, 20.0, 21.0]
    book.keep(Round([a], 3.0))
    assert [book.report(task).pairs[0].cost_s for task in (a, b, c)] == [30.0, 20.0, 21.0]
    assert book.report(b).decided_s == 2.0


def test_tasks_that_were_judged_long_ago_are_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reasons, "MOST_DECISIONS", 3)
    floor = Floor(orders=[delivery(f"order_{k}") for k in range(8)])
    tasks = [floor.task(f"order_{k}") for k in range(8)]
    book = ReasonBook(lambda *args, **facts: None)
    for time_s, task in enumerate(tasks):
        book.keep(Round([task], float(time_s)))
    known = [book.decision(task) is not None for task in tasks]
    assert known == [False] * 3 + [True] * 5, "three, and the two rounds that are kept whole"
