"""Pace: how a run of the League went on over time, and whether somebody stood for long."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from maps.formats.lorr import FORWARD, LeagueResult


def finished_in_blocks(result: LeagueResult, block: int) -> npt.NDArray[np.int64]:
    """Tasks finished in each whole block of timesteps, shape (timesteps // block,).

    Args:
        result: A run.
        block: Timesteps of a block, >= 1.
    """
    problem = result.problem
    step, _, task, done = result.events.T.astype(np.int64)
    row = task % problem.n_tasks
    last = done == (problem.errand_ptr[row + 1] - problem.errand_ptr[row])
    n_blocks = len(result.actual) // block
    # The first timestep is number 1.
    counts = np.bincount((step[last] - 1) // block, minlength=n_blocks)
    return counts[:n_blocks].astype(np.int64)


def longest_stand(result: LeagueResult) -> int:
    """Most timesteps in a row in which a robot did not leave its cell though it had a task all that time."""
    n_steps, n = result.actual.shape
    has_task = np.full(n, result.problem.round_robin)
    standing = np.zeros(n, dtype=np.int64)
    longest = 0
    # The first timestep is number 1; what is changed in a timestep holds for it.
    changes = result.schedule[np.argsort(result.schedule[:, 0], kind="stable")]
    bounds = np.searchsorted(changes[:, 0], np.arange(1, n_steps + 2))
    bounds[0] = 0  # in a run in ticks the first schedule holds before the first one
    for step in range(n_steps):
        change = changes[bounds[step] : bounds[step + 1]]
        has_task[change[:, 1]] = change[:, 2] >= 0
        standing = np.where(has_task & (result.actual[step] != FORWARD), standing + 1, 0)
        longest = max(longest, int(standing.max(initial=0)))
    return longest
