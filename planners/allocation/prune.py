"""Candidates: the few pairs that are worth a look, when all of them are too many."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidates:
    """Pairs to choose from; no pair stands there twice."""

    vehicle: npt.NDArray[np.int32]
    """Shape (n_pairs,)."""
    task: npt.NDArray[np.int32]
    """Shape (n_pairs,)."""
    cost: npt.NDArray[np.float64]
    """Finite, shape (n_pairs,)."""
    shape: tuple[int, int]
    """Vehicles and tasks."""


def prune(cost: npt.NDArray[np.float64], nearest_n: int) -> Candidates:
    """Keep the cheapest tasks of each vehicle that are allowed.

    Args:
        cost: Cost of each task for each vehicle, inf = not allowed, shape (n_vehicles, n_tasks).
        nearest_n: Tasks that a vehicle keeps at most, >= 1.
    """
    n_vehicles, n_tasks = cost.shape
    kept = min(nearest_n, n_tasks)
    if kept == n_tasks:
        task = np.broadcast_to(np.arange(n_tasks), cost.shape)
    else:
        task = np.argpartition(cost, kept - 1, axis=1)[:, :kept]
    chosen = np.take_along_axis(cost, task, axis=1)
    vehicle = np.broadcast_to(np.arange(n_vehicles)[:, None], task.shape)
    allowed = np.isfinite(chosen)
    return Candidates(
        vehicle=vehicle[allowed].astype(np.int32),
        task=task[allowed].astype(np.int32),
        cost=chosen[allowed],
        shape=(n_vehicles, n_tasks),
    )
