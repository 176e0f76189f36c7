"""Hindrances: what keeps cars from driving as they are told: they are held, slow, or hear of it late."""

from __future__ import annotations

from collections import deque

import numpy as np

from fleet.arrays import FloatArray

HEARD_M = 0.05
"""How far a car drives at most before it hears what it is told [m]. Pure pursuit with a look-ahead of L at v [m/s]
stands a delay of 0.52 L / v (phase margin of its linear loop); L is 0.22 m at least and the wheels take 0.1 s to turn,
so this is half of what would let it swing ever wider about its lane."""


class Hindrances:
    """What hinders each car.

    Args:
        n_cars: Number of cars.
    """

    def __init__(self, n_cars: int) -> None:
        self._n_holds = np.zeros(n_cars, dtype=np.int64)
        self._pace = np.ones(n_cars)
        self._heard_mps = np.full(n_cars, np.inf)
        self._late: dict[int, deque[FloatArray]] = {}
        self.any = False
        """Whether any car is held, slow, or hears late."""
        self.held: list[int] = []
        """Cars that are held, ascending."""

    def hold(self, car: int) -> None:
        """Let a car stand still until as many calls of `let_go`, whatever else it is told."""
        self._count(car, 1)

    def let_go(self, car: int) -> None:
        """End a `hold`."""
        self._count(car, -1)

    def _count(self, car: int, change: int) -> None:
        self._n_holds[car] += change
        self.held = np.flatnonzero(self._n_holds > 0).tolist()
        self._look()

    def slow(self, car: int, factor: float) -> None:
        """Let a car drive at a fraction of its speed."""
        self._pace[car] = factor
        self._look()

    def delay(self, car: int, n_ticks: int, tick_s: float) -> None:
        """Let a car hear of its commands so many ticks late, and drive at most `HEARD_M` in that time."""
        self._late.pop(car, None)
        self._heard_mps[car] = np.inf
        if n_ticks > 0:
            self._late[car] = deque(maxlen=n_ticks + 1)
            self._heard_mps[car] = HEARD_M / (n_ticks * tick_s)
        self._look()

    def caps(self, caps: FloatArray) -> FloatArray:
        """Greatest speeds of the cars as they are hindered.

        Args:
            caps: Unhindered, shape (n_cars,) [m/s].

        Returns:
            Shape (n_cars,) [m/s].
        """
        if not self.any:
            return caps
        return np.where(self._n_holds > 0, 0.0, np.minimum(caps * self._pace, self._heard_mps))

    def late(self, commands: FloatArray) -> FloatArray:
        """Commands as cars hear them: the oldest ones kept, for cars that are late.

        Args:
            commands: Of this tick, shape (n_cars, 2); changed in place.

        Returns:
            The same array.
        """
        for car, kept in self._late.items():
            kept.append(commands[car].copy())
            commands[car] = kept[0]
        return commands

    def _look(self) -> None:
        self.any = bool(self.held) or bool(self._late) or bool((self._pace != 1.0).any())
