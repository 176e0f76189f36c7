"""Recent: answers that were found lately, kept so that the same question is not worked on again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Answer = TypeVar("Answer")


class Recent(Generic[Answer]):
    """The last answers to some kind of question; an error is no answer, and is met again.

    Args:
        n_most: Answers that are kept; of more, the one not asked for longest is forgotten.
    """

    def __init__(self, n_most: int) -> None:
        self._n_most = n_most
        self._answers: dict[Hashable, Answer] = {}  # the one asked for last at the end

    def of(self, question: Hashable, find: Callable[[], Answer]) -> Answer:
        """The answer to a question, found now unless it is known."""
        answer = self._answers.pop(question) if question in self._answers else find()
        self._answers[question] = answer
        if len(self._answers) > self._n_most:
            del self._answers[next(iter(self._answers))]
        return answer
