"""The warehouse with mixed cars and arms: each type has spaces of its own, scripts play all of them, states return."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from fleet.envs import make_vec, warehouse_v1
from fleet.envs.core.base import ActionError, EnvState
from fleet.envs.policies import make_policy
from fleet.envs.warehouse.env import WarehouseEnv
from fleet.envs.warehouse.rewards import TERMS, RewardWeights
from fleet.envs.warehouse.rows import GRIP_AT, N_ARM_NUMBERS, N_CAR_NUMBERS
from fleet.errors import ConfigError
from fleet.robots import CARS
from fleet.robots.arms import ARMS
from fleet.training.batch import agent_types
from maps.site import load_site, save_site
from maps.stations import StationOptions
from maps.warehouse import generate_warehouse

WORTH = RewardWeights()
EIGHT = replace(ARMS["iiwa"], name="eight", max_velocity_radps=(1.0,) * 8)
"""An arm with a joint too many."""
FIDELITIES = [pytest.param("kinematic"), pytest.param("physics", marks=pytest.mark.bullet)]


@dataclass(frozen=True, kw_only=True)
class Mixed:
    """A mixed team."""

    site: str
    arguments: dict[str, Any]
    team: tuple[str, ...]


TEAMS = {
    "wheels": Mixed(
        site="wide",
        arguments={"cars": "racecar:2,husky:1", "n_arms": 2},
        team=("car_0", "car_1", "car_husky_2", "arm_0", "arm_1"),
    ),
    "arms": Mixed(site="unlike", arguments={"n_cars": 2}, team=("car_0", "car_1", "arm_panda_0", "arm_xarm_1")),
    "drives": Mixed(
        site="wide",
        arguments={"cars": "racecar, husky, a1", "n_arms": 0},
        team=("car_0", "car_husky_1", "car_a1_2"),
    ),
}
of_every_team = pytest.mark.parametrize("name", TEAMS)


@pytest.fixture(scope="module")
def sites(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return a floor on which wide cars may turn, and the smallest site with other arms at its stations."""
    folder = tmp_path_factory.mktemp("sites")
    wide = generate_warehouse(rows=12, cols=16, pick=2, drop=2, parking=6, rack_cols=3, cell_m=1.25)
    options = {"pick_1": StationOptions(arm="panda"), "drop_1": StationOptions(arm="xarm")}
    unlike = replace(load_site("cell"), name="unlike", options=options)
    for name, site in (("wide", wide), ("unlike", unlike)):
        save_site(site, folder / f"{name}.toml")
    return {name: str(folder / f"{name}.toml") for name in ("wide", "unlike")}


@pytest.fixture
def make(sites: dict[str, str]) -> Iterator[Callable[..., WarehouseEnv]]:
    """Return a maker of warehouses on one of the sites, which are closed after the test."""
    made = []

    def one(site: str = "wide", **arguments: Any) -> WarehouseEnv:
        made.append(warehouse_v1.parallel_env(site=sites.get(site, site), **arguments))
        return made[-1]

    yield one
    for env in made:
        env.close()


def paid(env: WarehouseEnv, seed: int) -> dict[str, dict[str, float]]:
    """Play an episode by the script; returns the sums of the terms of each agent."""
    mind = make_policy("warehouse", "classical")
    observations, _ = env.reset(seed=seed)
    totals = {agent: dict.fromkeys(TERMS, 0.0) for agent in env.agents}
    while env.agents:
        observations, _, _, _, infos = env.step(mind.act(env, observations))
        for agent, info in infos.items():
            assert not info["illegal"]
            assert env.observation_space(agent).contains(observations[agent])
            for term in TERMS:
                totals[agent][term] += info[term]
    return totals


def by_chance(env: WarehouseEnv, seed: int, n_steps: int) -> list[Any]:
    """Play on by chance; returns what the environment said."""
    rng, said = np.random.default_rng(seed), []
    for _ in range(n_steps):
        actions = {agent: rng.uniform(-1.0, 1.0, env.action_space(agent).shape) for agent in env.agents}
        said.append((*env.step(actions), env.state()))
    return said


