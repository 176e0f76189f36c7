"""Breakdowns: cars that stop for a while, and cars that are lost for good."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.config import require
from fleet.config.field_checks import is_number

_MOST_PER_H = 3600.0


@dataclass(frozen=True, kw_only=True)
class Breakdowns:
    """How often agents' cars break down; times between two are exponential.

    Raises:
        ConfigError: A setting is outside its valid range.
    """

    stops_per_h: float = 0.0
    """How often a car stops by itself, per hour, and brakes for `stop_s`."""
    stop_s: float = 20.0
    """How long it stands then [s]."""
    losses_per_h: float = 0.0
    """How often a car is lost for the rest of the episode, per hour."""

    def __post_init__(self) -> None:
        for name in ("stops_per_h", "losses_per_h"):
            value = getattr(self, name)
            ok = is_number(value) and 0.0 <= value <= _MOST_PER_H
            require(ok, f"breakdowns.{name}", value, f"a number from 0 to {_MOST_PER_H:g}")
        require(is_number(self.stop_s) and self.stop_s > 0, "breakdowns.stop_s", self.stop_s, "a number > 0")

    @classmethod
    def of(cls, given: Self | Mapping[str, Any] | None) -> Self:
        """Settings from a table of them, such as one of a file.

        Raises:
            ConfigError: It is none, or an entry is unknown or outside its valid range.
        """
        if isinstance(given, Mapping):
            valid = list(cls.__dataclass_fields__)
            for name in given:
                require(name in valid, "breakdowns", name, ", ".join(valid))
            return cls(**given)
        ok = given is None or isinstance(given, cls)
        require(ok, "breakdowns", given, f"a {cls.__module__}.{cls.__name__}, or None")
        return cls() if given is None else given


class BreakdownClock:
    """Tells which cars are out of order.

    Args:
        breakdowns: How often they are.
        n_cars: Number of cars.
        rng: Source of chance.
    """

    def __init__(self, breakdowns: Breakdowns, n_cars: int, rng: np.random.Generator) -> None:
        self._breakdowns = breakdowns
        self._rng = rng
        self.in_order: npt.NDArray[np.bool_] = np.ones(n_cars, dtype=np.bool_)
        """False for a car that stands still whatever it is told, shape (n_cars,)."""
        self._lost_s = self._drawn(n_cars, breakdowns.losses_per_h)
        self._stops_s = self._drawn(n_cars, breakdowns.stops_per_h)

    def look(self, now_s: float) -> list[int]:
        """Find out which cars are out of order now [s]; returns those that were lost since the last look."""
        breakdowns = self._breakdowns
        if breakdowns.stops_per_h == 0.0 and breakdowns.losses_per_h == 0.0:
            return []
        over = now_s >= self._stops_s + breakdowns.stop_s
        if over.any():
            self._stops_s[over] = now_s + self._drawn(int(over.sum()), breakdowns.stops_per_h)
        lost = np.flatnonzero((self._lost_s <= now_s) & np.isfinite(self._lost_s))
        self._lost_s[lost] = -np.inf
        self.in_order = (now_s < self._stops_s) & (self._lost_s > now_s)
        return lost.tolist()

    def _drawn(self, n: int, per_h: float) -> FloatArray:
        """Times until the next breakdown [s], shape (n,)."""
        return self._rng.exponential(3600.0 / per_h, n) if per_h > 0.0 else np.full(n, np.inf)
