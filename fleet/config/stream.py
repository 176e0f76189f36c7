"""Settings of generated orders that arrive over time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fleet.config.choices import StreamKind
from fleet.config.settings import Settings, not_negative, positive, require

RATES_PER_H = (1e-3, 1e6)
"""Least and greatest rate of a stream: from one order in six weeks to more than any site can take."""


@dataclass(frozen=True, kw_only=True)
class StreamConfig(Settings):
    """A stream of generated orders with due dates and priorities."""

    kind: StreamKind = StreamKind.POISSON
    rate_per_h: float = 120.0
    """Mean number of orders per hour."""
    wave_s: float = 600.0
    """Time from the beginning of one wave to that of the next [s]."""
    wave_share: float = 0.2
    """Part of that time in which the orders of a wave arrive."""
    zipf: float = 1.0
    """Exponent of a skewed stream: the k-th most popular station is drawn with a weight of 1 / k ** zipf."""
    bottleneck_n: int = 0
    """So many of the pick stations are a bottleneck, drawn anew for every stream; 0 = none."""
    bottleneck_share: float = 0.7
    """Part of the orders that begin at them."""
    sources_n: int = 1
    """So many pick stations have what is ordered, at most all; 1 = it lies at one alone."""
    due_share: float = 0.8
    """Part of the orders that have a due date."""
    slack_s: tuple[float, float] = (120.0, 600.0)
    """Least and greatest time from release to due date [s], drawn evenly."""
    emergency_share: float = 0.05
    """Part of the orders in the class `emergency`."""
    idle_share: float = 0.15
    """Part of the orders in the class `idle`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.kind in list(StreamKind), "--stream", self.kind, ", ".join(StreamKind))
        object.__setattr__(self, "kind", StreamKind(self.kind))
        least_per_h, most_per_h = RATES_PER_H
        require(
            least_per_h <= self.rate_per_h <= most_per_h,
            "--rate",
            self.rate_per_h,
            f"a number from {least_per_h:g} to {most_per_h:g}",
        )
        positive("stream.wave_s", self.wave_s)
        not_negative("stream.zipf", self.zipf)
        require(0 < self.wave_share <= 1, "stream.wave_share", self.wave_share, "a number > 0, at most 1")
        not_negative("stream.bottleneck_n", self.bottleneck_n)
        require(self.sources_n >= 1, "stream.sources_n", self.sources_n, "an integer >= 1")
        for name in ("bottleneck_share", "due_share", "emergency_share", "idle_share"):
            require(0 <= getattr(self, name) <= 1, f"stream.{name}", getattr(self, name), "a number from 0 to 1")
        classes = self.emergency_share + self.idle_share
        require(classes <= 1, "stream.emergency_share + stream.idle_share", classes, "at most 1")
        low, high = self.slack_s
        require(0 <= low <= high < math.inf, "stream.slack_s", self.slack_s, "two numbers >= 0, ascending")
