"""RowPolicy: a function from rows of observations to rows of actions, as a policy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.training.batch import vector


class RowPolicy:
    """Plays teams of one type.

    Args:
        actions: Takes shape (n, n_observed), gives one row per agent.
    """

    def __init__(self, actions: Callable[[npt.NDArray[np.float32]], npt.NDArray[Any]]) -> None:
        self._actions = actions

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del env
        rows = np.stack([vector(seen) for seen in observations.values()])
        return dict(zip(observations, self._actions(rows), strict=True))
