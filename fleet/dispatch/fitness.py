"""Fitness: which cars can ever do a task, whatever else they are about."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
import numpy.typing as npt

from fleet.dispatch.situation import CAN_TAKE
from fleet.tasks.board import Task
from fleet.tasks.order import Ability
from fleet.tasks.reasons import CODE_OF_REASON, PairReason

Codes = npt.NDArray[np.int8]


class Fitness:
    """Payloads and capabilities of cars.

    Args:
        abilities: What each car can carry.
    """

    def __init__(self, abilities: Sequence[Ability]) -> None:
        self._most_kg = np.array([ability.max_payload_kg for ability in abilities])
        self.slowness = np.array([ability.slowness for ability in abilities])
        """How many times as long as other cars each takes for its way, shape (n_cars,)."""
        self._capabilities = list(dict.fromkeys(ability.capabilities for ability in abilities))
        kinds = {capabilities: kind for kind, capabilities in enumerate(self._capabilities)}
        self._kind_of = np.array([kinds[ability.capabilities] for ability in abilities])
        self._lacking: dict[tuple[str, ...], npt.NDArray[np.bool_]] = {}
        self._codes: dict[int, Codes | None] = {}

    def codes(self, task: Task) -> Codes | None:
        """Why cars can never do a task, as indices into `PAIR_REASONS`, shape (n_cars,); None if all can."""
        if task.index not in self._codes:
            heavy = task.order.payload_kg > self._most_kg
            lacks = self._lacks(task.order.needs)
            codes = np.where(heavy, CODE_OF_REASON[PairReason.TOO_HEAVY], CODE_OF_REASON[PairReason.LACKS_CAPABILITY])
            unfit = heavy | lacks
            self._codes[task.index] = np.where(unfit, codes, CAN_TAKE).astype(np.int8) if unfit.any() else None
        return self._codes[task.index]

    def _lacks(self, needs: tuple[str, ...]) -> npt.NDArray[np.bool_]:
        """Which cars lack one of some capabilities, shape (n_cars,)."""
        if needs not in self._lacking:
            lacking = [not able.issuperset(needs) for able in self._capabilities]
            self._lacking[needs] = np.array(lacking)[self._kind_of]
        return self._lacking[needs]

    def fits_any(self, task: Task, cars: npt.NDArray[np.intp]) -> bool:
        """Whether any of some cars can do a task."""
        codes = self.codes(task)
        return codes is None or bool((codes[cars] == CAN_TAKE).any())

    def kind_of(self, task: Task) -> Hashable:
        """What deliveries have in common that wait for the same: where they go and who can do them.

        One that follows another in the same car is of a kind of its own.
        """
        codes = self.codes(task)
        own = task.index if task.order.same_car_as else None
        return task.delivery.drop, None if codes is None else codes.tobytes(), own
