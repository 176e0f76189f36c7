"""CarFaults: which cars are not answerable for where they are, because something was done to them."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray
from fleet.config import EVENT_KINDS
from fleet.missions.phases import NUMBER_OF_PHASE, CarPhase
from fleet.run.events import Event
from fleet.run.view import RunView
from fleet.traffic.drivers import OFF_LANE_M

SETTLES_S = 2.0
"""A car that something moved comes to rest within so long [s]."""
BESIDE_M = 0.05
"""A car that follows its lane is nearer to it than this [m]; one that was pushed under an arm, which is at work on it,
stays where it is until that has ended."""
_DEAD, _RECOVERING = NUMBER_OF_PHASE[CarPhase.DEAD], NUMBER_OF_PHASE[CarPhase.RECOVERING]
_NEVER = np.iinfo(np.int64).max


class CarFaults:
    """Cars under a fault: dead ones, and those that an event moves (`EventKind.moves_cars`) until they are recovered.

    Such a fault begins with the event. It is over when the car is back: the event has ended `SETTLES_S` ago, the car is
    not being recovered any more, its body is in cells that are its own, and it is not beside its lane. A car that
    leaves its lane although nothing has moved it is recovered, too, but has no excuse.

    Attributes:
        cars: Whether each car is under a fault, shape (n_cars,).

    Args:
        run: The run; its events tell of faults.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._phases = run.missions.phase_index
        self.cars: BoolArray = np.zeros(len(self._phases), dtype=np.bool_)
        self._moved_by: list[set[str]] = [set() for _ in self._phases]
        self._settled_at = np.zeros(len(self._phases), dtype=np.int64)
        run.events.subscribe(self._note)

    def look(self) -> None:
        """Take in which cars are dead now."""
        self.cars |= self._phases == _DEAD

    def end(self, inside: BoolArray) -> None:
        """End the faults of cars that are back.

        Args:
            inside: Whether each car's body is in its own cells, shape (n_cars,).
        """
        if not self.cars.any():
            return
        out = (self._phases == _DEAD) | (self._phases == _RECOVERING) | (self._settled_at > self._run.now)
        self.cars &= out | ~inside | self._beside()

    def _beside(self) -> BoolArray:
        """Cars beside their lane, on the grid those that stand beside their state, shape (n_cars,)."""
        run = self._run
        if run.driver.paths is not None:
            beside: BoolArray = np.abs(run.driver.paths.follower.cross_track) > BESIDE_M
            return beside
        stops = run.graph.state_pose[run.executor.tail_states()]
        off_m = np.hypot(*(run.world.car_poses() - stops)[:, :2].T)
        stands_beside: BoolArray = run.executor.without_moves() & (off_m > OFF_LANE_M)
        return stands_beside

    def _note(self, event: Event) -> None:
        if event.kind not in ("disturbance", "disturbance_over"):
            return
        kind = str(event.facts["disturbance"])
        if not EVENT_KINDS[kind].moves_cars:
            return
        car = int(str(event.facts["target"]).removeprefix("car_"))
        self.cars[car] = True
        moved_by = self._moved_by[car]
        if event.kind == "disturbance_over":
            moved_by.discard(kind)
        elif EVENT_KINDS[kind].lasts:
            moved_by.add(kind)
        settled_at = self._run.now + round(SETTLES_S / self._run.tick_s)
        self._settled_at[car] = _NEVER if moved_by else settled_at
