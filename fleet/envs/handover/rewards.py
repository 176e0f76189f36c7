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

    Progress is the decrease of a way. Of cars it counts as long as they are loaded or empty, also where the way becomes
    longer at once, as it does for a car that has driven past a stop: going in circles earns nothing. Of arms it counts
    as long as they are about the same thing.

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
        self._keys: FloatArray | None = None
        self._ways = np.zeros(len(self._touched))

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
        keys, ways = self._measured(cars, targets)
        if self._keys is not None:
            own[:, _PROGRESS] = np.where((keys == self._keys) & (keys >= 0.0), self._ways - ways, 0.0)
            own[:, _TIME] = self._step_s
        self._keys, self._ways = keys, ways
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

    def _measured(self, cars: CarsSighted, targets: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What agents are about, -1 = nothing, and what is left of the ways there [m], shapes (n_agents,)."""
        loaded = cars.loads > 0
        counts = loaded[:, None] == self._is_drop
        left = np.where(counts, np.maximum(cars.left_m, 0.0), np.inf).min(axis=1)
        return np.concatenate((loaded.astype(np.float64), targets[:, 0])), np.concatenate((left, targets[:, 1]))

    def _touches(self) -> Int64Array:
        return np.concatenate(self._world.contacts_of())

    def _n_contacts(self) -> int:
        contacts = self._world.contacts()
        return contacts.robot + contacts.static
