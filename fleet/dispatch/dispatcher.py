"""Dispatcher: what happens in which order at each tick, from the release of a task to the end of its service."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.dispatch.assignments import Assignments
from fleet.dispatch.containment import Containment
from fleet.dispatch.interventions import Interventions
from fleet.missions.admission import Admission
from fleet.missions.charging import Charging
from fleet.missions.docks import Docks
from fleet.missions.parcels.prefetch import Prefetch
from fleet.missions.parcels.slots import Slots
from fleet.missions.parking import Parking
from fleet.missions.state import Missions
from fleet.missions.visit_queue import VisitQueue
from fleet.missions.visits import Visits
from fleet.tasks.backlog import Backlog

REVIEW_S = 0.5
"""Time between two looks at what cannot go on, and two allocations if tasks or cars have changed [s]."""
PRICE_S = 5.0
"""Longest time between two allocations, as costs change while cars drive, and time from one in which tasks may change
hands to the next [s]."""
CALL_S = 0.25
"""Time between two looks at the cars that are held back [s]."""


@dataclass(frozen=True, kw_only=True)
class DispatchRules:
    """The rules that missions go by."""

    missions: Missions
    backlog: Backlog
    slots: Slots
    visit_queue: VisitQueue
    assignments: Assignments
    interventions: Interventions
    admission: Admission
    docks: Docks
    prefetch: Prefetch
    visits: Visits
    parking: Parking
    charging: Charging | None
    """None = cars have no batteries."""


class Dispatcher:
    """Missions of all cars.

    Args:
        rules: The rules.
        containment: Ends what nobody will be able to do any more.
        tick_s: Length of a tick [s].
    """

    def __init__(self, rules: DispatchRules, containment: Containment, tick_s: float) -> None:
        self.rules = rules
        self._containment = containment
        self._call_period = max(1, round(CALL_S / tick_s))
        self._period = max(1, round(REVIEW_S / tick_s))
        self._price_period = self._period * round(PRICE_S / REVIEW_S)

    def tick(self, tick: int, now_s: float) -> None:
        """Release, collect, allocate, and start or end services."""
        rules, missions = self.rules, self.rules.missions
        rules.slots.collect(now_s)
        missions.changed |= rules.backlog.release(now_s)
        missions.clear_left()
        if tick % self._call_period == 0:
            if rules.charging is not None:
                rules.charging.plug_in()
            rules.admission.call(tick, now_s)
            rules.slots.fill(now_s)
            rules.visits.call(tick)
            if missions.changed:
                # Who has been served makes room before there is a task for it.
                rules.parking.send(tick)
        if tick % self._period == 0:
            self._review(tick, now_s)
        rules.docks.tick(tick, now_s)
        rules.prefetch.tick(tick)
        rules.visits.tick(tick, now_s)

    def _review(self, tick: int, now_s: float) -> None:
        """End what cannot go on, and give out tasks."""
        rules, missions = self.rules, self.rules.missions
        rules.interventions.take_back(now_s)
        self._containment.tick(now_s)
        rules.interventions.end_overdue(now_s)
        wanted = rules.visit_queue.chargers_wanted()
        if rules.charging is not None:
            rules.charging.send_low(tick, now_s, wanted)
        priced = tick % self._price_period == 0
        if missions.changed or priced:
            rules.assignments.give_out(tick, now_s, exchange=priced)
            wanted = rules.visit_queue.chargers_wanted()
        if rules.charging is not None:
            rules.charging.send_idle(tick, wanted)
        rules.parking.send(tick)
