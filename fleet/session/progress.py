"""Progress: how far a simulation is."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from fleet.run.view import RunView
from fleet.tasks.board import DONE_STATES
from fleet.terminal.progress_bar import Bar


class Progress:
    """Shows how far a run is.

    Args:
        run: The run.
        shown: False shows nothing.
    """

    def __init__(self, run: RunView, *, shown: bool) -> None:
        self._run = run
        self._bar = Bar(len(run.board.tasks), "tasks", shown=shown)

    def say(self, text: str) -> None:
        """Show a line that stays."""
        self._bar.say(text)

    def look(self) -> None:
        """Update what is shown if it is time."""
        if not self._bar.due():
            return
        board, sim_s = self._run.board, self._run.sim_s
        done = sum(map(board.count, DONE_STATES))
        self._bar.show(done, f"{sim_s:7.1f} s", f"{sim_s:8.1f} s simulated, {done} of {len(board.tasks)} tasks done")

    def __enter__(self) -> Self:
        self._bar.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.__exit__(kind, error, trace)
