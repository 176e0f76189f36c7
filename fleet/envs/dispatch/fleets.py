"""The fleets that agents of the dispatch layer decide for: one interface for all fidelities, and the grid behind it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from fleet.abstract.fleet import TIMESTEP_S, FleetSite, GridFleet
from fleet.abstract.kernel import ENOUGH, NEVER, NO_BATTERY, NO_FAULTS, NONE, TO_DROP, Battery, Faults, Phase, Stage
from fleet.envs.dispatch.outlook import Jobs, Outlook
from fleet.envs.dispatch.view import DispatchView
from fleet.envs.layers.fleets import Fleet, FleetOnGrid
from fleet.tasks.order import Delivery


class DispatchFleet(Fleet, Protocol):
    """One episode of a fleet whose tasks are given out from outside."""

    def view(self, left: float) -> DispatchView:
        """The fleet now, when this share of the episode is left."""

    def give(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Give tasks to cars, as pairs (car, task); each was on offer in the last view."""

    def run(self, duration_s: float) -> None:
        """Let time pass."""

    def outlook(self) -> Outlook:
        """The fleet now, to be played on; it knows no order before its release."""


class GridDispatch(FleetOnGrid):
    """A `DispatchFleet` on the grid: right of way is decided by PIBT, and arms take their mean time.

    Args:
        place: The site.
        n_cars: Number of cars.
        orders: Deliveries, ascending in release.
        seed: Seed of the tie-breaking, and of breakdowns.
        faults: How often cars break down.
        battery: How fast batteries empty and fill.
    """

    def __init__(
        self,
        place: FleetSite,
        n_cars: int,
        orders: Sequence[Delivery],
        seed: int,
        faults: Faults = NO_FAULTS,
        battery: Battery = NO_BATTERY,
    ) -> None:
        super().__init__(GridFleet(place, n_cars, orders, seed, faults, battery))

    def view(self, left: float) -> DispatchView:
        """See `DispatchFleet`."""
        grid = self.grid
        cars, tasks, now = grid.cars, grid.tasks, grid.now
        first, last = tasks.window.tolist()
        stage = tasks.stage[first:last]
        task = (np.flatnonzero(stage == Stage.READY) + first).astype(np.int32)
        due = tasks.due[task]
        return DispatchView(
            now_s=now * TIMESTEP_S,
            left=left,
            pose=grid.place.graph.state_pose[cars.state],
            state=cars.state,
            goal=cars.goal,
            phase=cars.phase,
            held=cars.held,
            free=cars.phase == Phase.FREE,
            task=task,
            order=tasks.order[task],
            pick=tasks.pick[task],
            drop=tasks.drop[task],
            rank=tasks.rank[task],
            age_s=(now - tasks.release[task]) * TIMESTEP_S,
            due_s=np.where(due == NEVER, np.inf, (due - now) * TIMESTEP_S),
            charge=cars.charge if grid.battery.drain else np.ones(len(cars.state)),
            chargers_left=1.0 - np.count_nonzero(cars.charger != NONE) / max(1, len(grid.place.floor.charger_state)),
            under_way=grid.stations.under_way,
        )

    def give(self, pairs: Sequence[tuple[int, int]]) -> None:
        """See `DispatchFleet`."""
        for car, task in pairs:
            self.grid.assign(car, task)
        if pairs:
            self.grid.direct()

    def run(self, duration_s: float) -> None:
        """See `DispatchFleet`."""
        for _ in range(round(duration_s / TIMESTEP_S)):
            self.grid.move(self.grid.planned())

    def outlook(self) -> Outlook:
        """See `DispatchFleet`; who has broken down goes on after the mean time, as nobody knows how long it takes.

        Who charges is free when it has enough; what tasks take of batteries is left out.
        """
        cars, tasks = self.grid.cars, self.grid.tasks
        phase, left = cars.phase.copy(), cars.left.copy()
        stands = (phase == Phase.OUT) & (left > 0)
        left[stands] = round(self.grid.faults.mean_steps)
        phase[stands] = np.where(cars.task[stands] == NONE, Phase.FREE, TO_DROP)
        charging = phase == Phase.CHARGING
        left[charging] = np.ceil((ENOUGH - cars.charge[charging]) / max(self.grid.battery.gain, 1e-9))
        phase[charging] = Phase.FREE
        stage = tasks.stage[: tasks.window[1]]
        known = np.flatnonzero((stage >= Stage.READY) & (stage < Stage.DELIVERED)).astype(np.int32)
        columns = (tasks.release, tasks.due, tasks.pick, tasks.drop, tasks.rank.astype(np.int32), tasks.order)
        has_task = cars.task != NONE
        job = np.full(len(cars.task), NONE, dtype=np.int32)
        job[has_task] = np.searchsorted(known, cars.task[has_task])
        return Outlook(
            now=self.grid.now,
            state=cars.state.copy(),
            phase=phase,
            left=left,
            job=job,
            jobs=Jobs(*(column[known] for column in columns)),
            number=known,
        )
