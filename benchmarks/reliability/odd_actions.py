"""Odd actions: whatever an environment is handed as actions, it goes on with legal ones or refuses by name."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Discrete
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.harness import Row, Trial
from benchmarks.reliability.fuzz import at_most, reproducibly, traceback_line
from benchmarks.reliability.mutation import Draw
from fleet.envs import dispatch_v1, handover_v0, navigate_v1, traffic_v1, warehouse_v1
from fleet.errors import FleetError

STEPS, QUICK_STEPS = 1500, 150
"""Steps with odd actions, of each environment."""
LONGEST_CPU_S = 30.0
LONGEST_MESSAGE = 600
MAKERS: dict[str, Callable[[], Any]] = {
    "dispatch_v1": lambda: dispatch_v1.parallel_env(site="cell", n_cars=2, max_cycles=20),
    "traffic_v1": lambda: traffic_v1.parallel_env(site="cell", n_cars=2, max_cycles=20),
    "navigate_v1": lambda: navigate_v1.parallel_env(n_cars=2, max_cycles=20),
    "handover_v0": lambda: handover_v0.parallel_env(n_cars=1, max_cycles=20),
    "warehouse_v1": lambda: warehouse_v1.parallel_env(
        site="cell", n_cars=2, n_arms=1, fidelity="kinematic", max_cycles=20
    ),
}
"""Every environment of many agents, by its name in `fleet.envs.ENVIRONMENTS`."""
SINGLE: dict[str, Callable[[], Any]] = {
    "KukaReach-v0": lambda: gymnasium.make("fleet/KukaReach-v0", fidelity="kinematic", max_steps=20).unwrapped,
    "CarNavigate-v1": lambda: gymnasium.make("fleet/CarNavigate-v1", n_others=1, max_steps=20).unwrapped,
}
"""Every environment of a single robot."""
ODD: tuple[Any, ...] = (
    *(None, True, 0, 1, -1, 7, 10**9, 2**63, 10**400, -(10**30), 0.5, 1.0, -0.0, 1e308, 1j),
    *(float("nan"), float("inf"), float("-inf"), np.float32(0.25), np.int8(1), np.uint64(2**64 - 1)),
    *("", "0", "go", "\ud800", "x" * 5000, b"1", [], {}, (), set(), object(), Decimal("0.5")),
    *(np.datetime64("2020-01-01"), [0.1], [0.1, "a"], [[0.1, 0.2]], [0.1, [0.2]], {"a": 1}, [None, None]),
    *(np.array(None), np.zeros(0), np.zeros((2, 2)), np.array([np.nan, 0.0]), np.full(7, np.inf), np.zeros(10**6)),
    *(np.array(["a", "b"]), np.array([1, 2], dtype=object)),
)
"""What stands in the place of an action, and of all of them."""
_NAMES_VALID = re.compile(r"\bvalid: \S")


@dataclass(kw_only=True)
class ActionTally:
    """What became of the steps of an environment."""

    counts: Counter[str] = field(default_factory=Counter)
    faults: set[str] = field(default_factory=set)


@st.composite
def odd_action(draw: Draw, space: Any) -> Any:
    """One action of an agent: legal, of the right shape with odd numbers, or anything."""
    what = draw(st.integers(0, 3))
    if what == 0:
        return draw(st.sampled_from(ODD))
    if isinstance(space, Discrete):
        return draw(st.one_of(st.integers(0, int(space.n) - 1), st.integers(), st.floats()))
    n = space.shape[0]
    if what == 1:
        n = draw(st.integers(0, n + 2))
    return np.array(draw(st.lists(st.floats(), min_size=n, max_size=n)))


@st.composite
def odd_actions(draw: Draw, env: Any) -> Any:
    """Actions of a team: some missing, some odd, some of strangers; now and then no dictionary."""
    if draw(st.integers(0, 19)) == 0:
        return draw(st.sampled_from(ODD))
    actions: dict[Any, Any] = {
        agent: draw(odd_action(env.action_space(agent))) for agent in env.possible_agents if draw(st.integers(0, 7))
    }
    if draw(st.integers(0, 9)) == 0:
        actions[draw(st.sampled_from(("car_99", "", 0, None, ("car_0",))))] = 0
    return actions


def fuzz_actions(name: str, n: int) -> ActionTally:
    """Hand odd actions to an environment; the same ones every time.

    Args:
        name: Of an environment in `MAKERS` or `SINGLE`.
        n: Steps, over several episodes.
    """
    tally = ActionTally()
    single = name in SINGLE
    env = (SINGLE if single else MAKERS)[name]()
    play = _SinglePlay(env) if single else _TeamPlay(env)

    @reproducibly(n)
    @given(odd_action(env.action_space) if single else odd_actions(env))
    def one(actions: Any) -> None:
        found, fault = _verdict(play, actions)
        tally.counts[found] += 1
        if fault:
            tally.faults.add(fault)

    try:
        one()
        if not single and (fault := _after_the_end(env)):
            tally.faults.add(fault)
    finally:
        env.close()
    return tally


def measure_actions(trial: Trial) -> Iterator[Row]:
    """Step every environment with odd actions."""
    for name in (*MAKERS, *SINGLE):
        tally = fuzz_actions(name, QUICK_STEPS if trial.quick else STEPS)
        for fault in sorted(tally.faults):
            trial.check(False, f"{name}: {fault}")
        yield Row(name=f"{name}: steps with odd actions", value=sum(tally.counts.values()), unit="")
        yield Row(name=f"{name}: refused", value=tally.counts["refused"], unit="")


class _TeamPlay:
    """Steps of an environment of many agents, with a new episode where one has ended."""

    def __init__(self, env: Any) -> None:
        self.env = env
        env.reset(seed=7)

    def step(self, actions: Any) -> str:
        """Make a step; returns what is wrong about what it told."""
        if not self.env.agents:
            self.env.reset()
        seen, rewards, _, _, infos = self.env.step(actions)
        for agent, row in seen.items():
            if not self.env.observation_space(agent).contains(row):
                return f"the observation of {agent} is outside its space"
        if not all(np.isfinite(one) for one in rewards.values()):
            return f"a reward is {rewards}"
        return "" if all(type(info["illegal"]) is bool for info in infos.values()) else "an info does not say illegal"

    def moment(self) -> Any:
        """What must not change when actions are refused."""
        return self.env.n_steps, self.env.state().tobytes()


class _SinglePlay:
    """The same of an environment of a single robot."""

    def __init__(self, env: Any) -> None:
        self.env = env
        self._over = True

    def step(self, action: Any) -> str:
        if self._over:
            self.env.reset(seed=7)
            self._over = False
        seen, reward, terminated, truncated, _ = self.env.step(action)
        self._over = terminated or truncated
        if not self.env.observation_space.contains(seen):
            return "the observation is outside its space"
        return "" if np.isfinite(reward) else f"the reward is {reward}"

    def moment(self) -> Any:
        return None


def _verdict(play: _TeamPlay | _SinglePlay, actions: Any) -> tuple[str, str]:
    with warnings.catch_warnings(), at_most(LONGEST_CPU_S):
        warnings.simplefilter("error")
        if isinstance(play, _TeamPlay) and not play.env.agents:
            play.env.reset()
        before = play.moment()
        try:
            return "taken", play.step(actions)
        except FleetError as refusal:
            text = str(refusal)
            if play.moment() != before:
                return "refused", f"something has changed: {ascii(text)[:200]}"
            ok = _NAMES_VALID.search(text) and len(text) <= LONGEST_MESSAGE
            return "refused", "" if ok else f"says too little or too much: {ascii(text)[:200]}"
        except Exception as error:
            return "refused", traceback_line(error)


def _after_the_end(env: Any) -> str:
    """What is wrong about how actions after the end of an episode are refused."""
    env.reset(seed=7)
    while env.agents:
        env.step({})
    try:
        env.step({})
    except FleetError as refusal:
        return "" if _NAMES_VALID.search(str(refusal)) else f"after the end: {refusal}"
    return "actions after the end are taken"
