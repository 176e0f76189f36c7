"""PettingZoo's own tests, of every environment at every fidelity."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import pettingzoo
import pytest
from pettingzoo.test import (
    api_test,
    max_cycles_test,
    parallel_api_test,
    parallel_seed_test,
    render_test,
    seed_test,
    state_test,
)
from pettingzoo.utils import parallel_to_aec

import fleet.envs  # noqa: F401 - makes the environments known
from fleet.config import Fidelity
from fleet.envs import REPLACED, dispatch_v1, handover_v0, navigate_v1, traffic_v1, warehouse_v1
from fleet.envs.core.base import EpisodeError
from fleet.errors import ConfigError

HETEROGENEOUS = ("Agents have different observation space sizes", "Observations are different shapes")
"""What it warns about whenever agents are of different types."""
MASKED = ("Observation space for each agent probably should be", "Observation is not a NumPy array")
"""What it warns about whenever observations hold a mask, as it asks for them to."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One environment at one fidelity, as small as it can be."""

    name: str
    module: ModuleType
    fidelity: str
    arguments: dict[str, Any]
    warned: tuple[str, ...] = ()
    n_cycles: int = 60

    def parallel_env(self, **arguments: Any) -> Any:
        """Make the parallel form, as a module of PettingZoo's does."""
        return self.module.parallel_env(**{**self.arguments, "fidelity": self.fidelity, **arguments})

    def env(self, **arguments: Any) -> Any:
        """Make the turn-based form."""
        return self.module.env(**{**self.arguments, "fidelity": self.fidelity, **arguments})

    def __str__(self) -> str:
        return f"{self.name}-{self.fidelity}"


_warehouse = partial(Case, name="warehouse", module=warehouse_v1, arguments={"site": "cell"}, warned=HETEROGENEOUS)
_dispatch = partial(Case, name="dispatch", module=dispatch_v1, warned=MASKED)
_traffic = partial(Case, name="traffic", module=traffic_v1, warned=MASKED)
_navigate = partial(Case, name="navigate", module=navigate_v1, arguments={"n_cars": 2})
_handover = partial(Case, name="handover", module=handover_v0, arguments={"n_cars": 1}, warned=HETEROGENEOUS)
# The whole fleet at work: steps of a second.
PAIR = {"site": "cell", "n_cars": 2}
CASES = [
    _warehouse(fidelity="kinematic"),
    _warehouse(fidelity="mixed"),
    _warehouse(fidelity="physics"),
    _dispatch(fidelity="grid", arguments={}),
    _dispatch(fidelity="kinematic", arguments={**PAIR, "decision_s": 1}, n_cycles=8),
    _dispatch(fidelity="mixed", arguments={**PAIR, "decision_s": 1}, n_cycles=4),
    _dispatch(fidelity="physics", arguments={**PAIR, "decision_s": 1}, n_cycles=4),
    _traffic(fidelity="grid", arguments={}),
    _traffic(fidelity="kinematic", arguments=PAIR, n_cycles=8),
    _traffic(fidelity="mixed", arguments=PAIR, n_cycles=4),
    _traffic(fidelity="physics", arguments=PAIR, n_cycles=4),
    _navigate(fidelity="kinematic"),
    _navigate(fidelity="physics"),
    _handover(fidelity="kinematic"),
    _handover(fidelity="physics"),
]
ENVS = {case.name: case.module for case in CASES}
IDS = {name: f"fleet/{module.__name__.rpartition('.')[2].replace('_', '-')}" for name, module in ENVS.items()}


def marked(case: Case) -> Any:
    """Return a case as a parameter that says whether it steps the engine."""
    return pytest.param(case, id=str(case), marks=[pytest.mark.bullet] if Fidelity(case.fidelity).has_contact else [])


of_every_case = pytest.mark.parametrize("case", [marked(case) for case in CASES])


def test_the_table_has_every_environment_and_fidelity() -> None:
    known = {known for known in pettingzoo.parallel_registry if known.startswith("fleet/")}
    replaced = {f"fleet/{module.replace('_', '-')}" for module in REPLACED}
    assert known == {*IDS.values()} | replaced
    assert known <= set(pettingzoo.aec_registry)
    for name, module in ENVS.items():
        tested = {case.fidelity for case in CASES if case.name == name}
        for fidelity in set(Fidelity) - tested:
            with pytest.raises(ConfigError, match="fidelity"):
                module.parallel_env(fidelity=fidelity)


@of_every_case
def test_what_is_closed_does_not_begin_again(case: Case) -> None:
    """With physics some of them had lost their world by then, others made a new one."""
    env = case.parallel_env()
    env.reset(seed=1)
    state = env.save_state()
    env.close()
    for again, words in ((env.reset, "reset"), (lambda: env.load_state(state), "load_state")):
        with pytest.raises(EpisodeError, match=f"^{words}: the environment is closed; valid: another one$"):
            again()
    env.close()


@of_every_case
def test_parallel_api(case: Case) -> None:
    env = case.parallel_env()
    parallel_api_test(env, num_cycles=case.n_cycles)
    env.close()


@of_every_case
def test_api_of_the_turn_based_form(case: Case) -> None:
    with warnings.catch_warnings():
        for text in case.warned:
            warnings.filterwarnings("ignore", message=text)
        api_test(parallel_to_aec(case.parallel_env(max_cycles=case.n_cycles // 2)), num_cycles=case.n_cycles)


@of_every_case
def test_seeds(case: Case) -> None:
    parallel_seed_test(case.parallel_env, num_cycles=case.n_cycles)
    seed_test(case.env, num_cycles=case.n_cycles)


@of_every_case
def test_max_cycles(case: Case) -> None:
    max_cycles_test(case)


@of_every_case
def test_state(case: Case) -> None:
    state_test(case.env(), case.parallel_env(), num_cycles=case.n_cycles // 3)


@of_every_case
def test_render(case: Case, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.chdir(tmp_path)
    render_test(case.env, custom_tests={"rerun": lambda shown: shown is None})
    left = [path.name for path in tmp_path.glob("runs/*/*")]
    assert left == (["episode_0000.rrd"] if "rerun" in case.env().metadata["render_modes"] else [])


@pytest.mark.parametrize("kind", ["parallel", "aec"])
@pytest.mark.parametrize("name", ENVS)
def test_the_registries_make_it(name: str, kind: str) -> None:
    arguments = {"n_arms": 0} if name == "warehouse" else {}
    env = pettingzoo.make(kind, IDS[name], n_cars=2, max_cycles=7, **arguments)
    arms = ["arm_0", "arm_1"] if name == "handover" else []
    assert env.possible_agents == ["car_0", "car_1", *arms]
    assert env.unwrapped.max_cycles == 7
    env.close()


@pytest.mark.parametrize("kind", ["parallel", "aec"])
@pytest.mark.parametrize("module", REPLACED)
def test_a_version_that_was_replaced_is_refused_and_the_new_one_named(module: str, kind: str) -> None:
    layer, _, number = module.rpartition("_v")
    with pytest.raises(ConfigError, match=f"^{module} has been replaced.*; valid: {layer}_v{int(number) + 1}$"):
        pettingzoo.make(kind, f"fleet/{module.replace('_', '-')}", n_cars=2)
