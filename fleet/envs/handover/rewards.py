"""HandoverRewards: what an agent has done in a step, as weighted terms that add up to its reward."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.envs.handover.config import TERMS, HandoverWeights
from fleet.envs.handover.parcels import Happened, Int64Array, ParcelEvent, ParcelPlaces
from fleet.envs.handover.rows import CarsSighted
from fleet.world.protocol import World

_PROGRESS, _GRIPPED, _LOADED, _DELIVERED, _LOST, _CONTACT, _TIME = range(len(TERMS))
_SHARED = [_LOADED, _DELIVERED, _LOST, _CONTACT]
COUNTED = ("n_gripped", "n_loaded", "n_delivered", "n_lost", "n_contacts")
"""What is counted of each agent, not weighted; the terms from the second to the last but one."""
_TERM_OF = {
    Happened.GRIPPED: _GRIPPED,
    Happened.LOADED: _LOADED,
    Happened.DELIVERED: _DELIVERED,
    Happened.LOST: _LOST,
}


class HandoverRewards:
    """Judges one episode, step by step; cars come first in all arrays.

    Progress of a car is the decrease of its way, as long as it is loaded or empty, also where the way becomes longer at
    once, as it does for one that has driven past a stop: going in circles earns nothing. Progress of an arm is how much
    nearer it has come than ever before to what it is about: to take a parcel and let it fall again earns nothing.

    Args:
        world: Counts contacts.
        weights: What things are worth.
        team_share: Share of what the whole team does in what each agent is paid for.
        step_s: Length of a step [s].
        places: Where parcels may lie.
    """

    def __init__(
        self, world: World, weights: HandoverWeights, team_share: float, step_s: float, places: ParcelPlaces
    ) -> None:
        self._world = world
        self._weights = np.array([getattr(weights, term) for term in TERMS])
        self._share = np.zeros(len(TERMS))
        self._share[_SHARED] = team_share
        self._step_s = step_s
        self._is_drop = places.is_drop
        self._touched = self._touches()
        self._n_touches = self._n_contacts()
        self._loaded: BoolArray | None = None
        self._left_m = np.zeros(world.n_cars)
        self._nearest_m: list[dict[float, float]] = [{} for _ in range(world.n_arms)]
        """How near each arm has come to all that it was about."""

    def touches(self) -> BoolArray:
        """Which robots have a contact that is new since the last step, shape (n_agents,)."""
        return np.asarray(self._touches() > self._touched)

    def step(
        self, cars: CarsSighted, targets: FloatArray, happened: Sequence[ParcelEvent]
    ) -> tuple[FloatArray, FloatArray]:
        """Judge the time since the last call; the first call only looks.

        Args:
            cars: What cars are doing.
            targets: What arms are about, and the ways there [m], shape (n_arms, 2).
            happened: What has happened to parcels.

        Returns:
            Weighted terms, shape (n_agents, n_terms), and what is counted of each agent, shape (n_agents, 5).
        """
        n_cars = len(cars.poses)
        own = np.zeros((n_cars + len(targets), len(TERMS)))
        team = np.zeros(len(TERMS))
        own[:n_cars, _PROGRESS] = self._driven(cars)
        own[n_cars:, _PROGRESS] = [self._neared(arm, *told) for arm, told in enumerate(targets.tolist())]
        own[:, _TIME] = self._step_s
        for event in happened:
            term = _TERM_OF[event.kind]
            team[term] += 1.0
            if event.arm >= 0:
                own[n_cars + event.arm, term] += 1.0
            if event.car >= 0 and event.kind is not Happened.GRIPPED:
                own[event.car, term] += 1.0
        touched, n_touches = self._touches(), self._n_contacts()
        own[:, _CONTACT], team[_CONTACT] = touched - self._touched, n_touches - self._n_touches
        self._touched, self._n_touches = touched, n_touches
        paid = (1.0 - self._share) * own + self._share * team
        return paid * self._weights + 0.0, own[:, _GRIPPED:_TIME]  # + 0.0: no negative zeros

    def _driven(self, cars: CarsSighted) -> FloatArray:
        """By how much the ways of cars have become shorter [m], shape (n_cars,)."""
        loaded = cars.loads > 0
        counts = loaded[:, None] == self._is_drop
        left_m = np.where(counts, np.maximum(cars.left_m, 0.0), np.inf).min(axis=1)
        driven = np.zeros(len(loaded)) if self._loaded is None else self._left_m - left_m
        driven[loaded != self._loaded] = 0.0
        self._loaded, self._left_m = loaded, left_m
        return driven

    def _neared(self, arm: int, target: float, way_m: float) -> float:
        """How much nearer an arm has come to a target than ever before [m]."""
        if target < 0.0:
            return 0.0
        before_m = self._nearest_m[arm].get(target, way_m)
        self._nearest_m[arm][target] = min(way_m, before_m)
        return max(before_m - way_m, 0.0)

    def _touches(self) -> Int64Array:
        return np.concatenate(self._world.contacts_of())

    def _n_contacts(self) -> int:
        contacts = self._world.contacts()
        return contacts.robot + contacts.static
