"""What many environments in one owe to the single ones: the same numbers, to the last bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from fleet.config import BatteryConfig
from fleet.envs import dispatch_v1, make_vec, navigate_v1, traffic_v1
from fleet.envs.core.base import ActionError, EpisodeError
from fleet.envs.dispatch.env import DispatchWeights
from fleet.envs.traffic.env import TrafficWeights
from fleet.envs.vector.agent_slots import AgentSlots
from fleet.envs.vector.dispatch_vec import DispatchVec
from fleet.envs.vector.loop import LoopVec
from fleet.envs.vector.make import vec_of
from fleet.envs.vector.vec_env import VecEnv, VecView
from fleet.errors import ConfigError
from maps.warehouse import generate_warehouse

N_ENVS = 3
MAKERS = {"dispatch": dispatch_v1.parallel_env, "traffic": traffic_v1.parallel_env}
SETTINGS = {
    "dispatch": {
        "as it comes": {"site": "small", "n_cars": 6, "max_cycles": 60},
        "few candidates, other weights": {
            "site": "medium",
            "n_cars": 13,
            "max_cycles": 90,
            "candidates_n": 3,
            "load": 0.9,
            "weights": DispatchWeights(delivered=1.7, late=-0.3, empty=-0.07, waiting=-0.013, lost=-0.11),
        },
        "one car": {"site": "twin", "n_cars": 1, "max_cycles": 40, "decision_s": 2.0},
        "a full floor": {
            "site": generate_warehouse(rows=14, cols=22, pick=3, drop=3, parking=40),
            "n_cars": 40,
            "max_cycles": 50,
        },
        "breakdowns": {
            "site": "small",
            "n_cars": 6,
            "max_cycles": 60,
            "breakdowns_per_h": 40.0,
            "repair_s": 20.0,
            "lost_share": 0.2,
        },
        "several sources, and tasks that are given back": {
            "site": "medium",
            "n_cars": 13,
            "max_cycles": 60,
            "load": 1.6,
            "stream": {"sources_n": 3},
            "breakdowns_per_h": 20.0,
            "repair_s": 20.0,
        },
        "batteries, and cars that break down at chargers": {
            "site": "medium",
            "n_cars": 16,
            "max_cycles": 80,
            "battery_s": 100.0,
            "charge_s": 60.0,
            "breakdowns_per_h": 20.0,
            "repair_s": 20.0,
            "lost_share": 0.1,
        },
    },
    "traffic": {
        "as it comes": {"site": "small", "n_cars": 6, "max_cycles": 120},
        "a dense floor, other weights": {
            "site": "dense",
            "n_cars": 30,
            "max_cycles": 150,
            "team_share": 0.3,
            "weights": TrafficWeights(progress=0.13, delivered=1.7, waiting=-0.03, lost=-0.07, blocking=-0.11),
        },
        "one car": {"site": "twin", "n_cars": 1, "max_cycles": 100},
        "a full floor": {"site": "dense", "n_cars": 40, "max_cycles": 80, "load": 0.5},
    },
}
CASES = [(layer, case) for layer, cases in SETTINGS.items() for case in cases]


def acted(view: VecView, rng: np.random.Generator) -> np.ndarray:
    """Return mostly legal actions, and some that are none."""
    mask = view.masks["car"]
    legal = (rng.random(mask.shape) * mask).argmax(axis=2)
    wild = rng.integers(-2, mask.shape[2] + 2, size=legal.shape)
    return np.where(rng.random(legal.shape) < 0.9, legal, wild)


def assert_same_view(one: VecView, other: VecView) -> None:
    np.testing.assert_equal(one.observations, other.observations)
    np.testing.assert_equal(one.masks, other.masks)


def assert_same_steps(vec: VecEnv, loop: VecEnv, n_steps: int) -> None:
    """Play both with the same actions and compare all that they say."""
    rng = np.random.default_rng(1)
    view, other_view = vec.reset(7), loop.reset(7)
    n_ended = 0
    for _ in range(n_steps):
        assert_same_view(view, other_view)
        np.testing.assert_array_equal(vec.state(), loop.state())
        actions = acted(view, rng)
        view, other_view = one, other = vec.step({"car": actions}), loop.step({"car": actions})
        np.testing.assert_equal(one.rewards, other.rewards)
        np.testing.assert_equal(one.infos, other.infos)
        for name, array in other.infos["car"].items():
            assert one.infos["car"][name].dtype == array.dtype
        np.testing.assert_array_equal(one.truncated, other.truncated)
        np.testing.assert_array_equal(one.terminated, other.terminated)
        assert (one.final is None) == (other.final is None)
        if one.final is not None and other.final is not None:
            n_ended += 1
            assert_same_view(one.final, other.final)
    assert n_ended > 0, "no episode has ended"


@pytest.fixture
def keep() -> Iterator[Callable[[Any], Any]]:
    """Return what closes an environment after the test."""
    kept: list[Any] = []

    def one(env: Any) -> Any:
        kept.append(env)
        return env

    yield one
    for env in kept:
        env.close()
        env.close()


@pytest.mark.parametrize(("layer", "case"), CASES)
def test_kernels_say_what_dictionaries_say(layer: str, case: str, keep: Callable[[Any], Any]) -> None:
    settings = SETTINGS[layer][case]
    vec = keep(make_vec(layer, N_ENVS, **settings))
    loop = keep(LoopVec([MAKERS[layer](**settings) for _ in range(N_ENVS)]))
    assert not isinstance(vec, LoopVec)
    assert_same_steps(vec, loop, settings["max_cycles"] + 25)


@pytest.mark.parametrize("layer", SETTINGS)
def test_threads_change_nothing(layer: str, keep: Callable[[Any], Any]) -> None:
    settings = SETTINGS[layer]["as it comes"]
    vec, shared = (keep(make_vec(layer, 5, n_threads=n_threads, **settings)) for n_threads in (1, 3))
    assert_same_steps(shared, vec, settings["max_cycles"] + 5)


def test_the_loop_says_what_its_environments_say(keep: Callable[[Any], Any]) -> None:
    envs = [keep(navigate_v1.parallel_env(n_cars=2, max_cycles=4)) for _ in range(2)]
    vec = keep(make_vec("navigate", 2, n_cars=2, max_cycles=4))
    assert isinstance(vec, LoopVec)
    view = vec.reset([3, 8])
    told = [env.reset(seed=seed)[0] for env, seed in zip(envs, (3, 8), strict=True)]
    rng = np.random.default_rng(0)
    for n in range(1, 9):
        for index, seen in enumerate(told):
            np.testing.assert_array_equal(
                view.observations["car"][index], [seen[car] for car in envs[0].possible_agents]
            )
        actions = rng.uniform(-1.2, 1.2, (2, 2, 2))
        view = step = vec.step(actions)
        for index, env in enumerate(envs):
            team = env.possible_agents
            seen, rewards, _, _, infos = env.step(dict(zip(team, actions[index], strict=True)))
            np.testing.assert_array_equal(step.rewards["car"][index], [rewards[car] for car in team])
            for name, array in step.infos["car"].items():
                np.testing.assert_array_equal(array[index], [infos[car][name] for car in team])
            if n % 4 == 0:
                assert step.final is not None
                np.testing.assert_array_equal(step.final.observations["car"][index], [seen[car] for car in team])
                seen = env.reset()[0]
            told[index] = seen
        np.testing.assert_array_equal(step.truncated, [n % 4 == 0] * 2)
    assert set(step.infos["car"]) >= {"illegal"}


def test_cars_and_arms_have_arrays_of_their_own(keep: Callable[[Any], Any]) -> None:
    vec = keep(make_vec("warehouse", 2, site="cell", n_cars=2, n_arms=1, fidelity="kinematic", max_cycles=5))
    view = vec.reset(0)
    groups = {group.name: group for group in vec.groups}
    assert {name: group.n for name, group in groups.items()} == {"car": 2, "arm": 1}
    assert not view.masks
    for name, group in groups.items():
        assert view.observations[name].shape == (2, group.n, *group.observation.shape)
    step = vec.step({"car": np.zeros((2, 2, 2))})
    assert (step.infos["arm"]["illegal"] == 1).all(), "arms that are told nothing"
    assert (step.infos["car"]["illegal"] == 0).all()
    with pytest.raises(ActionError, match="one array; valid: a dictionary by type, car, arm"):
        vec.step(np.zeros((2, 2, 2)))


@pytest.mark.parametrize("layer", SETTINGS)
def test_seeds_and_series(layer: str, keep: Callable[[Any], Any]) -> None:
    settings = SETTINGS[layer]["as it comes"]
    vec, twin = (keep(make_vec(layer, 2, seed=4, **settings)) for _ in range(2))
    first = vec.reset().copy()
    assert_same_view(first, twin.reset([4, 5]))
    assert (first.observations["car"][0] != first.observations["car"][1]).any()
    second = vec.reset().copy()
    assert (first.observations["car"] != second.observations["car"]).any()
    assert_same_view(second, twin.reset())
    assert_same_view(first, vec.reset(4))


@pytest.mark.parametrize("layer", SETTINGS)
def test_actions_of_any_kind_mean_what_they_mean_to_one_environment(layer: str, keep: Callable[[Any], Any]) -> None:
    settings = SETTINGS[layer]["as it comes"]
    vec = keep(make_vec(layer, 1, **settings))
    loop = keep(LoopVec([MAKERS[layer](**settings)]))
    vec.reset(0)
    loop.reset(0)
    n = settings["n_cars"]
    whole = np.ones((1, n))
    for actions in ({}, whole, whole + 0.5, whole * np.nan, whole * 1e12, whole > 0, -whole.astype(np.int8)):
        np.testing.assert_equal(vec.step(actions).infos, loop.step(actions).infos)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"n_cars": (1, 3)}, r"n_cars is \(1, 3\); valid: one number"),
        ({"n_cars": 2, "breakdowns": {"losses_per_h": 60.0}}, r"breakdowns.losses_per_h is 60.0; valid: 0"),
        ({"n_cars": 2, "battery": BatteryConfig(enabled=True)}, r"battery is 'enabled'; valid: none"),
    ],
)
def test_agents_that_come_and_go_fit_in_no_array(settings: dict[str, Any], words: str) -> None:
    """The first reset raised a KeyError."""
    with pytest.raises(ConfigError, match=words):
        make_vec("warehouse", 2, site="small", fidelity="kinematic", **settings)


def test_bad_input_is_refused(keep: Callable[[Any], Any]) -> None:
    settings = SETTINGS["dispatch"]["as it comes"]
    with pytest.raises(ConfigError, match="layer is 'flight'; valid: warehouse, dispatch"):
        make_vec("flight", 1)
    for n in (0, -1, 1.5, True):
        with pytest.raises(ConfigError, match=f"n_envs is {n}; valid: an integer >= 1"):
            make_vec("dispatch", n, **settings)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="n_threads is 0"):
        make_vec("dispatch", 1, n_threads=0, **settings)
    with pytest.raises(ConfigError, match="unknown setting colour"):
        make_vec("dispatch", 1, colour="red")
    vec = keep(make_vec("dispatch", 2, **settings))
    with pytest.raises(EpisodeError, match="valid: reset"):
        vec.step(np.zeros((2, 6), dtype=int))
    with pytest.raises(EpisodeError, match="restart: no episodes"):
        vec.restart([0])
    with pytest.raises(ConfigError, match="number of seeds is 3; valid: 2"):
        vec.reset([1, 2, 3])
    with pytest.raises(ConfigError, match="seed is -1"):
        vec.reset([1, -1])
    with pytest.raises(ConfigError, match="seeds"):
        vec.reset(1.5)
    vec.reset(0)
    with pytest.raises(ActionError, match=r"type car have shape \(2, 5\); valid: \(2, 6\)"):
        vec.step({"car": np.zeros((2, 5), dtype=int)})
    with pytest.raises(ActionError, match="type arm; valid: car"):
        vec.step({"arm": np.zeros((2, 6), dtype=int)})
    with pytest.raises(ActionError, match="valid: numbers"):
        vec.step({"car": np.full((2, 6), "0")})
    with pytest.raises(ActionError, match="valid: an array of numbers"):
        vec.step({"car": [[0, 1], [0]]})
    vec.close()
    with pytest.raises(EpisodeError, match="valid: reset"):
        vec.step(np.zeros((2, 6), dtype=int))


def test_a_longer_episode_finds_room(keep: Callable[[Any], Any]) -> None:
    """Later episodes have more orders than those for which there was room."""
    settings = SETTINGS["dispatch"]["as it comes"] | {"max_cycles": 4}
    vec = keep(make_vec("dispatch", 2, **settings))
    loop = keep(LoopVec([dispatch_v1.parallel_env(**settings) for _ in range(2)]))
    assert isinstance(vec, DispatchVec)
    vec.reset(0)
    room = vec._block.capacity
    assert_same_steps(vec, loop, 120)
    assert vec._block.capacity > room


# --- Faces of libraries


def test_slots_of_gymnasium(keep: Callable[[Any], Any]) -> None:
    settings = SETTINGS["dispatch"]["as it comes"] | {"max_cycles": 3}
    vec = keep(make_vec("dispatch", 2, **settings))
    slots = RecordEpisodeStatistics(AgentSlots(keep(make_vec("dispatch", 2, **settings))))
    assert slots.num_envs == 12
    assert slots.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    view, (seen, _) = vec.reset(2), slots.reset(seed=2)
    for n in range(1, 5):
        assert slots.observation_space.contains(seen)
        np.testing.assert_array_equal(seen["observation"], view.observations["car"].reshape(12, -1))
        np.testing.assert_array_equal(seen["action_mask"], view.masks["car"].reshape(12, -1))
        actions = view.masks["car"][:, :, 1].copy()
        view = step = vec.step(actions)
        seen, rewards, terminations, truncations, infos = slots.step(actions.ravel())
        np.testing.assert_array_equal(rewards, step.rewards["car"].ravel())
        np.testing.assert_array_equal(infos["empty"], step.infos["car"]["empty"].ravel())
        assert not terminations.any()
        assert truncations.all() == (n == 3)
        assert ("final_obs" in infos) == (n == 3)
        if n == 3:
            assert slots.single_observation_space.contains(infos["final_obs"][7])
            assert step.final is not None
            np.testing.assert_array_equal(infos["final_obs"][7]["observation"], step.final.observations["car"][1, 1])
            assert (infos["episode"]["l"] == 3).all()
    with pytest.raises(ActionError, match="shape"):
        slots.step(np.zeros(5, dtype=int))
    with pytest.raises(ConfigError, match="kind is 'arm'; valid: car"):
        AgentSlots(vec, "arm")
    slots.close()
    slots.close()


def test_slots_without_masks(keep: Callable[[Any], Any]) -> None:
    slots = keep(AgentSlots(vec_of(lambda: navigate_v1.parallel_env(n_cars=2, max_cycles=2), 2)))
    seen, _ = slots.reset(seed=0)
    assert slots.observation_space.contains(seen)
    slots.step(slots.action_space.sample())
    infos = slots.step(slots.action_space.sample())[4]
    assert slots.single_observation_space.contains(infos["final_obs"][3])


@pytest.mark.parametrize("n_threads", [1, 2])
def test_what_is_closed_does_not_begin_again(n_threads: int) -> None:
    vec = make_vec("dispatch", 2, n_threads=n_threads, site="small", n_cars=2)
    vec.reset(0)
    vec.close()
    with pytest.raises(EpisodeError, match="closed"):
        vec.reset(0)
