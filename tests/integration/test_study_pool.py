"""Processes of a study that are killed cost time, not rows."""

from __future__ import annotations

import multiprocessing
from dataclasses import replace

import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.errors import BrokenRunError
from fleet.study.backend import N_RESTARTS
from fleet.study.pool import run_all

CONFIG = RunConfig(site="cell", robots=1, fidelity=Fidelity.GRID, duration_s=20.0, arms=ArmConfig(workers_n=0))


def kill_all() -> int:
    """Kill the processes there are; returns how many."""
    killed = multiprocessing.active_children()
    for process in killed:
        process.kill()
        process.join()
    return len(killed)


def test_the_runs_that_are_left_are_done_by_others() -> None:
    seeds, n_killed = [], 0
    for row in run_all([replace(CONFIG, seed=seed) for seed in range(3)], 1, []):
        if row is not None:
            seeds.append(row.seed)
            n_killed += kill_all() if len(seeds) == 1 else 0
    assert n_killed == 1
    assert sorted(seeds) == [0, 1, 2]
    assert multiprocessing.active_children() == []


def test_processes_that_die_again_and_again_end_the_study() -> None:
    killed: list[int] = []
    with pytest.raises(BrokenRunError, match=r"died 3 times without a new row.*valid: fewer --jobs, then --resume"):
        killed.extend(kill_all() for _ in run_all([CONFIG], 1, []))
    assert sum(killed) == N_RESTARTS + 1
    assert multiprocessing.active_children() == []
