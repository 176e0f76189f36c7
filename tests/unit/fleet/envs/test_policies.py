"""Scripted policies: the table and its files agree; the continuous layer's classical stack delivers."""

from __future__ import annotations

import importlib
import inspect
import pkgutil

import pytest

from fleet.envs import policies, warehouse_v1
from fleet.envs.policies import POLICIES, make_policy
from fleet.errors import ConfigError
from fleet.tasks.board import DONE_STATES


def test_every_policy_that_is_written_is_in_the_table() -> None:
    written = set()
    for module in pkgutil.iter_modules(policies.__path__, "fleet.envs.policies."):
        for _, kind in inspect.getmembers(importlib.import_module(module.name), inspect.isclass):
            if kind.__module__ == module.name and hasattr(kind, "act"):
                written.add(kind.__name__)
    listed = {type(made(0)).__name__ for table in POLICIES.values() for made in table.values()}
    assert written - {"Policy"} == listed


def test_unknown_policies_are_refused() -> None:
    with pytest.raises(ConfigError, match="dispatch, traffic, warehouse"):
        make_policy("arms", "random")
    with pytest.raises(ConfigError, match="nearest"):
        make_policy("dispatch", "best")


@pytest.mark.parametrize("seed", [0, 1])
def test_the_classical_stack_delivers_as_a_policy(seed: int) -> None:
    env = warehouse_v1.parallel_env(site="cell", n_cars=1, fidelity="kinematic", max_cycles=600)
    mind = make_policy("warehouse", "classical")
    observations, _ = env.reset(seed=seed)
    terminations: dict[str, bool] = {}
    while env.agents:
        observations, _, terminations, _, _ = env.step(mind.act(env, observations))
    assert all(terminations.values())
    assert {task.state for task in env.simulation.board.tasks} <= set(DONE_STATES)
    env.close()
