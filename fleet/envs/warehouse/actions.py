"""Actions of the warehouse's agents: read from dictionaries and made legal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.envs.core.choices import row_of
from fleet.envs.warehouse.rows import make_legal

Bools = npt.NDArray[np.bool_]


class LegalActions(NamedTuple):
    """Legal decisions of all agents."""

    cars: FloatArray
    """In [-1, 1], shape (n_agent_cars, 2)."""
    arms: FloatArray
    """In [-1, 1], grip last, shape (n_agent_arms, n_entries + 1)."""
    illegal_cars: Bools
    """Whether a car's action had to be made legal, shape (n_agent_cars,)."""
    illegal_arms: Bools
    """The same of the arms."""


def legal_actions(actions: Mapping[str, Any], cars: Sequence[str], arms: Sequence[str], n_entries: int) -> LegalActions:
    """Actions of all agents made legal.

    Args:
        actions: By agent.
        cars: Agents that are cars.
        arms: Agents that are arms.
        n_entries: Entries of an arm's action, without the grip.

    Raises:
        ActionError: An action is no row of so many numbers.
    """
    of_cars, illegal_cars = _legal(actions, cars, 2)
    of_arms, illegal_arms = _legal(actions, arms, n_entries + 1)
    return LegalActions(cars=of_cars, arms=of_arms, illegal_cars=illegal_cars, illegal_arms=illegal_arms)


def _legal(actions: Mapping[str, Any], agents: Sequence[str], n_entries: int) -> tuple[FloatArray, Bools]:
    """Actions of the agents of a type made legal, shape (n, n_entries), and which were not, shape (n,)."""
    rows = np.empty((len(agents), n_entries))
    missing = np.zeros(len(agents), dtype=np.bool_)
    for k, agent in enumerate(agents):
        action = actions.get(agent)
        if action is None:
            missing[k], rows[k] = True, 0.0
            rows[k, -1] = -1.0 if n_entries > 2 else 0.0  # an arm without an action lets go
        else:
            rows[k] = row_of(agent, action, n_entries)
    make_legal(rows, missing)
    return rows, missing
