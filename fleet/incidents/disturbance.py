"""Disturbances: the scenario's timeline of what goes wrong, and of what ends it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from fleet.config import EVENT_KINDS, ScenarioEvent
from fleet.config.events import ARM, CAR, CELL, FLEET, STATION, TARGETS, ZONE
from fleet.errors import ConfigError
from fleet.incidents.faults import floor, plans
from fleet.incidents.faults.arms import arm_incidents
from fleet.incidents.faults.cars import car_incidents
from fleet.incidents.faults.incident import Incident
from fleet.incidents.recovery import Recovery
from fleet.run.view import RunView

_Key = tuple[str, str]
"""A kind of event, and its target."""


class Disturbances:
    """Lets events happen at their times.

    Args:
        run: What they happen to.
        recovery: Takes cars out of the run, and brings them back.
        events: In any order.

    Raises:
        ConfigError: An event's target does not exist.
    """

    def __init__(self, run: RunView, recovery: Recovery, events: Sequence[ScenarioEvent]) -> None:
        self._run = run
        self._humans = floor.HumanWalks(run)
        self._faults = _faults(run, recovery, self._humans)
        for event in events:
            self._targets(event)
            if event.kind == "human_walks":
                self._humans.goal(event)
        self._timeline = deque(sorted(events, key=lambda event: event.time_s))
        self._waiting: list[ScenarioEvent] = []
        self._until: dict[_Key, float] = {}
        self._begun: dict[_Key, tuple[int, ...]] = {}
        self._idle: list[ScenarioEvent] = []
        """Events that were to end another one, which had not begun, or was over."""

    def not_happened(self) -> list[tuple[ScenarioEvent, str]]:
        """Events that have not happened so far, each with why, by time."""
        found = [(event, "it could not happen yet") for event in self._waiting]
        found += [(event, f"there was no {EVENT_KINDS[event.kind].ends} to end") for event in self._idle]
        found += [(event, "the run was over before") for event in self._timeline]
        return sorted(found, key=lambda pair: pair[0].time_s)

    def tick(self) -> None:
        """Let what is due happen, and end what has lasted long enough."""
        now_s = self._run.sim_s
        while self._timeline and self._timeline[0].time_s <= now_s:
            self._waiting.append(self._timeline.popleft())
        if self._waiting:
            self._waiting = [event for event in self._waiting if not self._happens(event, now_s)]
        if self._until and min(self._until.values()) <= now_s:
            for key in [key for key, until_s in self._until.items() if until_s <= now_s]:
                self._end(key)
        self._humans.tick()

    def _happens(self, event: ScenarioEvent, now_s: float) -> bool:
        """Let an event happen if it can: False if it is to be tried again."""
        kind, key = EVENT_KINDS[event.kind], (event.kind, event.target)
        if kind.ends:
            begun = (kind.ends, event.target)
            if begun in self._begun:
                self._end(begun)
            else:
                self._idle.append(event)
            return True
        targets = self._targets(event)
        if key not in self._begun and not self._faults[event.kind].begin(event, targets):
            return False
        if kind.lasts:
            # Of two that overlap, the later end counts.
            self._begun[key] = tuple(targets)
            self._until[key] = max(now_s + event.duration_s, self._until.get(key, 0.0))
        self._run.events.log("disturbance", disturbance=event.kind, target=event.target, **event.parameters)
        return True

    def _end(self, key: _Key) -> None:
        kind, target = key
        del self._until[key]
        self._faults[kind].end(self._begun.pop(key))
        self._run.events.log("disturbance_over", disturbance=kind, target=target)

    # --- targets

    def _targets(self, event: ScenarioEvent) -> list[int]:
        """Numbers of whom or what an event happens to."""
        kinds = EVENT_KINDS[event.kind].targets
        for kind in kinds:
            found = self._numbers(kind, event.target)
            if found is not None:
                return found
        what, valid = f"event at {event.time_s:g} s: target of {event.kind}", " or ".join(map(self._words, kinds))
        raise ConfigError(f"{what} is {event.target!r}; valid: {valid}")

    def _numbers(self, kind: str, target: str) -> list[int] | None:
        """The numbers that a target names if it is of some kind, else None; a zone names the cars that are in it."""
        run = self._run
        if kind == FLEET:
            return list(range(run.world.n_cars)) if target == FLEET else None
        if kind == STATION:
            return next(([station.arm] for station in run.stations if station.name == target), None)
        if kind in (CAR, ARM):
            number = target.removeprefix(f"{kind}_")
            ok = target.startswith(f"{kind}_") and number.isdecimal() and int(number) < self._n(kind)
            return [int(number)] if ok else None
        corners = self._corners(target, 1 if kind == CELL else 2)
        if corners is None:
            return None
        grid = run.site.grid
        low, high = np.min(corners, axis=0), np.max(corners, axis=0)
        inside = np.zeros((grid.rows, grid.cols), dtype=np.bool_)
        inside[low[0] : high[0] + 1, low[1] : high[1] + 1] = True
        inside &= grid.free
        if not inside.any():
            return None
        if kind == CELL:
            return np.flatnonzero(inside).tolist()
        tails = run.graph.state_cell[run.executor.dependencies.queues.state]
        return np.flatnonzero(inside.ravel()[tails]).tolist()

    def _corners(self, target: str, n: int) -> list[tuple[int, int]] | None:
        """Rows and columns of so many cells of the floor."""
        grid, parts = self._run.site.grid, target.split(",")
        numbers = [int(part) for part in parts if part.strip().isdecimal()]
        if not len(parts) == len(numbers) == 2 * n:
            return None
        found = list(zip(numbers[::2], numbers[1::2], strict=True))
        return found if all(row < grid.rows and col < grid.cols for row, col in found) else None

    def _n(self, kind: str) -> int:
        """How many cars or arms there are."""
        return self._run.world.n_cars if kind == CAR else self._run.world.n_arms

    def _words(self, kind: str) -> str:
        if kind == CELL:
            return "row,col of a free cell"
        if kind == STATION:
            return ", ".join(station.name for station in self._run.stations)
        if kind in (CAR, ARM):
            return f"{kind}_0 to {kind}_{self._n(kind) - 1}"
        return TARGETS[kind] if kind == ZONE else kind


def _faults(run: RunView, recovery: Recovery, humans: floor.HumanWalks) -> dict[str, Incident]:
    """What happens, by kind of event; those that end others have none of their own."""
    return {
        **car_incidents(run, recovery),
        **arm_incidents(run, recovery),
        "plans_late": plans.PlansLate(run),
        "plans_lost": plans.PlansLost(run),
        "lane_blocked": floor.LaneBlocked(run),
        "lane_closed": floor.LaneClosed(run),
        "human_walks": humans,
    }
