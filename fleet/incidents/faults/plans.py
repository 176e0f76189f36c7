"""Faults of the path planner: late, or none at all."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.config import ScenarioEvent
from fleet.run.view import RunView


class PlansLate:
    """Plans land later than usual."""

    def __init__(self, run: RunView) -> None:
        self._run = run

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        del targets
        self._run.traffic.delay(event.value("delay_s"))
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        del targets
        self._run.traffic.delay(0.0)


class PlansLost:
    """The path planner answers nothing, as if it was killed and has to be started again."""

    def __init__(self, run: RunView) -> None:
        self._run = run

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        del event, targets
        self._run.traffic.silence(True)
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        del targets
        self._run.traffic.silence(False)
