"""CarFaults: which cars are not answerable for where they are, because something was done to them."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray
from fleet.missions.phases import NUMBER_OF_PHASE, CarPhase
from fleet.run.events import Event
from fleet.run.view import RunView

SETTLES_S = 2.0
"""A pushed car slides no longer than this [s]."""
_DEAD, _RECOVERING = NUMBER_OF_PHASE[CarPhase.DEAD], NUMBER_OF_PHASE[CarPhase.RECOVERING]


class CarFaults:
    """Cars under a fault: dead ones, and pushed ones until they are recovered.

    A push begins with the event that tells of it. It is over when the car is back: not being recovered any more, with
    its body in cells that are its own, `SETTLES_S` after the last push. A car that leaves its lane although nobody has
    pushed it is recovered, too, but has no excuse.

    Attributes:
        cars: Whether each car is under a fault, shape (n_cars,).

    Args:
        run: The run; its events tell of pushes.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._phases = run.missions.phase_index
        self.cars: BoolArray = np.zeros(len(self._phases), dtype=np.bool_)
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
        self.cars &= out | ~inside

    def _note(self, event: Event) -> None:
        if event.kind == "disturbance" and event.facts["disturbance"] == "car_pushed":
            car = int(str(event.facts["target"]).removeprefix("car_"))
            self.cars[car] = True
            self._settled_at[car] = self._run.now + round(SETTLES_S / self._run.tick_s)
