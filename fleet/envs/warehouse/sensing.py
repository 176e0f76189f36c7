"""Sensing: what agents miss of what there is to see - distance, losses on the way, delay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from fleet.config import require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.warehouse.rows import Rows

MOST_DELAY = 100
"""Greatest delay [steps]."""


@dataclass(frozen=True, kw_only=True)
class Sensing:
    """How well the agents of a type observe.

    Raises:
        ConfigError: A setting is outside its valid range.
    """

    range_m: float = 3.0
    """Other cars, and an arm's parcels, are seen up to this distance [m]."""
    dropout: float = 0.0
    """Chance that an observation is lost, per agent and step; the agent then sees the last one that came."""
    delay_n: int = 0
    """An observation comes so many steps late."""

    def __post_init__(self) -> None:
        require(is_number(self.range_m) and 0.0 <= self.range_m <= 3.0, "range_m", self.range_m, "a number from 0 to 3")
        require(
            is_number(self.dropout) and 0.0 <= self.dropout < 1.0, "dropout", self.dropout, "a number from 0, below 1"
        )
        ok = is_whole(self.delay_n) and 0 <= self.delay_n <= MOST_DELAY
        require(ok, "delay_n", self.delay_n, f"an integer from 0 to {MOST_DELAY}")

    @classmethod
    def of(cls, given: Self | Mapping[str, Any] | None, what: str) -> Self:
        """Settings from a table of them, such as one of a file.

        Raises:
            ConfigError: It is none, or an entry is unknown or outside its valid range.
        """
        if isinstance(given, Mapping):
            valid = list(cls.__dataclass_fields__)
            for name in given:
                require(name in valid, what, name, ", ".join(valid))
            return cls(**given)
        require(given is None or isinstance(given, cls), what, given, f"a {cls.__module__}.{cls.__name__}, or None")
        return cls() if given is None else given

    @property
    def is_plain(self) -> bool:
        """Whether all that is seen comes, and at once."""
        return self.dropout == 0.0 and self.delay_n == 0


class Receiver:
    """Hands on the rows of agents of a type, as far as they come.

    Args:
        sensing: What is lost.
        rng: Source of chance.
    """

    def __init__(self, sensing: Sensing, rng: np.random.Generator) -> None:
        self._sensing = sensing
        self._rng = rng
        self._under_way: list[Rows] = []  # the latest one last
        self._seen: Rows = np.zeros((0, 0), dtype=np.float32)

    def receive(self, rows: Rows) -> Rows:
        """What agents see now, in an array of the caller's own.

        Args:
            rows: What there is to see, shape (n, k).
        """
        sensing = self._sensing
        if sensing.is_plain:
            return rows.copy()
        first = not self._under_way
        self._under_way.append(rows.copy())
        if len(self._under_way) > sensing.delay_n + 1:
            del self._under_way[0]
        comes = self._under_way[0]
        # What there was at the beginning is known.
        lost = self._rng.random(len(rows)) < sensing.dropout
        self._seen = comes.copy() if first else np.where(lost[:, None], self._seen, comes)
        return self._seen.copy()
