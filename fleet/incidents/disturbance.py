"""Disturbances: the scenario's seeded timeline of things that go wrong."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from fleet.config import ScenarioEvent, require
from fleet.incidents.recovery import Recovery
from fleet.run.view import RunView

OBSTACLE_HALF_M = (0.25, 0.25, 0.2)
"""Half size of the box that blocks a lane [m]."""
DURATION_S = 60.0
"""How long a slow arm or a blocked lane lasts if the event does not say."""
CARRIED_S = 1.0
"""How long an arm has carried a parcel when its grip is lost if the event does not say [s]."""
FOR_GOOD_S = 300.0
"""A lane that is blocked for longer is as good as lost: a run in which nothing goes on for so long has stalled [s]."""
SLOW_FACTOR = 0.5
"""Speed of a slow arm if the event does not say."""


class Disturbances:
    """Applies events at their times.

    Args:
        run: What they happen to.
        recovery: Takes cars out of the run.
        events: In any order.

    Raises:
        ConfigError: An event's target does not exist.
    """

    def __init__(self, run: RunView, recovery: Recovery, events: Sequence[ScenarioEvent]) -> None:
        self._run = run
        self._recovery = recovery
        for event in events:
            self._target(event)
        self._timeline = deque(sorted(events, key=lambda event: event.time_s))
        self._ends: dict[tuple[str, int], float] = {}
        self._carries_since_s: dict[int, float] = {}
        self._for_good: dict[int, bool] = {}

    def tick(self) -> None:
        """Apply what is due and end what has lasted long enough."""
        if not self._timeline and not self._ends:
            return
        now_s = self._run.sim_s
        while self._timeline and self._timeline[0].time_s <= now_s:
            self._apply(self._timeline.popleft(), now_s)
        for what in [what for what, end_s in self._ends.items() if end_s <= now_s]:
            del self._ends[what]
            self._end(*what)

    def _apply(self, event: ScenarioEvent, now_s: float) -> None:
        run = self._run
        target = self._target(event)
        parameters = event.parameters
        if event.kind == "car_dead":
            self._recovery.lose_car(target, f"car_{target} is dead")
        elif event.kind == "car_pushed":
            run.world.push_car(
                target, parameters.get("dx_m", 0.0), parameters.get("dy_m", 0.0), parameters.get("dyaw_rad", 0.0)
            )
        elif event.kind == "arm_slow":
            run.arm_manager.slow(target, parameters.get("factor", SLOW_FACTOR))
            self._last(event, target, now_s)
        elif not (self._drop(event, target, now_s) if event.kind == "grip_lost" else self._cover(event, target, now_s)):
            # The arm carries nothing yet, or somebody is in the cell: it happens as soon as it can.
            later = ScenarioEvent(
                time_s=now_s + run.tick_s, kind=event.kind, target=event.target, parameters=parameters
            )
            self._timeline.append(later)
            self._timeline = deque(sorted(self._timeline, key=lambda e: e.time_s))
            return
        run.events.log("disturbance", disturbance=event.kind, target=event.target, **parameters)

    def _last(self, event: ScenarioEvent, target: int, now_s: float) -> None:
        """Note when an event is over; of two that overlap, the later end counts."""
        end_s = now_s + event.parameters.get("duration_s", DURATION_S)
        self._ends[event.kind, target] = max(end_s, self._ends.get((event.kind, target), 0.0))

    def _drop(self, event: ScenarioEvent, arm: int, now_s: float) -> bool:
        """Let an arm's tool fail if it has carried a parcel long enough."""
        if not self._run.arm_manager.services[arm].carries:
            self._carries_since_s.pop(arm, None)
            return False
        since_s = self._carries_since_s.setdefault(arm, now_s)
        if now_s - since_s < event.parameters.get("carried_s", CARRIED_S):
            return False
        self._run.world.fail_grip(arm)
        return True

    def _cover(self, event: ScenarioEvent, cell: int, now_s: float) -> bool:
        """Block a cell if nobody is in it."""
        for_good = event.parameters.get("duration_s", DURATION_S) > FOR_GOOD_S
        if (event.kind, cell) not in self._ends and not self._block(cell, for_good=for_good):
            return False
        self._last(event, cell, now_s)
        return True

    def _block(self, cell: int, *, for_good: bool) -> bool:
        run = self._run
        if not run.executor.close_if_free(cell):
            return False
        x, y = run.site.grid.xy(*run.site.grid.row_col(cell))
        run.world.add_obstacle(cell, np.array([x, y, OBSTACLE_HALF_M[2]]), np.array(OBSTACLE_HALF_M))
        run.traffic.set_blocked(cell, True, for_good=for_good)
        self._for_good[cell] = for_good
        return True

    def _end(self, kind: str, target: int) -> None:
        run = self._run
        if kind == "arm_slow":
            run.arm_manager.slow(target, 1.0)
            run.events.log("disturbance_over", disturbance=kind, target=f"arm_{target}")
        else:
            run.world.remove_obstacle(target)
            run.traffic.set_blocked(target, False, for_good=self._for_good.pop(target))
            run.executor.open(target)
            row, col = run.site.grid.row_col(target)
            run.events.log("disturbance_over", disturbance=kind, target=f"{row},{col}")

    def _target(self, event: ScenarioEvent) -> int:
        run = self._run
        if event.kind == "lane_blocked":
            grid = run.site.grid
            parts = event.target.split(",")
            numbers = [int(part) for part in parts if part.strip().isdecimal()]
            ok = len(parts) == len(numbers) == 2 and numbers[0] < grid.rows and numbers[1] < grid.cols
            ok = ok and bool(grid.free[numbers[0], numbers[1]])
            require(ok, f"target of {event.kind}", event.target, "row,col of a free cell")
            return int(grid.index(numbers[0], numbers[1]))
        prefix, n = (
            ("arm_", run.world.n_arms) if event.kind.startswith(("arm_", "grip_")) else ("car_", run.world.n_cars)
        )
        number = event.target.removeprefix(prefix)
        ok = event.target.startswith(prefix) and number.isdecimal() and int(number) < n
        require(ok, f"target of {event.kind}", event.target, f"{prefix}0 to {prefix}{n - 1}")
        return int(number)
