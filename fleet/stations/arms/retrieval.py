"""Retrieval: the way to a parcel that lies anywhere, and on with it, searched for when it is needed.

It is searched from the parcel: first the postures that hold it, then straight ways up from there, and only for those
that are free the ways between them and the rest of the world. The other way round, most postures in the air that look
good have no straight way down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.stations.arms.arm_motions import ArmMotions, Held, UnreachableError, backwards
from fleet.stations.arms.arm_spheres import PlannedArm
from fleet.stations.arms.loose import LooseGrips
from fleet.stations.arms.search import Search
from fleet.stations.arms.transfer import Signal, Step
from planners.motion.arm.kinematics import flange_from_tip
from planners.motion.arm.spheres import box_spheres
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes

LIFTS_M = (0.30, 0.12, 0.06)
"""Straight ways up, in the order they are tried: the first leads out between pedestals, the others are within reach on
top of them and far out [m]."""
N_POSTURES = 400
"""Postures at the parcel from which ways up are looked for, nearest to rest first."""
N_LIFTS = 12
"""Ways up that are offered to a search."""
N_TRIES = 3
"""Ways up from which a way on with the parcel is looked for."""


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Distances kept from obstacles."""

    travel_m: float
    line_m: float


class Retrieval:
    """Plans retrievals of one arm.

    Args:
        arm: The arm with its tool.
        motions: Of the arm.
        search: Finds the ways between the lines.
        margins: Distances kept on ways and on straight lines.
    """

    def __init__(self, arm: PlannedArm, motions: ArmMotions, search: Search, margins: Margins) -> None:
        self._model, self._spec, self._tool = arm.spheres, arm.spec, arm.spec.tool
        self._motions, self._search, self._margins = motions, search, margins

    def steps(self, grips: LooseGrips, held: Held, boxes: Boxes, onward: FloatArray) -> tuple[Step, ...]:
        """From rest down to the parcel, up again with it, and on.

        Args:
            grips: How the parcel may be gripped, tips in the base frame.
            held: The parcel in the grip.
            boxes: Everything else, in the base frame.
            onward: Where the arm is to end [rad], shape (n,).

        Raises:
            UnreachableError: There is no way.
        """
        travel, line = (
            CollisionChecker(self._model, boxes, margin=margin)
            for margin in (self._margins.travel_m, self._margins.line_m)
        )
        centre, radius = box_spheres(tuple(edge / 2 for edge in held.size_m))
        below = np.array([0.0, 0.0, self._tool.length_m + held.below_tip_m])
        loaded = CollisionChecker(
            self._model, boxes, held_spheres=(centre + below, radius), margin=self._margins.travel_m
        )
        refusal: UnreachableError | None = None
        postures = self._postures(grips, line)
        for lift_m in LIFTS_M:
            lifts = self._lifts(postures, lift_m, line, (travel, loaded))
            for _ in range(N_TRIES if lifts else 0):
                try:
                    return self._through(lifts, held, boxes, onward, (travel, line, loaded))
                except UnreachableError as error:
                    refusal = refusal or error
                if not lifts:
                    break
        raise refusal or UnreachableError("no way to the parcel (no straight way up from it)")

    def _postures(self, grips: LooseGrips, line: CollisionChecker) -> FloatArray:
        """Postures that hold the parcel, nearest to rest first, shape (k, n)."""
        q = np.concatenate(
            [self._motions.inverse.ik_all(flange_from_tip(tip, self._tool.length_m)) for tip in grips.tips]
        )
        if len(q) == 0:
            raise UnreachableError("no way to the parcel (unreachable)")
        q = q[line.batch(q)]
        if len(q) == 0:
            raise UnreachableError("no way to the parcel (no room for the arm)")
        near = np.argsort(np.linalg.norm(q - self._spec.home_rad, axis=1), kind="stable")
        postures: FloatArray = q[near[:N_POSTURES]]
        return postures

    def _lifts(
        self, postures: FloatArray, lift_m: float, line: CollisionChecker, ends: tuple[CollisionChecker, ...]
    ) -> list[FloatArray]:
        """Free straight ways up from postures at the parcel, whose ends are free with more room, each (k, n)."""
        lifts: list[FloatArray] = []
        for q in postures:
            above = self._motions.tip(q)
            above[2, 3] += lift_m
            up = self._motions.line(q, above)
            if up is not None and all(end.free(up[-1]) for end in ends) and line.path_free(up):
                lifts.append(up)
                if len(lifts) == N_LIFTS:
                    break
        return lifts

    def _through(
        self,
        lifts: list[FloatArray],
        held: Held,
        boxes: Boxes,
        onward: FloatArray,
        checkers: tuple[CollisionChecker, CollisionChecker, CollisionChecker],
    ) -> tuple[Step, ...]:
        """Ways to one of the lifts and on from it; a lift that leads nowhere is taken out of the list."""
        travel, line, loaded = checkers
        motions = self._motions
        there = self._way(travel, self._spec.home_rad, np.array([up[-1] for up in lifts]))
        if there is None:
            lifts.clear()
            raise UnreachableError("no way to the parcel (no path)")
        chosen = int(np.argmin([np.abs(up[-1] - there[-1]).max() for up in lifts]))
        up = lifts.pop(chosen)
        on = self._way(loaded, up[-1], onward[None])
        if on is None:
            raise UnreachableError("no way on with the parcel (no path)")
        lift = motions.timed_line(up, line)
        return (
            motions.confirmed(motions.timed(there, 1.0, travel), boxes, None),
            motions.confirmed(backwards(lift), boxes, None),
            Signal.GRIP,
            motions.confirmed(lift, boxes, held),
            motions.confirmed(motions.timed(on, 1.0, loaded), boxes, held),
        )

    def _way(self, checker: CollisionChecker, start: FloatArray, goals: FloatArray) -> FloatArray | None:
        result = self._search.way(checker, start, goals)
        return result.path if result.solved else None
