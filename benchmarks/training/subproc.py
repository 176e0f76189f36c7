"""Processes: what a second one brings to robots that are stepped by `SubprocVecEnv` of Stable-Baselines3, in wall time.

Alone among the figures of training this needs cores of its own: on a machine that does other things, or has one core,
it says nothing.
"""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import numpy.typing as npt

from benchmarks.harness import Kind, Row, Trial

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

ROBOTS = {"CarNavigate": "fleet.envs:fleet/CarNavigate-v1", "KukaReach": "fleet.envs:fleet/KukaReach-v0"}
N_PROCESSES = 2
TARGET = ">= 1.6"
N_ACTIONS = 64
"""Sets of actions drawn in advance, used in turn."""
WARM_STEPS = 60
"""Steps before anything is measured: kernels are compiled in each process."""
N_CHECKED = 20
"""First steps, which must be the same wherever an environment is stepped."""
SECONDS = (0.5, 2.0)
"""Length of a round, of a quick run and of a full one [s]."""


def measure_subproc(trial: Trial) -> Iterator[Row]:
    """Steps per second of two processes, of one, and of none."""
    if importlib.util.find_spec("stable_baselines3") is None:
        trial.notes.append("subproc: left out, Stable-Baselines3 is not installed: pip install '.[sb3]'")
        return
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    n_rounds, seconds = (4, SECONDS[0]) if trial.quick else (12, SECONDS[1])
    busy = os.getloadavg()[0]
    for name, known in ROBOTS.items():
        make = partial(gymnasium.make, known, fidelity="physics")
        vectors: list[VecEnv] = [
            SubprocVecEnv([make] * N_PROCESSES),
            SubprocVecEnv([make]),
            DummyVecEnv([make]),
        ]
        first = [_begun(vector)[0] for vector in vectors]
        trial.check(all(np.array_equal(first[0], one) for one in first), f"{name}: processes play differently")
        players = [_player(vector) for vector in vectors]
        # In turns, so that all meet the same load.
        rates = np.array([[_rate(player, seconds) for player in players] for _ in range(n_rounds)])
        for vector in vectors:
            vector.close()
        many, one, none = np.median(rates, axis=0) * [N_PROCESSES, 1, 1]
        gain, gain_over_none = (float(np.median(N_PROCESSES * rates[:, 0] / rates[:, k])) for k in (1, 2))
        yield Row(name=f"{name}, physics, {N_PROCESSES} processes", value=many, unit="steps/s", kind=Kind.RATE)
        yield Row(name="  one process", value=one, unit="steps/s", kind=Kind.RATE)
        yield Row(name="  none: stepped where it is asked", value=none, unit="steps/s", kind=Kind.RATE)
        yield Row(name=f"  {N_PROCESSES} processes against one", value=gain, unit="times", target=TARGET)
        yield Row(name=f"  {N_PROCESSES} processes against none", value=gain_over_none, unit="times")
    trial.notes.append(
        "Steps of robots per second of wall time, one environment in a process, random actions, resets included; "
        f"medians of rounds in turns, gains round by round. When it began, {busy:.1f} processes ran or waited on "
        f"{len(os.sched_getaffinity(0))} cores: above 0.5, what two processes gain is not seen."
    )


def _begun(vector: VecEnv) -> npt.NDArray[Any]:
    """Rows of the first environment in the first steps of the first episode."""
    vector.seed(0)
    rows = [np.asarray(vector.reset())[0]]
    rng = np.random.default_rng(0)
    for _ in range(N_CHECKED):
        action = rng.uniform(-1.0, 1.0, vector.action_space.shape or ()).astype(np.float32)
        rows.append(np.asarray(vector.step(np.tile(action, (vector.num_envs, 1)))[0])[0])
    return np.stack(rows)


def _player(vector: VecEnv) -> Callable[[], None]:
    """One step of random actions in every environment."""
    shape = (N_ACTIONS, vector.num_envs, *(vector.action_space.shape or ()))
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(np.float32)
    turn = 0

    def step() -> None:
        nonlocal turn
        vector.step(actions[turn % N_ACTIONS])
        turn += 1

    for _ in range(WARM_STEPS):
        step()
    return step


def _rate(step: Callable[[], None], seconds: float) -> float:
    """Steps of the vector per second of wall time."""
    began, n_steps = time.perf_counter(), 0
    while (spent := time.perf_counter() - began) < seconds:
        for _ in range(5):
            step()
        n_steps += 5
    return n_steps / spent
