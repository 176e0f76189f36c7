"""SafetyCheck: looks at a run after every tick and ends it as soon as an invariant does not hold."""

from __future__ import annotations

from fleet.run.view import RunView
from fleet.safety.books import BookCheck
from fleet.safety.breach import Breach, InvariantError
from fleet.safety.clearance import ClearanceCheck
from fleet.safety.faults import CarFaults
from fleet.safety.floor import FloorCheck
from fleet.safety.order import OrderCheck
from fleet.safety.parcels import ParcelsCheck

AUDIT_S = 1.0
"""The lists of all tasks and slots are gone through this often [s]: what they hold wrong stays wrong until then, as
what moves in between is checked in every tick."""
ORDER_S = 0.25
"""Rings among waiting moves are looked for this often [s]. Only a plan or an exchange closes one, no grant opens it,
and nobody in it is granted anything: it stays, and is found, unless a cut drops it first, and then nobody has moved."""


class SafetyCheck:
    """The invariants of a run; see `fleet.safety.breach.Invariant`.

    An observer: the run does not depend on it. Make it before the first tick, so that it hears of every fault.

    Args:
        run: The run.

    Raises:
        InvariantError: The lane graph is wrong.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._faults = CarFaults(run)
        self._floor = FloorCheck(run, self._faults)
        self._order = OrderCheck(run)
        self._clearance = ClearanceCheck(run, self._faults)
        self._books = BookCheck(run)
        self._parcels = ParcelsCheck(run, self._faults)
        self._audit_ticks = max(1, round(AUDIT_S / run.tick_s))
        self._order_ticks = max(1, round(ORDER_S / run.tick_s))
        self._raise(self._floor.moves())

    def tick(self) -> None:
        """Look at the tick that was just done.

        Raises:
            InvariantError: One of the invariants does not hold; the run's events tell of it, too.
        """
        self._raise(self._breach())

    def _breach(self) -> Breach | None:
        run, world = self._run, self._run.world
        self._faults.look()
        poses, held = world.car_poses(), world.held()
        ids, parcels = world.parcel_ids(), world.parcel_poses()
        breach = (
            self._floor.look(poses)
            or self._clearance.look(poses, held, ids, parcels)
            or self._books.look()
            or self._parcels.look(poses, held, ids, parcels)
        )
        self._faults.end(self._floor.inside)
        if breach is None and run.now % self._order_ticks == 0:
            breach = self._order.look()
        if breach is None and run.now % self._audit_ticks == 0:
            breach = self._books.audit() or self._parcels.audit()
        return breach

    def _raise(self, breach: Breach | None) -> None:
        if breach is None:
            return
        error = InvariantError(breach, self._run.now, self._run.sim_s)
        self._run.events.log("violation", **error.facts)
        raise error
