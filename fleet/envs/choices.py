"""Choices of many agents at once: read from dictionaries, and given to one agent each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.envs.base import ActionError

Longs = npt.NDArray[np.int64]
ILLEGAL = -1
"""What an action becomes that is no whole number."""


def whole_numbers(actions: Mapping[str, Any], agents: list[str]) -> Longs:
    """Actions as whole numbers in the order of the agents, shape (n,); 0 for agents that are missing.

    Numbers that are not whole, nan among them, become `ILLEGAL`.

    Raises:
        ActionError: An action is no number, or more than one.
    """
    in_order = len(actions) == len(agents) and list(actions) == agents
    values = list(actions.values()) if in_order else [actions.get(agent, 0) for agent in agents]
    try:
        found = np.array(values)
        if found.shape == (len(agents), 1):
            found = found[:, 0]
        if found.shape == (len(agents),) and found.dtype.kind in "iub":
            return found.astype(np.int64)
        return np.array([_whole(value) for value in values], dtype=np.int64)
    except (ValueError, TypeError, OverflowError):
        bad = next(agent for agent, value in zip(agents, values, strict=True) if not _is_number(value))
        raise ActionError(f"action of {bad} is {actions[bad]!r}; valid: one whole number") from None


def resolve_choices(wanted: npt.NDArray[np.integer[Any]], priority: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Who gets what he wants, if a thing goes to one only.

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


def _is_number(value: Any) -> bool:
    try:
        _whole(value)
    except (ValueError, TypeError, OverflowError):
        return False
    return True


def _whole(value: Any) -> int:
    if value is None:
        return 0
    number = float(np.asarray(value).reshape(()) if np.size(value) == 1 else value)
    return int(number) if np.isfinite(number) and number == int(number) and abs(number) < 2**31 else ILLEGAL