def driven(env: WarehouseEnv, agent: str, action: tuple[float, float], n_steps: int) -> Any:
    """Tell one car something for some steps, the others nothing; returns what it saw then."""
    for _ in range(n_steps):
        seen = env.step({agent: np.array(action)})[0][agent]
    return seen


# --- Spaces


@of_every_team
def test_each_type_has_spaces_of_its_own(make: Callable[..., WarehouseEnv], name: str) -> None:
    mixed = TEAMS[name]
    env = make(mixed.site, **mixed.arguments)
    assert tuple(env.possible_agents) == mixed.team
    entries = {"arm_xarm": 7, "arm_panda": 8, "arm": 8}
    for kind in agent_types(env):
        assert kind.action.shape == (entries.get(kind.name, 2),)
        assert kind.n_observed == (N_ARM_NUMBERS if kind.name.startswith("arm") else N_CAR_NUMBERS)
    tips = make(mixed.site, arm_action="tip", **mixed.arguments)
    assert {tips.action_space(agent).shape for agent in mixed.team if agent.startswith("arm")} <= {(5,)}


@of_every_team
def test_pettingzoo_s_tests_pass(make: Callable[..., WarehouseEnv], sites: dict[str, str], name: str) -> None:
    mixed = TEAMS[name]
    env = make(mixed.site, max_cycles=25, lidar=True, **mixed.arguments)
    parallel_api_test(env, num_cycles=60)
    parallel_seed_test(lambda: make(mixed.site, **mixed.arguments), num_cycles=15)
    observations, _ = env.reset(seed=3)
    assert all(env.observation_space(agent).contains(seen) for agent, seen in observations.items())
    for *_, state in by_chance(env, 1, 24):
        assert env.state_space.contains(state)


def test_cars_of_the_usual_model_are_the_same_in_words(make: Callable[..., WarehouseEnv]) -> None:
    said = []
    for arguments in ({"n_cars": 2}, {"cars": "racecar:2"}):
        env = make("cell", lidar=True, **arguments)
        said.append([env.possible_agents, env.reset(seed=1), by_chance(env, 1, 30)])
    np.testing.assert_equal(said[1], said[0])


def test_vectors_have_an_array_for_each_type(sites: dict[str, str]) -> None:
    vec = make_vec("warehouse", 2, site=sites["wide"], cars="racecar:2,husky:1", n_arms=0, max_cycles=5)
    seen = vec.reset(seeds=0).observations
    assert {kind: rows.shape for kind, rows in seen.items()} == {"car": (2, 2, 64), "car_husky": (2, 1, 64)}
    vec.close()


def test_an_arm_s_action_has_a_number_for_each_of_its_joints(make: Callable[..., WarehouseEnv]) -> None:
    env = make("unlike", level="transfer")
    env.reset(seed=0)
    with pytest.raises(ActionError, match=r"arm_xarm_1 has shape \(8,\); valid: \(7,\)"):
        env.step({"arm_xarm_1": np.zeros(8)})
    told = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1.0], dtype=np.float32)
    before = env.simulation.world.arm_positions()[1]
    seen = env.step({"arm_xarm_1": told})[0]["arm_xarm_1"]
    assert seen[[6, 13]].tolist() == [0.0, 0.0]  # a seventh joint
    np.testing.assert_array_equal(seen[GRIP_AT + 6 :], np.insert(told, 6, 0.0))
    turned = env.simulation.world.arm_positions()[1] - before
    spec = env.simulation.scene.arms.specs[1]
    np.testing.assert_allclose(turned[:6], told[:6] * spec.max_velocity_radps * 0.1, atol=1e-6)


# --- Cars


