"""A driver whose cars are told when they are late, for tests without a world."""

from __future__ import annotations

import numpy as np

from maps.lane_graph import LaneGraph


class Drivers:
    """Everybody ends a move in the tick after its grant, but those that are late."""

    def __init__(self) -> None:
        self.late: set[int] = set()
        self.driven: list[tuple[int, int]] = []
        self.braked: set[int] = set()
        self._doing: list[int] = []

    def brake(self, car: int, on: bool) -> None:
        (self.braked.add if on else self.braked.discard)(car)

    def extend_lanes(self, graph: LaneGraph) -> None:
        pass

    def append(self, cars: np.ndarray, moves: np.ndarray) -> None:
        self.driven += zip(cars.tolist(), moves.tolist(), strict=True)
        self._doing += cars.tolist()

    def commands(self, world: object) -> np.ndarray:
        del world
        return np.zeros((0, 2))

    def finished(self) -> np.ndarray:
        done = [car for car in self._doing if car not in self.late]
        self._doing = [car for car in self._doing if car in self.late]
        return np.array(done, dtype=np.int32)
