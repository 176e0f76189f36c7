"""Recent: what is asked again soon is not found again."""

from __future__ import annotations

import pytest

from fleet.stations.arms.recent import Recent


def test_the_last_questions_are_known_and_older_ones_are_met_again() -> None:
    asked: list[str] = []
    recent: Recent[str] = Recent(2)

    def answer(question: str) -> str:
        return recent.of(question, lambda: (asked.append(question), question.upper())[1])

    assert [answer(question) for question in "abaca"] == list("ABACA")
    assert asked == list("abc")
    answer("b")
    assert asked == list("abcb"), "the one not asked for longest was forgotten"


def test_an_error_is_no_answer() -> None:
    recent: Recent[int] = Recent(2)
    with pytest.raises(ZeroDivisionError):
        recent.of("a", lambda: 1 // 0)
    assert recent.of("a", lambda: 1) == 1
