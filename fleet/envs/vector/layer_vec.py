"""LayerVec: what the kernels of the layers above robots share - a block of fleets, series of episodes, threads."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.abstract.block import GridBlock
from fleet.config import require
from fleet.config.field_checks import is_whole
from fleet.envs.core.choices import ILLEGAL, whole_numbers
from fleet.envs.layers.layer import LayerEnv
from fleet.envs.vector.vec_env import Arrays, VecEnv, VecStep, VecView
from fleet.tasks.order import Delivery

CAR = "car"
"""The only type of agents of these layers."""
Kernel = Callable[[int, int, Any], None]
"""Steps the environments from one to before another, in the memory of one thread."""


class LayerVec(VecEnv):
    """Fleets on the grid, all in one block of arrays.

    Orders are drawn in Python when an episode begins, by the generators of the single environment; all else is kernels,
    so that what a step takes of Python does not depend on how many cars and environments there are.

    A subclass owns the arrays that it declares here, and writes `_memory`, `_open` and `_kernel`.

    Args:
        single: An environment of the kind, at fidelity `grid`.
        n_envs: Number of environments.
        n_threads: Threads that share them; results do not depend on it.
        terms: Names of the terms of the reward.
    """

    single: LayerEnv[Any]
    _rows: npt.NDArray[np.float32]
    _mask: npt.NDArray[np.int8]
    _terms: npt.NDArray[np.float64]
    _flags: dict[str, npt.NDArray[np.bool_]]
    """What else infos tell, by name."""

    def __init__(self, single: LayerEnv[Any], n_envs: int, n_threads: int, terms: tuple[str, ...]) -> None:
        super().__init__(single, n_envs)
        require(is_whole(n_threads) and n_threads >= 1, "n_threads", n_threads, "an integer >= 1")
        config = single.config
        self._names = terms
        self._block = GridBlock(single.place, config.n_cars, n_envs)
        self._n_steps = np.zeros(n_envs, dtype=np.int64)
        self._series = [np.random.default_rng(config.seed + index) for index in range(n_envs)]
        bounds = np.linspace(0, n_envs, min(n_threads, n_envs) + 1).astype(int).tolist()
        self._shares = list(pairwise(bounds))
        self._threads = ThreadPoolExecutor(len(self._shares)) if len(self._shares) > 1 else None
        self._memories: list[Any] = []

    def state(self) -> npt.NDArray[np.float32]:
        """See `VecEnv`."""
        return self._rows.reshape(self.n_envs, -1).copy()

    def close(self) -> None:
        """See `VecEnv`."""
        super().close()
        if self._threads is not None:
            self._threads.shutdown()

    @abstractmethod
    def _memory(self) -> Any:
        """Memory for one thread, as the kernels take it."""

    @abstractmethod
    def _open(self, index: int, orders: Sequence[Delivery], seed: int) -> None:
        """Begin an episode of an environment, from `_put` on, and observe it.

        Args:
            index: Which environment.
            orders: Deliveries, ascending in release.
            seed: Of its fleet.
        """

    @abstractmethod
    def _kernel(self, actions: npt.NDArray[np.int64], left: npt.NDArray[np.float64]) -> Kernel:
        """What makes a step.

        Args:
            actions: Whole numbers, shape (B, n_cars).
            left: Share of each episode that is left after the step, shape (B,).
        """

    def _reset(self, seeds: list[int]) -> VecView:
        if seeds:
            self._series = [np.random.default_rng(seed) for seed in seeds]
        return self._restart(range(self.n_envs))

    def _restart(self, indices: Sequence[int]) -> VecView:
        for index in indices:
            self._begin(index)
        return self._view()

    def _step(self, actions: Arrays) -> VecStep:
        self._n_steps += 1
        left = np.maximum(0.0, 1.0 - self._n_steps / self.single.max_cycles)
        run = self._kernel(self._whole(actions), left)
        if self._threads is None:
            run(0, self.n_envs, self._memories[0])
        else:
            shares = zip(self._shares, self._memories, strict=True)
            for done in [self._threads.submit(run, *share, memory) for share, memory in shares]:
                done.result()
        rewards = self._terms.sum(axis=2)
        infos: Arrays = {name: self._terms[:, :, k] for k, name in enumerate(self._names)}
        infos |= self._flags
        truncated = self._n_steps >= self.single.max_cycles
        final, final_state = None, None
        if truncated.any():
            final, final_state = self._view().copy(), self.state()
            infos = {name: array.copy() for name, array in infos.items()}
            self._restart(np.flatnonzero(truncated).tolist())
        view = self._view()
        return VecStep(
            observations=view.observations,
            masks=view.masks,
            rewards={CAR: rewards},
            terminated=np.zeros(self.n_envs, dtype=np.bool_),
            truncated=truncated,
            final=final,
            final_state=final_state,
            infos={CAR: infos},
        )

    def _begin(self, index: int) -> None:
        """Begin the next episode of an environment's series, as `FleetEnv.reset` and `LayerEnv` do."""
        orders, seed = self.single.drawn(int(self._series[index].integers(2**31)))
        self._n_steps[index] = 0
        self._open(index, orders, seed)

    def _put(self, index: int, orders: Sequence[Delivery], seed: int) -> None:
        """Put a fleet where its episode begins, and see to it that memories have room for its tasks."""
        room = self._block.capacity
        self._block.begin(index, orders, seed)
        if not self._memories or self._block.capacity > room:
            self._memories = [self._memory() for _ in self._shares]

    def _view(self) -> VecView:
        return VecView(observations={CAR: self._rows}, masks={CAR: self._mask})

    def _whole(self, actions: Arrays) -> npt.NDArray[np.int64]:
        """Actions as whole numbers; those that are none become `ILLEGAL`, as in `whole_numbers`."""
        given = actions.get(CAR)
        if given is None:
            missing = whole_numbers({}, [CAR])[0]
            return np.full((self.n_envs, self.single.config.n_cars), missing)
        if given.dtype.kind != "f":
            return np.ascontiguousarray(given, dtype=np.int64)
        whole = (given == np.rint(given)) & (np.abs(given) < 2**31)
        return np.where(whole, given, ILLEGAL).astype(np.int64)
