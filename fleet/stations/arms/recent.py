"""Recent: answers that were found lately, kept so that the same question is not worked on again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Answer = TypeVar("Answer")


class Recent(Generic[Answer]):
    """The last answers to some kind of question; an error is no answer, and is met again.

    Args:
        most_n: Answers that are kept; of more, the one not asked for longest is forgotten.
    """

    def __init__(self, most_n: int) -> None:
        self._most_n = most_n
        self._answers: dict[Hashable, Answer] = {}  # the one asked for last at the end

    def of(self, question: Hashable, find: Callable[[], Answer]) -> Answer:
        """The answer to a question, found now unless it is known."""
        answer = self._answers.pop(question) if question in self._answers else find()
        self._answers[question] = answer
        if len(self._answers) > self._most_n:
            del self._answers[next(iter(self._answers))]
        return answer
