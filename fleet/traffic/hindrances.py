"""Hindrances: what keeps cars from driving as they are told: they are held, slow, or hear of it late."""

from __future__ import annotations

from collections import deque

import numpy as np

from fleet.arrays import FloatArray


class Hindrances:
    """What hinders each car.

    Args:
        n_cars: Number of cars.
    """

    def __init__(self, n_cars: int) -> None:
        self._n_holds = np.zeros(n_cars, dtype=np.int64)
        self._pace = np.ones(n_cars)
        self._late: dict[int, deque[FloatArray]] = {}
        self.any = False
        """Whether any car is held or slow."""
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

    def delay(self, car: int, n_ticks: int) -> None:
        """Let a car hear of its commands so many ticks late."""
        self._late.pop(car, None)
        if n_ticks > 0:
            self._late[car] = deque(maxlen=n_ticks + 1)

    def caps(self, caps: FloatArray) -> FloatArray:
        """Greatest speeds of the cars as they are hindered.

        Args:
            caps: Unhindered, shape (n_cars,) [m/s].

        Returns:
            Shape (n_cars,) [m/s].
        """
        return np.where(self._n_holds > 0, 0.0, caps * self._pace) if self.any else caps

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
        self.any = bool(self.held) or bool((self._pace != 1.0).any())
