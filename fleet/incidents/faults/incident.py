"""Incident: what every kind of event can do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from fleet.config import ScenarioEvent


class Incident(Protocol):
    """A kind of event."""

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """Let it happen.

        Args:
            event: What is said of it.
            targets: Numbers of the cars, arms, stations or cells it happens to.

        Returns:
            False, with nothing changed, if it cannot happen yet; it is tried again in the next tick.
        """

    def end(self, targets: Sequence[int]) -> None:
        """End what lasts, as far as that is possible."""


class Once:
    """An event that is over as soon as it has happened."""

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""


class ForEach:
    """An event that can happen at any time, to each of its targets by itself.

    Args:
        begin: Called with each target and the event.
        end: Called with each target when it is over; None = it happens once.
    """

    def __init__(
        self, begin: Callable[[int, ScenarioEvent], object], end: Callable[[int], object] | None = None
    ) -> None:
        self._begin, self._end = begin, end

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        for target in targets:
            self._begin(target, event)
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        if self._end is not None:
            for target in targets:
                self._end(target)
