"""Make a `VecEnv`: by kernels where a layer has them, else of environments that are stepped one after the other."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any

from fleet.config import Fidelity, require
from fleet.config.field_checks import is_whole
from fleet.envs import ENVIRONMENTS
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.layers.layer import LayerEnv
from fleet.envs.traffic.env import TrafficEnv
from fleet.envs.vector.dispatch_vec import DispatchVec
from fleet.envs.vector.loop import LoopVec
from fleet.envs.vector.traffic_vec import TrafficVec
from fleet.envs.vector.vec_env import VecEnv
from fleet.envs.warehouse.config import WarehouseConfig

_KERNELS: dict[type[LayerEnv[Any]], Callable[[Any, int, int], VecEnv]] = {
    DispatchEnv: DispatchVec,
    TrafficEnv: TrafficVec,
}
"""Environments that have a kernel for many of them, at fidelity `grid`."""


def make(layer: str, n_envs: int, n_threads: int, arguments: Mapping[str, Any]) -> VecEnv:
    """See `fleet.envs.make_vec`."""
    modules = {name.rpartition("_")[0]: name for name in ENVIRONMENTS}
    require(layer in modules, "layer", layer, ", ".join(modules))
    module = importlib.import_module(f"fleet.envs.{modules[layer]}")
    return vec_of(lambda: module.parallel_env(**arguments), n_envs, n_threads)


def vec_of(one: Callable[[], Any], n_envs: int, n_threads: int = 1) -> VecEnv:
    """Several environments of one kind, stepped together.

    Args:
        one: Makes one of them; all are alike.
        n_envs: Number of environments.
        n_threads: Threads that share the environments, where a kernel steps them.

    Raises:
        ConfigError: A number is outside its valid range, or agents of the environments come and go.
    """
    require(is_whole(n_envs) and n_envs >= 1, "n_envs", n_envs, "an integer >= 1")
    require(is_whole(n_threads) and n_threads >= 1, "n_threads", n_threads, "an integer >= 1")
    first = one()
    kernel = _KERNELS.get(type(first))
    if kernel is not None and first.config.fidelity == Fidelity.GRID:
        return kernel(first, n_envs, n_threads)
    if isinstance(first.config, WarehouseConfig):
        first.config.require_lasting_agents()
    return LoopVec([first, *(one() for _ in range(n_envs - 1))])
