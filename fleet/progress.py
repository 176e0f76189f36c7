"""Progress: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as RichProgress

from fleet.simulation import Simulation
from fleet.tasks.board import TaskState

LINE_S = 5.0
"""Wall time between two plain lines [s]."""
BAR_S = 0.2
"""Wall time between two updates of the bar [s]."""


class Progress:
    """Shows how far a run is.

    Args:
        simulation: The run.
        shown: False shows nothing.
    """

    def __init__(self, simulation: Simulation, *, shown: bool) -> None:
        self._simulation = simulation
        self._console = Console(file=sys.stdout, markup=False, emoji=False, highlight=False)
        self._shown = shown
        self._bar: RichProgress | None = None
        self._next = 0.0
        if shown and self._console.is_terminal:
            self._bar = RichProgress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.completed:.0f}/{task.total:.0f} tasks"),
                console=self._console,
                transient=True,
            )
            self._task = self._bar.add_task("starting", total=len(simulation.board.tasks))

    def say(self, text: str) -> None:
        """Show a line that stays."""
        if self._shown:
            self._console.print(text, soft_wrap=True)

    def look(self) -> None:
        """Update what is shown if it is time."""
        now = time.perf_counter()
        if not self._shown or now < self._next:
            return
        self._next = now + (LINE_S if self._bar is None else BAR_S)
        board = self._simulation.board
        done = board.count(TaskState.DELIVERED) + board.count(TaskState.COLLECTED)
        if self._bar is not None:
            self._bar.update(self._task, completed=done, description=f"{self._simulation.sim_s:7.1f} s")
        else:
            self._console.print(f"{self._simulation.sim_s:8.1f} s simulated, {done} of {len(board.tasks)} tasks done")

    def __enter__(self) -> Self:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
