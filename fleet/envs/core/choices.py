"""Choices of many agents at once: read from dictionaries, and given to one agent each."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.envs.core.base import ActionError
from maps.reading.shown import shown

Int64Array = npt.NDArray[np.int64]
ILLEGAL = -1
"""What an action becomes that is missing or no whole number."""
_NUMBERS = "iuf"
"""Kinds of numpy's types that are numbers."""


def whole_numbers(actions: Mapping[str, Any], agents: list[str]) -> Int64Array:
    """Actions as whole numbers in the order of the agents, shape (n,).

    Agents that are missing, None and numbers that are not whole, nan among them, become `ILLEGAL`.

    Raises:
        ActionError: An action is no number, or more than one; texts are none, truth values are 0 and 1.
    """
    in_order = len(actions) == len(agents) and list(actions) == agents
    values = list(actions.values()) if in_order else [actions.get(agent) for agent in agents]
    with suppress(ValueError):  # of unequal shapes
        found = np.array(values)
        if found.shape == (len(agents),) and found.dtype.kind in "iu":
            return found.astype(np.int64)
    return np.array([_whole(agent, value) for agent, value in zip(agents, values, strict=True)], dtype=np.int64)


def row_of(agent: str, action: Any, n_entries: int) -> npt.NDArray[np.float64]:
    """A continuous action as a row of numbers, shape (n_entries,).

    Raises:
        ActionError: It is no row of so many numbers; texts and truth values are none.
    """
    try:
        row = np.asarray(action)
    except (TypeError, ValueError, OverflowError) as reason:
        raise ActionError(f"action of {agent} is {shown(action)}; valid: {n_entries} numbers in [-1, 1]") from reason
    if row.dtype.kind not in _NUMBERS:
        raise ActionError(f"action of {agent} is {shown(action)}; valid: {n_entries} numbers in [-1, 1]")
    if row.shape != (n_entries,):
        raise ActionError(f"action of {agent} has shape {row.shape}; valid: ({n_entries},)")
    return row.astype(np.float64)


def resolve_choices(wanted: npt.NDArray[np.integer[Any]], priority: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Which agents get what they want, where each thing goes to one only.

    Args:
        wanted: Thing that each agent wants, negative = none, shape (n,).
        priority: Larger goes first, of equal ones the lower index, shape (n,).

    Returns:
        True for each agent that gets its thing, shape (n,).
    """
    order = np.argsort(-np.asarray(priority), kind="stable")
    order = order[wanted[order] >= 0]
    won = np.zeros(len(wanted), dtype=np.bool_)
    won[order[np.unique(wanted[order], return_index=True)[1]]] = True
    return won


def _whole(agent: str, value: Any) -> int:
    if value is None:
        return ILLEGAL
    try:
        found = np.asarray(value)
    except (TypeError, ValueError, OverflowError) as reason:  # such as lists of unequal lengths
        raise ActionError(f"action of {agent} is {shown(value)}; valid: one whole number") from reason
    if found.size != 1 or found.dtype.kind not in f"b{_NUMBERS}":
        raise ActionError(f"action of {agent} is {shown(value)}; valid: one whole number")
    number = float(found.reshape(()))
    return int(number) if number == np.rint(number) and abs(number) < 2**31 else ILLEGAL