def test_full_action_is_the_most_that_each_model_can(make: Callable[..., WarehouseEnv]) -> None:
    env = make(cars="racecar, husky, a1", n_arms=0, speed_mps=1.5, start={"cars": "anywhere"})
    env.reset(seed=2)
    for _ in range(12):
        env.step({agent: np.array([0.0, 1.0]) for agent in env.agents})
    assert env.simulation.world.car_speeds() == pytest.approx([1.5, 1.0, 0.5], rel=0.06)
    env.reset(seed=2)
    for agent, car in (("car_husky_1", 1), ("car_a1_2", 2)):
        seen = driven(env, agent, (1.0, 0.0), 10)
        limits = CARS[env.simulation.scene.cars[car].name].spec().differential.limits  # type: ignore[union-attr]
        most = min(limits.max_yaw_rate_radps, limits.max_rim_mps / limits.lever_m)
        assert env.simulation.world.car_steering()[car] == pytest.approx(most, rel=0.06)
        assert seen[5] == pytest.approx(most / limits.max_yaw_rate_radps, rel=0.06)
        assert abs(seen[4]) < 0.01
        assert seen[58] == 0.0, "who turns on the spot does not stand"


def test_a_car_that_turns_on_the_spot_brakes_when_it_is_told_little_of_both(make: Callable[..., WarehouseEnv]) -> None:
    env = make(cars="husky", n_arms=0, dead_band=0.2, start={"cars": "anywhere"})
    env.reset(seed=0)
    driven(env, "car_husky_0", (0.5, 0.19), 10)
    assert env.simulation.world.car_speeds()[0] == pytest.approx(0.0, abs=0.01)
    assert env.simulation.world.car_steering()[0] > 0.8
    seen = driven(env, "car_husky_0", (0.19, 0.19), 10)
    assert env.simulation.world.car_steering()[0] == pytest.approx(0.0, abs=0.01)
    assert seen[58] == 1.0
    driven(env, "car_husky_0", (0.19, 0.5), 10)
    assert env.simulation.world.car_steering()[0] == pytest.approx(0.38, rel=0.06), "what goes may turn a little"


def test_who_turns_on_the_spot_has_not_docked(make: Callable[..., WarehouseEnv]) -> None:
    env = make(cars="husky", level="dock", start={"cars": "docked", "side_m": 0.0, "turn_rad": 0.3})
    agent, seed = "car_husky_0", 0
    while abs(env.reset(seed=seed)[0][agent][57]) < 0.2:
        seed += 1
    seen, turned = env.step({})[0][agent], 0
    while abs(seen[57]) > 0.03:  # its stop is within 0.1 rad
        told = {agent: np.array([np.sign(seen[57]) * 0.15, 0.0])}
        observations, *_, infos = env.step(told)
        seen = observations[agent]
        turned += abs(seen[57]) < 0.1
        assert infos[agent]["docked"] == 0.0
    assert turned > 0
    while env.agents and env.n_steps < 30:
        *_, infos = env.step({})
    assert infos[agent]["docked"] == WORTH.docked


def test_routes_lead_from_corner_to_corner_and_turns_have_no_length(make: Callable[..., WarehouseEnv]) -> None:
    env = make(cars="husky", n_arms=0, max_cycles=100)
    mind, bends = make_policy("warehouse", "pursuit"), 0
    observations, _ = env.reset(seed=0)
    while env.agents:
        observations, *_ = env.step(mind.act(env, observations))
        routes = env._now().observer._routes
        line = routes.points[0, : routes.counts[0]]
        steps = np.diff(line[:, :2], axis=0)
        np.testing.assert_allclose(np.diff(line[:, 2]), np.hypot(*steps.T), atol=1e-6)
        assert (np.diff(line[:, 2]) > 0.0).all()
        (dx, dy), (next_x, next_y) = steps[:-1].T, steps[1:].T
        bends += int((np.abs(dx * next_y - dy * next_x) > 1e-4).any())
    assert bends > 10


@pytest.mark.parametrize("model", ["husky", "a1"])
@pytest.mark.parametrize("car_action", ["drive", "residual"])
def test_the_script_docks_with_each_drive(make: Callable[..., WarehouseEnv], model: str, car_action: str) -> None:
    env = make(cars=model, level="dock", car_action=car_action)
    for seed in range(3):
        done = paid(env, seed)[f"car_{model}_0"]
        assert (done["docked"], done["contact"]) == (WORTH.docked, 0.0)
        assert env.n_steps < env.max_cycles


