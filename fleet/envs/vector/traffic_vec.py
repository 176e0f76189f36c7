"""TrafficVec: many fleets whose cars choose their moves; see `fleet.envs.traffic.env`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.abstract.fleet import N_KINDS
from fleet.envs.traffic.env import TERMS, TrafficEnv, TrafficWeights
from fleet.envs.traffic.view import N_ROW_NUMBERS, TrafficObserver
from fleet.envs.vector.layer_vec import Kernel, LayerVec
from fleet.envs.vector.traffic_kernel import TrafficMemory, TrafficTables, begin_one, step_some
from fleet.tasks.order import Delivery


class TrafficVec(LayerVec):
    """`TrafficEnv` at fidelity `grid`, many times.

    Args:
        single: An environment of the kind.
        n_envs: Number of environments.
        n_threads: Threads that share them; results do not depend on it.
    """

    single: TrafficEnv

    def __init__(self, single: TrafficEnv, n_envs: int, n_threads: int = 1) -> None:
        super().__init__(single, n_envs, n_threads, TERMS)
        config, place = single.config, single.place
        weights = config.weights or TrafficWeights()
        self._weights = tuple(float(getattr(weights, name)) for name in TERMS)
        self._team_share = float(config.team_share)
        self._floor = tuple(place.floor)
        self._told = tuple(TrafficObserver(place, config.n_cars).surroundings)
        n = config.n_cars
        waits, pushed, illegal = np.zeros((3, n_envs, n), dtype=np.bool_)
        tables = TrafficTables(
            rows=np.zeros((n_envs, n, N_ROW_NUMBERS), dtype=np.float32),
            mask=np.zeros((n_envs, n, 1 + N_KINDS), dtype=np.int8),
            terms=np.zeros((n_envs, n, len(TERMS))),
            waits=waits,
            pushed=pushed,
            illegal=illegal,
        )
        self._rows, self._mask, self._terms = tables.rows, tables.mask, tables.terms
        self._flags = {"waits": waits, "pushed": pushed, "illegal": illegal}
        self._tables = tuple(tables)

    def _memory(self) -> Any:
        place, n = self.single.place, self.single.config.n_cars
        memory = TrafficMemory(wanted=np.zeros(n, dtype=np.int32), asked=np.zeros(place.graph.n_cells, dtype=np.bool_))
        return tuple(self._block.stepping()), tuple(TrafficObserver(place, n).memory), tuple(memory)

    def _open(self, index: int, orders: Sequence[Delivery], seed: int) -> None:
        del seed  # `GridTraffic` takes none
        self._put(index, orders, 0)
        stepping, cells, _ = self._memories[0]
        begin_one(index, self._floor, self._told, self._block.arrays(), self._tables, stepping, cells)

    def _kernel(self, actions: npt.NDArray[np.int64], left: npt.NDArray[np.float64]) -> Kernel:
        del left  # cars are not told of it
        block = self._block.arrays()

        def run(first: int, last: int, memory: Any) -> None:
            step_some(
                first,
                last,
                self._floor,
                self._told,
                block,
                self._tables,
                *memory,
                actions,
                self._weights,
                self._team_share,
            )

        return run
