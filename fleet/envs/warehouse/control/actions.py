"""Actions of the warehouse's agents: read from dictionaries and made legal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.envs.core.choices import row_of
from fleet.envs.warehouse.control.hands import N_TIP
from fleet.envs.warehouse.rows import N_JOINTS

Bools = npt.NDArray[np.bool_]

N_CAR_ENTRIES = 2
"""Entries of a car's action: steering and speed."""
CAR_ACTIONS = ("drive", "residual")
"""Ways to drive a car."""
ARM_ACTIONS = {"joint": N_JOINTS + 1, "tip": N_TIP + 1, "residual": N_JOINTS + 1}
"""Ways to move an arm, and how many entries each has at most; the last one is the grip, of `residual` the pace."""


def n_arm_entries(arm_action: str, n_joints: int) -> int:
    """Entries of the action of an arm with so many joints; `arm_action` is a name in `ARM_ACTIONS`."""
    return ARM_ACTIONS[arm_action] if arm_action == "tip" else n_joints + 1


class LegalActions(NamedTuple):
    """Legal decisions of all agents."""

    cars: FloatArray
    """In [-1, 1], shape (n_agent_cars, 2)."""
    arms: FloatArray
    """In [-1, 1], grip or pace last, zero for joints that an arm does not have, shape (n_agent_arms, n_entries)."""
    illegal_cars: Bools
    """Whether a car's action had to be made legal, shape (n_agent_cars,)."""
    illegal_arms: Bools
    """The same of the arms."""


def legal_actions(
    actions: Mapping[str, Any], cars: Sequence[str], arms: Sequence[str], arm_action: str, n_joints: Sequence[int] = ()
) -> LegalActions:
    """Actions of all agents made legal.

    Args:
        actions: By agent.
        cars: Agents that are cars.
        arms: Agents that are arms.
        arm_action: A name in `ARM_ACTIONS`.
        n_joints: Joints of each of these arms; () = the most.

    Raises:
        ActionError: An action is no row of so many numbers.
    """
    # An arm without an action lets go.
    last = 0.0 if arm_action == "residual" else -1.0
    of_cars, illegal_cars = _legal(actions, cars, N_CAR_ENTRIES, (), 0.0)
    entries = [n_arm_entries(arm_action, n) for n in n_joints]
    of_arms, illegal_arms = _legal(actions, arms, ARM_ACTIONS[arm_action], entries, last)
    return LegalActions(cars=of_cars, arms=of_arms, illegal_cars=illegal_cars, illegal_arms=illegal_arms)


def _legal(
    actions: Mapping[str, Any], agents: Sequence[str], n_entries: int, own_entries: Sequence[int], last: float
) -> tuple[FloatArray, Bools]:
    """Actions of agents made legal, shape (n, n_entries), and which were not, shape (n,); those of agents with fewer
    `own_entries` have zeros before the last one."""
    rows = np.empty((len(agents), n_entries))
    missing = np.zeros(len(agents), dtype=np.bool_)
    for k, agent in enumerate(agents):
        action = actions.get(agent)
        if action is None:
            missing[k], rows[k], rows[k, -1] = True, 0.0, last
            continue
        n = own_entries[k] if own_entries else n_entries
        row = row_of(agent, action, n)
        if n == n_entries:
            rows[k] = row
        else:
            rows[k], rows[k, : n - 1], rows[k, -1] = 0.0, row[:-1], row[-1]
    make_legal(rows, missing)
    return rows, missing


@njit(cache=True)
def make_legal(rows: FloatArray, illegal: Bools) -> None:  # pragma: no cover - compiled
    """Make actions legal: entries that are no finite numbers 0, others between -1 and 1; notes rows that were not."""
    for k in range(len(rows)):
        for j in range(rows.shape[1]):
            value = rows[k, j]
            if not math.isfinite(value):
                rows[k, j], illegal[k] = 0.0, True
            elif value > 1.0 or value < -1.0:
                rows[k, j], illegal[k] = min(max(value, -1.0), 1.0), True
