"""Bar: how far something is, as a bar on a terminal and as plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as RichProgress

LINE_S = 5.0
"""Wall time between two plain lines [s]."""
BAR_S = 0.2
"""Wall time between two updates of the bar [s]."""


class Bar:
    """A bar that is drawn within `with`.

    Args:
        total: Number at which it is full.
        unit: What is counted.
        shown: False shows nothing.
    """

    def __init__(self, total: int, unit: str, *, shown: bool) -> None:
        self._console = Console(file=sys.stdout, markup=False, emoji=False, highlight=False)
        self._shown = shown
        self._bar: RichProgress | None = None
        self._next = 0.0
        self._line = ""
        if shown and self._console.is_terminal:
            self._bar = RichProgress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn(f"{{task.completed:.0f}}/{{task.total:.0f}} {unit}"),
                console=self._console,
                transient=True,
            )
            self._task = self._bar.add_task("starting", total=total)

    def say(self, text: str) -> None:
        """Show a line that stays."""
        if self._shown:
            self._console.print(text, soft_wrap=True)

    def due(self) -> bool:
        """Whether it is time to `show` again."""
        now = time.perf_counter()
        if not self._shown or now < self._next:
            return False
        self._next = now + (LINE_S if self._bar is None else BAR_S)
        return True

    def show(self, done: int, beside: str, line: str) -> None:
        """Show how far it is.

        Args:
            done: How much of the total.
            beside: Text beside the bar.
            line: What to print where there is no bar, unless it was the last one printed.
        """
        if self._bar is not None:
            self._bar.update(self._task, completed=done, description=beside)
        elif line != self._line:
            self._line = line
            self._console.print(line)

    def __enter__(self) -> Self:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
