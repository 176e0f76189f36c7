"""DispatchVec: many fleets whose cars choose their tasks; see `fleet.envs.dispatch.env`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.abstract.fleet import TIMESTEP_S
from fleet.abstract.kernel import NONE
from fleet.envs.dispatch.env import TERMS, DispatchEnv, DispatchWeights
from fleet.envs.vector.dispatch_kernel import DispatchFloor, DispatchMemory, DispatchTables, begin_one, step_some
from fleet.envs.vector.layer_vec import Kernel, LayerVec
from fleet.tasks.order import Delivery
from maps.grid import GridMap
from maps.lane_graph import LaneGraph


class DispatchVec(LayerVec):
    """`DispatchEnv` at fidelity `grid`, many times.

    Args:
        single: An environment of the kind.
        n_envs: Number of environments.
        n_threads: Threads that share them; results do not depend on it.
    """

    single: DispatchEnv

    def __init__(self, single: DispatchEnv, n_envs: int, n_threads: int = 1) -> None:
        super().__init__(single, n_envs, n_threads, TERMS)
        config, place = single.config, single.place
        weights = config.weights or DispatchWeights()
        self._weights = tuple(float(getattr(weights, name)) for name in TERMS)
        self._n_timesteps = round(config.step_s / TIMESTEP_S)
        self._faults, self._battery = tuple(config.faults), tuple(config.battery)
        self._floor = tuple(place.floor)
        self._told = tuple(
            DispatchFloor(
                goal_row=place.goal_row,
                where=_where(place.graph, place.site.grid),
                pose=place.graph.state_pose,
                far_steps=place.far_steps,
            )
        )
        n, k = config.n_cars, config.candidates_n
        self._tables = DispatchTables(
            pressing=np.empty((n_envs, 0), dtype=np.int32),
            idle_steps=np.zeros((n_envs, n), dtype=np.int64),
            rows=np.zeros((n_envs, n, single.observer.n_numbers), dtype=np.float32),
            mask=np.zeros((n_envs, n, k + 1), dtype=np.int8),
            candidates=np.full((n_envs, n, k), NONE, dtype=np.int32),
            terms=np.zeros((n_envs, n, len(TERMS))),
            lost=np.zeros((n_envs, n), dtype=np.bool_),
            illegal=np.zeros((n_envs, n), dtype=np.bool_),
        )
        self._rows, self._mask, self._terms = self._tables.rows, self._tables.mask, self._tables.terms
        self._flags = {"waits": self._tables.lost, "illegal": self._tables.illegal}

    @property
    def candidates(self) -> npt.NDArray[np.int32]:
        """The task that each candidate of each car is, -1 for none, shape (B, n_cars, candidates_n)."""
        return self._tables.candidates

    def _memory(self) -> Any:
        n, capacity = self.single.config.n_cars, self._block.capacity
        task, pick, drop = np.zeros((3, capacity), dtype=np.int32)
        age_s, due_s = np.zeros((2, capacity))
        memory = DispatchMemory(
            claim=np.full(capacity, NONE, dtype=np.int32),
            wanted=np.zeros(n, dtype=np.int32),
            free=np.zeros(n, dtype=np.bool_),
            task=task,
            pick=pick,
            drop=drop,
            rank=np.zeros(capacity, dtype=np.int8),
            age_s=age_s,
            due_s=due_s,
            pressing=np.arange(capacity),
        )
        return tuple(self._block.stepping()), tuple(memory)

    def _open(self, index: int, orders: Sequence[Delivery], seed: int) -> None:
        self._put(index, orders, seed)
        block, tables = self._block, self._tables
        if tables.pressing.shape[1] < block.capacity:
            longer = np.zeros((self.n_envs, block.capacity), dtype=np.int32)
            longer[:, : tables.pressing.shape[1]] = tables.pressing
            self._tables = tables = tables._replace(pressing=longer)
        n = int(block.rows.n_tasks[index])
        # In the order of `DispatchObserver.look`, which does not change: what has been done falls out.
        tables.pressing[index, :n] = np.lexsort((block.tasks.due[index, :n], block.tasks.rank[index, :n]))
        begin_one(
            index,
            self._floor,
            self._told,
            block.arrays(),
            tuple(tables),
            *self._memories[0],
            self._faults,
            self._battery,
        )

    def _kernel(self, actions: npt.NDArray[np.int64], left: npt.NDArray[np.float64]) -> Kernel:
        block, tables = self._block.arrays(), tuple(self._tables)

        def run(first: int, last: int, memory: Any) -> None:
            step_some(
                first,
                last,
                self._floor,
                self._told,
                block,
                tables,
                *memory,
                actions,
                self._weights,
                self._faults,
                self._battery,
                self._n_timesteps,
                left,
            )

        return run


def _where(graph: LaneGraph, grid: GridMap) -> npt.NDArray[np.float32]:
    """What a car in each state is told of where it is, as `DispatchObserver` tells it, shape (n_states, 4)."""
    pose, size = graph.state_pose, np.array([grid.cols, grid.rows]) * grid.cell_m
    where = np.column_stack((2.0 * pose[:, :2] / size - 1.0, np.cos(pose[:, 2]), np.sin(pose[:, 2])))
    return where.astype(np.float32)
