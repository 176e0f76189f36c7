"""Motors: when cars can drive - some set out late, and some stand still for a while now and then."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fleet.arrays import BoolArray, FloatArray

STOP_S = (2.0, 6.0)
"""Least and greatest time for which a car stands [s]."""


class Motors:
    """When each car's motor runs, in an episode: drawn at its beginning, whatever agents do.

    Args:
        late_s: A motor starts after a delay from 0 to this [s].
        stops_per_min: How often a motor stops, per minute in which it runs.
        duration_s: Length of the episode [s].
        rngs: Source of chance of each car.
    """

    def __init__(
        self, late_s: float, stops_per_min: float, duration_s: float, rngs: Sequence[np.random.Generator]
    ) -> None:
        pauses = [_pauses(late_s, stops_per_min, duration_s, rng) for rng in rngs]
        most = max(map(len, pauses))
        # Filled up with pauses that never begin.
        padded = [own + [(np.inf, np.inf)] * (most - len(own)) for own in pauses]
        self.pauses: FloatArray = np.array(padded).reshape(len(rngs), most, 2)
        """Times at which each motor stops and starts again [s], shape (n_cars, n, 2)."""

    def run(self, now_s: float) -> BoolArray:
        """Which cars' motors run now, shape (n_cars,)."""
        stands = (self.pauses[:, :, 0] <= now_s) & (now_s < self.pauses[:, :, 1])
        return np.asarray(~stands.any(axis=1))


def _pauses(
    late_s: float, stops_per_min: float, duration_s: float, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Pauses of one car, the first one before it sets out."""
    start_s = float(rng.uniform(0.0, late_s))
    pauses = [(0.0, start_s)]
    while stops_per_min > 0.0:
        stop_s = start_s + float(rng.exponential(60.0 / stops_per_min))
        if stop_s >= duration_s:
            break
        start_s = stop_s + float(rng.uniform(*STOP_S))
        pauses.append((stop_s, start_s))
    return pauses
