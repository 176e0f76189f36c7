"""Rules: what stays of dispatch where a master decides: arms serve, parcels come and go, nobody is sent anywhere."""

from __future__ import annotations

from typing import Protocol

from fleet.dispatch.containment import Containment
from fleet.dispatch.dispatcher import Dispatcher, DispatchRules
from fleet.missions.admission import Admission
from fleet.missions.phases import CarPhase
from fleet.tasks.board import Task


class Commander(Protocol):
    """Decides where cars go."""

    def tick(self, tick: int, now_s: float) -> None:
        """Send cars to goals, and begin services."""


class MasteredDispatcher(Dispatcher):
    """A `Dispatcher` that gives out no tasks: a commander says where cars go and what is done there."""

    def __init__(self, rules: DispatchRules, containment: Containment, tick_s: float) -> None:
        super().__init__(rules, containment, tick_s)
        self.commander: Commander | None = None
        """None = nobody; all cars stay."""

    def tick(self, tick: int, now_s: float) -> None:
        """Collect parcels, let the commander decide, and start or end services."""
        self.rules.slots.collect(now_s)
        self.rules.missions.clear_left()
        if self.commander is not None:
            self.commander.tick(tick, now_s)
        self.rules.docks.tick(tick, now_s)


class MasteredAdmission(Admission):
    """An `Admission` by which a loaded car waits for its next order, instead of setting off to a drop station."""

    def set_off(self, car: int, task: Task, tick: int, now_s: float) -> None:
        """Leave the pick station to others; see `Admission`."""
        del task, tick, now_s
        self._missions.leave(car)
        self._missions.enter(car, CarPhase.TO_DROP)