def test_each_drive_delivers(make: Callable[..., WarehouseEnv]) -> None:
    env = make(cars="racecar, husky, a1", arm_action="residual", tasks=3, max_cycles=2500)
    done = paid(env, 0)
    assert {agent: terms["delivered"] for agent, terms in done.items() if agent.startswith("car")} == dict.fromkeys(
        ("car_0", "car_husky_1", "car_a1_2"), WORTH.delivered
    )
    assert sum(terms["contact"] for terms in done.values()) == 0.0


@pytest.mark.bullet
def test_a_husky_is_loaded_or_unloaded_in_physics(make: Callable[..., WarehouseEnv]) -> None:
    env = make(cars="husky", level="pair", fidelity="physics", arm_action="tip", lidar=True)
    done = paid(env, 1)
    assert done["car_husky_0"]["docked"] == WORTH.docked
    assert done["car_husky_0"]["loaded"] + done["car_husky_0"]["delivered"] > 0.0


@pytest.mark.bullet
@pytest.mark.slow
def test_a_walker_docks_in_physics(make: Callable[..., WarehouseEnv]) -> None:
    env = make(cars="a1", level="dock", fidelity="physics", physics_hz=120.0)
    assert paid(env, 0)["car_a1_0"]["docked"] == WORTH.docked


# --- Arms


@pytest.mark.parametrize("fidelity", FIDELITIES)
@pytest.mark.parametrize("arm_action", ["joint", "tip", "residual"])
def test_the_script_picks_and_sets_with_each_arm(
    make: Callable[..., WarehouseEnv], arm_action: str, fidelity: str
) -> None:
    env = make("unlike", level="transfer", arm_action=arm_action, fidelity=fidelity)
    done = paid(env, 2)
    assert (done["arm_panda_0"]["gripped"], done["arm_panda_0"]["loaded"]) == (WORTH.gripped, WORTH.loaded)
    assert (done["arm_xarm_1"]["gripped"], done["arm_xarm_1"]["delivered"]) == (WORTH.gripped, WORTH.delivered)
    assert env.n_steps < 150


@pytest.mark.parametrize("arm", [0, 1])
def test_unlike_arms_begin_with_the_parcel_at_hand(make: Callable[..., WarehouseEnv], arm: int) -> None:
    env = make("unlike", level="transfer", start={"reach_m": (0.05, 0.15)})
    agent = env.possible_agents[arm]
    for seed in range(4):
        seen = env.reset(seed=seed)[0][agent]
        assert np.linalg.norm(seen[20:23] * 1.5) < 0.25
        assert seen[19] < -0.9, "the tool points down"


def test_a_parcel_s_place_is_in_the_tray_of_the_car_that_has_come(make: Callable[..., WarehouseEnv]) -> None:
    env = make(level="transfer", cars="racecar:1,husky:1,racecar:1,husky:1")
    heights = set()
    for seed in range(4):
        env.reset(seed=seed)
        env.step({})
        simulation = env.simulation
        for errand in env._now().errands:
            transfer = simulation.arm_manager.transfer(errand.station)
            if transfer is not None and not errand.loaded:
                z = env._now().observer.place(transfer)[2] - transfer.size_m[2] / 2
                assert z == pytest.approx(simulation.scene.cars[errand.car].tray_floor_z_m)
                heights.add(round(float(z), 2))
    assert heights == {0.18, 0.41}


# --- Teams and states


