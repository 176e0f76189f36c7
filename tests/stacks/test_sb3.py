"""Stable-Baselines3 trains on a type of agents and on single robots, in one process and in several."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest

import fleet.envs  # noqa: F401 - makes the environments known
from benchmarks.harness import Trial
from benchmarks.training import subproc
from fleet.envs import dispatch_v1, make_vec, navigate_v1
from fleet.errors import ConfigError
from fleet.training.errors import TrainingError
from tests.stacks.conftest import require_package
from tests.stacks.guess import Guess, Knows

require_package("stable_baselines3", "sb3")

from sb3_contrib import MaskablePPO  # noqa: E402
from stable_baselines3.common.env_checker import check_env  # noqa: E402
from stable_baselines3.common.vec_env import SubprocVecEnv  # noqa: E402

from fleet.training.stacks.sb3 import TypeVecEnv  # noqa: E402
from fleet.training.stacks.sb3_slots import VectorSlots  # noqa: E402

ROBOTS = {
    "car": ("fleet/CarNavigate-v1", {"fidelity": "kinematic", "max_steps": 20}),
    "physical car": ("fleet/CarNavigate-v1", {"fidelity": "physics", "n_others": 1, "max_steps": 20}),
    "arm": ("fleet/KukaReach-v0", {"fidelity": "kinematic", "max_steps": 20}),
    "physical arm": ("fleet/KukaReach-v0", {"fidelity": "physics", "max_steps": 20}),
}


class Leaving(Guess):
    """An agent leaves after two steps.

    Args:
        who: The agent.
    """

    def __init__(self, who: str) -> None:
        super().__init__(end=4)
        self._who = who

    def step(self, actions: dict[str, Any]) -> tuple[Any, ...]:
        here = self.agents[:]
        assert set(actions) <= set(here), "somebody who is gone was asked to act"
        usual = {
            **dict.fromkeys(self.possible_agents, np.zeros(1)),
            "arm_0": self._shown["arm_0"]["action_mask"].argmax(),
        }
        parts = super().step(usual | actions)
        told = [{agent: part[agent] for agent in here} for part in parts]
        if self._now == 2:
            told[2][self._who] = True
            self.agents = [agent for agent in here if agent != self._who]
        return tuple(told)


@pytest.fixture
def cars() -> Iterator[TypeVecEnv]:
    """Return two floors with three cars each."""
    vector = TypeVecEnv([lambda: navigate_v1.parallel_env(n_cars=3, max_cycles=5)] * 2)
    yield vector
    vector.close()


@pytest.mark.parametrize("name", ROBOTS)
def test_single_robots_pass_its_checker(name: str) -> None:
    known, arguments = ROBOTS[name]
    env = gymnasium.make(known, **arguments).unwrapped
    check_env(env)
    env.close()


def test_every_car_is_a_slot(cars: TypeVecEnv) -> None:
    assert cars.num_envs == 6
    assert cars.reset().shape == (6, cars.observation_space.shape[0])


def test_the_end_of_an_episode_is_told_and_the_next_begins(cars: TypeVecEnv) -> None:
    cars.reset()
    for step in range(5):
        rows, _, dones, infos = cars.step(np.zeros((6, 2), dtype=np.float32))
        assert dones.all() == (step == 4)
    assert all(info["TimeLimit.truncated"] for info in infos)
    assert all(info["terminal_observation"].shape == rows[0].shape for info in infos)
    assert [env.n_steps for env in cars.envs] == [0, 0]


def test_the_slot_of_a_car_that_left_waits_for_the_next_episode() -> None:
    cars = TypeVecEnv([lambda: Leaving("car_0")] * 2, others=Knows())
    cars.reset()
    for step in range(1, 9):
        rows, rewards, dones, infos = cars.step(np.ones((4, 1), dtype=np.float32))
        gone = step % 4 in (2, 3)
        assert (rows[[0, 2]] == 0.0).all() == gone
        assert rows[[1, 3]].all()
        assert (rewards[[0, 2]] == 0.0).all() == (step % 4 in (3, 0))
        assert dones.tolist() == [step % 2 == 0, step % 4 == 0] * 2
        for info, done in zip(infos, dones, strict=True):
            assert ("terminal_observation" in info) == done
        if step % 4 == 2:
            assert infos[0]["terminal_observation"] != 0.0
            assert not infos[0]["TimeLimit.truncated"]


def test_who_left_can_choose_nothing() -> None:
    arms = TypeVecEnv([lambda: Leaving("arm_0")], kind="arm")
    arms.reset()
    for step in range(4):
        masks = arms.action_masks()
        assert masks.sum() == (2 if step < 2 else 1)
        arms.step(masks.argmax(axis=1))
    assert arms.action_masks().sum() == 2


def test_a_seed_decides_the_episodes(cars: TypeVecEnv) -> None:
    def begun(seed: int) -> np.ndarray:
        cars.seed(seed)
        return cars.reset()

    first = begun(3)
    assert (begun(3) == first).all()
    assert (begun(4) != first).any()
    assert (first[:3] != first[3:]).any(), "both floors have the same places to visit"


def test_an_unknown_type_is_refused() -> None:
    with pytest.raises(ConfigError, match="kind is 'arm'; valid: car"):
        TypeVecEnv([lambda: navigate_v1.parallel_env(n_cars=1)], kind="arm")


def test_maskable_ppo_chooses_legal_actions_only(monkeypatch: pytest.MonkeyPatch) -> None:
    cars = TypeVecEnv([lambda: dispatch_v1.parallel_env(site="small", n_cars=2, max_cycles=30)] * 2)
    illegal = []
    step = cars.step_async

    def watched(actions: np.ndarray) -> None:
        masks = cars.action_masks()
        illegal.extend(~masks[np.arange(4), actions])
        step(actions)

    monkeypatch.setattr(cars, "step_async", watched)
    model = MaskablePPO("MlpPolicy", cars, n_steps=30, batch_size=40, n_epochs=1, seed=0, device="cpu")
    model.learn(120)
    assert len(illegal) == 120
    assert not any(illegal)
    assert not cars.action_masks().all()
    cars.close()


def test_masks_of_slots_are_those_of_their_agents() -> None:
    cars = TypeVecEnv([lambda: dispatch_v1.parallel_env(site="small", n_cars=2, max_cycles=30)] * 2)
    cars.seed(0)
    cars.reset()
    wanted = [seen[agent]["action_mask"] == 1 for seen in cars._observations for agent in ("car_0", "car_1")]
    assert (cars.action_masks() == wanted).all()
    assert (cars.env_method("action_masks", indices=[2])[0] == wanted[2]).all()
    assert (cars.get_attr("action_masks", indices=3)[0]() == wanted[3]).all()
    cars.close()


def test_continuous_actions_have_no_masks(cars: TypeVecEnv) -> None:
    with pytest.raises(TrainingError, match="valid with masks: Discrete"):
        cars.action_masks()


def test_robots_are_stepped_in_processes_of_their_own() -> None:
    def make() -> gymnasium.Env:
        return gymnasium.make("fleet.envs:fleet/KukaReach-v0", fidelity="kinematic", max_steps=5)

    arms = SubprocVecEnv([make] * 2)
    arms.seed(0)
    arms.reset()
    for _ in range(5):
        _, _, dones, _ = arms.step(np.zeros((2, 7), dtype=np.float32))
    assert dones.all()
    arms.close()


def test_the_benchmark_of_processes_has_the_same_episodes_in_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subproc, "WARM_STEPS", 1)
    monkeypatch.setattr(subproc, "SECONDS", (0.01, 0.01))
    monkeypatch.setattr(subproc, "ROBOTS", {"KukaReach": subproc.ROBOTS["KukaReach"]})
    trial = Trial(quick=True, seeds=(0,))
    rows = list(subproc.measure_subproc(trial))
    assert trial.failures == []
    assert [row.target for row in rows] == ["", "", "", subproc.TARGET, ""]
    assert all(row.value > 0 for row in rows)


@pytest.mark.parametrize("env", ["navigate", "dispatch"])
def test_the_example_trains(run_example: Callable[..., str], env: str) -> None:
    said = run_example("sb3_cars.py", "--env", env, "--steps", "1500", "--horizon", "15")
    assert math.isfinite(float(said.split(":")[1]))


def test_arrays_are_slots_too() -> None:
    slots = VectorSlots(make_vec("dispatch", 2, site="small", n_cars=3, max_cycles=4))
    twin = make_vec("dispatch", 2, site="small", n_cars=3, max_cycles=4)
    slots.seed(5)
    # Its seeds go up by one from slot to slot; the first slot of an environment decides.
    rows, view = slots.reset(), twin.reset([5, 8])
    assert slots.num_envs == 6
    for step in range(1, 6):
        assert (rows == view.observations["car"].reshape(6, -1)).all()
        masks = np.stack(slots.env_method("action_masks"))
        assert (masks == (view.masks["car"].reshape(6, -1) == 1)).all()
        actions = masks[:, 1].astype(np.int64)
        rows, rewards, dones, infos = slots.step(actions)
        view = told = twin.step(actions.reshape(2, 3))
        assert (rewards == told.rewards["car"].ravel().astype(np.float32)).all()
        assert dones.all() == (step == 4)
        if step == 4:
            assert told.final is not None
            assert (infos[4]["terminal_observation"] == told.final.observations["car"][1, 1]).all()
            assert infos[4]["TimeLimit.truncated"]
    with pytest.raises(ConfigError, match="kind is 'arm'; valid: car"):
        VectorSlots(twin, "arm")
    slots.close()
