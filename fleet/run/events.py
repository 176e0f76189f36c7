"""Events: what happens in a run, as it happens, for everybody who wants to hear of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fleet.run.clock import Clock


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened, as it goes into the run file."""

    tick: int
    sim_s: float
    kind: str
    facts: dict[str, object]


Listener = Callable[[Event], None]


class Events:
    """Hands events to all who have subscribed, in the order in which they did.

    Args:
        clock: Stamps events.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._listeners: list[Listener] = []

    def subscribe(self, listener: Listener) -> None:
        """Let a listener hear of every event from now on."""
        self._listeners.append(listener)

    def unsubscribe(self, listener: Listener) -> None:
        """Let a listener that has subscribed hear of no further event."""
        self._listeners.remove(listener)

    def log(self, kind: str, **facts: object) -> None:
        """Report an event at the present tick."""
        if not self._listeners:
            return
        event = Event(tick=self._clock.now, sim_s=round(self._clock.sim_s, 6), kind=kind, facts=facts)
        for listener in self._listeners:
            listener(event)