@of_every_team
def test_a_mixed_team_comes_back_exactly(make: Callable[..., WarehouseEnv], name: str) -> None:
    mixed = TEAMS[name]
    settings = {**mixed.arguments, "lidar": True, "car_sensing": {"dropout": 0.3, "delay_steps": 2}}
    env, other = (make(mixed.site, **settings) for _ in range(2))
    env.reset(seed=5)
    by_chance(env, 1, 12)
    state = env.save_state()
    after = [by_chance(env, 2, 12), env.reset()]
    env.load_state(state)
    np.testing.assert_equal([by_chance(env, 2, 12), env.reset()], after)
    other.load_state(EnvState(**{**state.__dict__, "quick": None}))
    np.testing.assert_equal([by_chance(other, 2, 12), other.reset()], after)


def test_a_team_of_another_size_has_arms_for_its_trays(make: Callable[..., WarehouseEnv]) -> None:
    env = make(cars="racecar:1,husky:1,racecar:1", n_cars=(1, 2), n_arms=0, max_cycles=30)
    assert env.possible_agents == ["car_0", "car_husky_1"]
    heights = {}
    for seed in range(6):
        env.reset(seed=seed)
        models = [env.simulation.scene.cars[car].name for car in range(env.simulation.world.n_cars)]
        assert models == ["racecar", *["husky"] * (len(env.agents) - 1), "racecar"]
        heights[len(env.agents)] = float(env.simulation.scene.arm_base[0, 2])
        env.step({})
    assert heights[2] - heights[1] == pytest.approx(0.41 - 0.18)


def test_in_transfer_the_cars_are_those_of_the_classical_fleet(make: Callable[..., WarehouseEnv]) -> None:
    env = make(level="transfer", cars="husky:1,racecar:1")
    assert all(agent.startswith("arm") for agent in env.possible_agents)
    done = paid(env, 0)
    assert sum(terms["loaded"] + terms["delivered"] for terms in done.values()) == pytest.approx(
        sum(WORTH.delivered if errand.loaded else WORTH.loaded for errand in env._now().errands)
    )


@pytest.mark.parametrize(
    ("site", "arguments", "words"),
    [
        ("wide", {"cars": "huskey:1"}, r"cars is 'huskey:1'; valid: MODEL:NUMBER,... of the models racecar, husky, a1"),
        ("wide", {"cars": "husky:0"}, r"cars is 'husky:0'; valid: a number of cars from 1"),
        ("wide", {"cars": ("husky", 1)}, r"cars is \('husky', 1\); valid: MODEL:NUMBER"),
        ("wide", {"cars": "husky:7"}, r"cars is 'husky:7'; valid: at most 6 cars on site"),
        ("wide", {"cars": "husky:2", "n_cars": 3}, r"cars is 'husky:2'; valid: 3 cars, which n_cars"),
        ("wide", {"cars": "husky:2", "n_cars": 1, "classical_cars": 0}, r"cars is 'husky:2'; valid: 1 cars"),
        ("cell", {"cars": "husky:1"}, r"model husky: its body of 0.99 x 0.69 m, which turns on the spot, fits no lane"),
        ("wide", {"cars": "racecar:1,lifter:1"}, r"cars is .*; valid: models that come to docks, unlike lifter"),
        ("wide", {"cars": "husky:1", "fidelity": "mixed"}, r"fidelity is 'mixed'; valid: kinematic or physics"),
        ("wide", {"cars": "a1:1", "fidelity": "physics"}, r"physics_hz is 240.0; valid: 120, for cars on legs \(a1\)"),
        ("unlike", {"cars": "racecar:1", "arm_action": "pose"}, r"arm_action is 'pose'; valid: joint, tip, residual"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(
    make: Callable[..., WarehouseEnv], site: str, arguments: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        make(site, **arguments)


def test_arms_that_are_none_or_have_too_many_joints_are_refused(tmp_path: Path) -> None:
    cell = load_site("cell")
    for arm, words in (
        ("pandas", "site cell: stations.pick_1.arm is 'pandas'"),
        (f"{__name__}.EIGHT", "joints of an agent's arm on site cell is 8; valid: at most 7"),
    ):
        path = tmp_path / "cell.toml"
        save_site(replace(cell, options={"pick_1": StationOptions(arm=arm)}), path)
        with pytest.raises(ConfigError, match=words):
            warehouse_v1.parallel_env(site=str(path))
