"""A driver whose cars are told when they are late, for tests without a world."""

from __future__ import annotations

import numpy as np


class Drivers:
    """Everybody ends a move in the tick after its grant, but those that are late."""

    def __init__(self) -> None:
        self.late: set[int] = set()
        self.driven: list[tuple[int, int]] = []
        self._doing: list[int] = []

    def append(self, car: int, move: int) -> None:
        self.driven.append((car, move))
        self._doing.append(car)

    def commands(self, world: object) -> np.ndarray:
        del world
        return np.zeros((0, 2))

    def finished(self) -> list[int]:
        done = [car for car in self._doing if car not in self.late]
        self._doing = [car for car in self._doing if car in self.late]
        return done
