"""ThreadWork: a piece of work that goes on in a thread of its own until its result is asked for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Result = TypeVar("Result")


class ThreadWork(Generic[Result]):
    """Work that begins at once.

    Args:
        work: Must not change what anybody reads before `result`.
    """

    def __init__(self, work: Callable[[], Result]) -> None:
        self._work = work
        self._found: list[Result] = []
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="fleet-plan", daemon=True)
        self._thread.start()

    def result(self) -> Result:
        """Wait for the result; raises what the work raised."""
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._found[0]

    def _run(self) -> None:
        try:
            self._found.append(self._work())
        except BaseException as error:
            self._error = error
