"""SettingChanges: hands the parts of a run the settings that change while it lasts."""

from __future__ import annotations

from collections import deque

from fleet.run.view import RunView


class SettingChanges:
    """Makes the changes of a configuration at their times, see `fleet.config.CHANGEABLE`.

    Args:
        run: Whose parts are told.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._due = deque(sorted(run.config.changes, key=lambda change: change.time_s))

    def tick(self) -> None:
        """Make what is due."""
        if not self._due or self._due[0].time_s > self._run.sim_s:
            return
        run = self._run
        while self._due and self._due[0].time_s <= run.sim_s:
            change = self._due.popleft()
            run.events.log("setting_changed", setting=change.name, value=change.value)
        config = run.config.as_of(run.sim_s)
        run.assignments.allocation.change(config.allocation)
        run.traffic.change(config.traffic)
        run.executor.change(config.traffic)
        run.dispatcher.rules.interventions.change(config.timeouts)
