"""What the navigation environment and those of single robots owe the libraries that train on them."""

from __future__ import annotations

import hashlib
import pickle
import subprocess
import sys
import warnings
from collections.abc import Iterator

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import fleet.envs  # noqa: F401 - makes the environments known
from fleet.envs import navigate_v1
from fleet.envs.core.base import ActionError, EpisodeError
from fleet.envs.core.versions import VersionError
from fleet.envs.kuka_reach import TOLERANCE_M, KukaReachEnv, ReachPolicy
from fleet.envs.navigate.car_navigate import CarNavigateEnv
from fleet.envs.navigate.navigation import BRAKE_S, TOW_S, NavigationEnv
from fleet.envs.navigate.navigation_policy import PursuitPolicy
from fleet.errors import ConfigError

FIDELITIES = ("kinematic", "physics")


@pytest.fixture(params=FIDELITIES)
def cars(request: pytest.FixtureRequest) -> Iterator[NavigationEnv]:
    """Return three cars on the small site."""
    env = navigate_v1.parallel_env(n_cars=3, fidelity=request.param, max_cycles=40)
    yield env
    env.close()


def trace(env: NavigationEnv, seed: int | None, n_steps: int) -> list[object]:
    """Play with fixed random actions; return all that the environment said."""
    rng = np.random.default_rng(1)
    told: list[object] = [env.reset(seed=seed)]
    while env.agents and len(told) <= n_steps:
        told.append(env.step({agent: rng.uniform(-0.2, 1.0, 2).astype(np.float32) for agent in env.agents}))
    return told


def plain(told: object) -> object:
    """Arrays as lists, so that what was told can be compared."""
    if isinstance(told, np.ndarray):
        return told.tolist()
    if isinstance(told, dict):
        return {key: plain(value) for key, value in told.items()}
    return [plain(value) for value in told] if isinstance(told, list | tuple) else told


def test_what_is_seen_is_always_in_its_space(cars: NavigationEnv) -> None:
    rng = np.random.default_rng(0)
    seen, _ = cars.reset(seed=0)
    while cars.agents:
        assert all(cars.observation_space(agent).contains(row) for agent, row in seen.items())
        assert cars.state_space.contains(cars.state())
        seen, *_ = cars.step({agent: rng.uniform(-1, 1, 2).astype(np.float32) for agent in cars.agents})


def test_a_seed_decides_an_episode_also_the_second_time(cars: NavigationEnv) -> None:
    first = plain(trace(cars, 5, 40))
    other = plain(trace(cars, 6, 40))
    assert plain(trace(cars, 5, 40)) == first
    assert other != first


def digest_of_an_episode() -> str:
    """Hash of all that a whole episode says."""
    env = navigate_v1.parallel_env(n_cars=4)
    said = hashlib.sha256(str(plain(trace(env, 3, 600))).encode()).hexdigest()
    env.close()
    return said


def test_another_process_plays_the_same() -> None:
    script = "from tests.contract.test_navigation_envs import *\nprint(digest_of_an_episode())"
    found = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    assert found.stdout.strip() == digest_of_an_episode()


def test_a_saved_moment_comes_back(cars: NavigationEnv) -> None:
    trace(cars, 2, 10)
    state = cars.save_state()
    step = {agent: np.array([0.1, 0.8], dtype=np.float32) for agent in cars.agents}
    after = plain(cars.step(step))
    cars.step(step)
    cars.load_state(state)
    assert plain(cars.step(step)) == after


def test_places_to_visit_do_not_depend_on_what_agents_do() -> None:
    env = navigate_v1.parallel_env(n_cars=2, max_cycles=200)
    policy = PursuitPolicy()

    def places(drives: bool) -> list[list[float]]:
        seen, _ = env.reset(seed=4)
        met: dict[str, list[object]] = {}
        while env.agents:
            for car, agent in enumerate(env.agents):
                goal = env._goals[car].tolist()
                line = met.setdefault(agent, [])
                if goal not in line[-1:]:
                    line.append(goal)
            acts = policy.act(env, seen)
            seen, *_ = env.step(acts if drives else {**acts, "car_1": np.zeros(2)})
        return [met[agent] for agent in env.possible_agents]

    both, alone = places(True), places(False)
    n = min(len(both[0]), len(alone[0]))
    assert n >= 2
    assert both[0][:n] == alone[0][:n]
    assert len(alone[1]) == 1


def test_the_script_drives_to_places_and_stays_on_its_lanes() -> None:
    env = navigate_v1.parallel_env(n_cars=1, max_cycles=600)
    seen, _ = env.reset(seed=0)
    places, towed, off_lane = 0.0, 0.0, 0.0
    while env.agents:
        seen, _, _, _, infos = env.step(PursuitPolicy().act(env, seen))
        places, towed = places + infos["car_0"]["places"], towed + infos["car_0"]["towed"]
        off_lane += infos["car_0"]["off_lane"]
    assert places >= 5
    assert (towed, off_lane) == (0.0, 0.0)
    env.close()


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_a_lost_car_is_towed_back_and_stands(fidelity: str) -> None:
    env = navigate_v1.parallel_env(n_cars=1, max_cycles=200, fidelity=fidelity)
    env.reset(seed=0)
    away, towed = {"car_0": np.array([0.15, 1.0])}, 0.0
    while env.agents and not towed:
        *_, infos = env.step(away)
        towed = infos["car_0"]["towed"]
    assert towed == env._weights.towed
    assert infos["car_0"]["tows"] == 1.0, "counted, whatever it costs"
    for _ in range(round(10 * (BRAKE_S + TOW_S))):
        *_, infos = env.step(away)  # nobody listens
        assert (infos["car_0"]["towed"], infos["car_0"]["tows"]) == (0.0, 0.0)
    assert abs(env._world.car_speeds()[0]) < 0.02
    assert abs(env._aside_m[0]) < 0.05
    env.step(away)
    assert env._world.car_speeds()[0] > 0.1
    env.close()


def test_a_car_that_stands_off_its_lane_is_towed_after_a_while() -> None:
    env = navigate_v1.parallel_env(n_cars=1)
    env.reset(seed=0)
    yaw = env._world.car_poses()[0, 2]
    env._world.push_car(0, -0.4 * np.sin(yaw), 0.4 * np.cos(yaw), 0.0)
    towed = []
    for _ in range(40):
        *_, infos = env.step({"car_0": np.zeros(2)})
        towed.append(infos["car_0"]["towed"] != 0.0)
    assert (True in towed[:28], towed.count(True)) == (False, 1)
    env.close()


def test_knocks_come_from_the_seed_and_leave_the_places_alone() -> None:
    ends, goals = [], []
    for knocks_per_min in (0.0, 120.0, 120.0):
        env = navigate_v1.parallel_env(n_cars=2, knocks_per_min=knocks_per_min)
        env.reset(seed=3)
        goals.append(env._goals.tolist())
        for _ in range(30):
            env.step({})
        ends.append(env._world.car_poses().tolist())
        env.close()
    assert goals[0] == goals[1]
    assert ends[1] == ends[2] != ends[0]


def test_two_cars_in_one_place_touch_and_pay_for_it() -> None:
    env = navigate_v1.parallel_env(n_cars=2)
    env.reset(seed=0)
    poses = env._world.car_poses()
    env._world.push_car(1, *(0.78 * (poses[0] - poses[1])).tolist())
    *_, infos = env.step({})
    assert all(info["touch"] == env._weights.touch for info in infos.values())
    *_, infos = env.step({})
    assert all(info["touch"] == 0.0 for info in infos.values()), "a touch that lasts counts once"
    env._world.push_car(1, *(0.78 * (poses[1] - poses[0])).tolist())
    *_, infos = env.step({})
    assert all(info["touch"] == 0.0 for info in infos.values())


def test_cars_stop_at_each_other_unless_they_may_pass() -> None:
    ends = {}
    for contact in ("stop", "hold", "pass"):
        env = navigate_v1.parallel_env(n_cars=2, contact=contact)
        env.reset(seed=0)
        poses = env._world.car_poses()
        # The second one stands a metre before the first, nose to nose.
        ahead = np.array([np.cos(poses[0, 2]), np.sin(poses[0, 2])])
        env._world.push_car(1, *(poses[0, :2] + ahead - poses[1, :2]), float(poses[0, 2] + np.pi - poses[1, 2]))
        touches = 0.0
        for _ in range(12):
            *_, infos = env.step({"car_0": np.array([0.0, 0.5]), "car_1": np.zeros(2)})
            touches += infos["car_0"]["touches"]
        assert touches == 1.0
        ends[contact] = float((env._world.car_poses()[0, :2] - poses[0, :2]) @ ahead)
        env.close()
    assert max(ends["stop"], ends["hold"]) < 0.3
    assert ends["pass"] > 0.6


@pytest.mark.parametrize("action", [np.array([np.nan, 0.5]), np.array([2.0, 0.5]), None])
def test_illegal_actions_are_made_legal_and_told(action: object) -> None:
    env = navigate_v1.parallel_env(n_cars=2)
    env.reset(seed=0)
    *_, infos = env.step({"car_0": action, "car_1": np.zeros(2)})
    assert [info["illegal"] for info in infos.values()] == [True, False]


def test_what_cannot_be_made_legal_is_refused_and_the_episode_goes_on() -> None:
    env = navigate_v1.parallel_env(n_cars=1)
    with pytest.raises(EpisodeError, match="reset"):
        env.step({})
    env.reset(seed=0)
    with pytest.raises(ActionError, match=r"car_0 has shape \(3,\); valid: \(2,\)"):
        env.step({"car_0": np.zeros(3)})
    with pytest.raises(ActionError, match="car_0 is 'x'; valid: 2 numbers"):
        env.step({"car_0": "x"})
    with pytest.raises(ActionError, match="actions of car_7"):
        env.step({"car_7": np.zeros(2)})
    env.step({"car_0": np.zeros(2)})


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"n_cars": 0}, "n_cars is 0; valid: 1 to 18"),
        ({"n_cars": 99}, "n_cars is 99"),
        ({"fidelity": "grid"}, "fidelity is 'grid'; valid: kinematic, physics"),
        ({"control_hz": 7.0}, "control_hz is 7.0"),
        ({"control_hz": float("nan")}, "control_hz is nan"),
        ({"n_cars": "2"}, "n_cars is '2'"),
        ({"knocks_per_min": -1.0}, "knocks_per_min is -1.0; valid: a number >= 0"),
        ({"control_hz": "x"}, "control_hz is 'x'"),
        ({"control_hz": True}, "control_hz is True"),
        ({"max_cycles": True}, "max_cycles is True"),
        ({"contact": "bounce"}, "contact is 'bounce'; valid: pass, stop"),
        ({"site": 3}, "site is 3; valid: a name or a path"),
        ({"weights": {"late": 1}}, "NavigationWeights, or None"),
        ({"render_mode": "ascii"}, "render_mode is 'ascii'"),
    ],
)
def test_arguments_outside_their_range_are_refused(arguments: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        navigate_v1.parallel_env(**arguments)


def test_it_is_copied_by_its_arguments() -> None:
    copy = pickle.loads(pickle.dumps(navigate_v1.parallel_env(n_cars=2, max_cycles=7)))
    assert (len(copy.possible_agents), copy.max_cycles) == (2, 7)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("fleet/CarNavigate-v1", {"fidelity": "kinematic", "max_steps": 20}),
        ("fleet/CarNavigate-v1", {"fidelity": "physics", "max_steps": 20, "n_others": 1}),
        ("fleet/KukaReach-v0", {"fidelity": "kinematic", "max_steps": 20}),
        ("fleet/KukaReach-v0", {"fidelity": "physics", "max_steps": 20}),
    ],
)
def test_gymnasium_has_no_complaint_about_single_robots(name: str, arguments: dict[str, object]) -> None:
    env = gymnasium.make(name, **arguments)  # type: ignore[arg-type]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
    env.close()


def test_the_first_version_of_a_single_car_is_refused_by_name() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gymnasium says that there is a newer one
        with pytest.raises(VersionError, match=r"^CarNavigate-v0 .*; valid: CarNavigate-v1$"):
            gymnasium.make("fleet/CarNavigate-v0")


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_the_script_reaches_every_goal(fidelity: str) -> None:
    env, policy = KukaReachEnv(fidelity=fidelity), ReachPolicy()
    for seed in range(4):
        row, _ = env.reset(seed=seed)
        ended = False
        while not ended:
            row, _, terminated, truncated, info = env.step(policy.actions(row[None])[0])
            ended = terminated or truncated
        assert info["is_success"]
        assert info["distance_m"] < TOLERANCE_M
    env.close()


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_an_arm_s_episode_repeats_to_the_last_bit(fidelity: str) -> None:
    env = KukaReachEnv(fidelity=fidelity, max_steps=10)

    def episode() -> list[list[float]]:
        rng = np.random.default_rng(0)
        rows = [env.reset(seed=3)[0]]
        rows += [env.step(rng.uniform(-1, 1, 7).astype(np.float32))[0] for _ in range(10)]
        return [row.tolist() for row in rows]

    first = episode()
    env.reset(seed=8)
    env.step(np.ones(7))
    assert episode() == first
    env.close()


def test_an_arm_stops_at_its_limits_and_leaves_the_action_as_it_was() -> None:
    env = KukaReachEnv(fidelity="kinematic")
    first, _ = env.reset(seed=0)
    action = np.array([1.0, np.nan, np.inf, -1.0, -np.inf, -1.0, 1.0])
    told = action.copy()
    for _ in range(90):  # 4.5 s: the first joint needs 2
        row = env.step(action)[0]
    assert row[:7] == pytest.approx([1.0, first[1], 1.0, -1.0, -1.0, -1.0, 1.0], abs=1e-6)
    assert row[7:14] == pytest.approx(np.zeros(7), abs=1e-6)
    assert np.array_equal(action, told, equal_nan=True)


def test_single_robots_refuse_what_they_cannot_do() -> None:
    with pytest.raises(ConfigError, match="fidelity is 'grid'; valid: physics, kinematic"):
        KukaReachEnv(fidelity="grid")
    with pytest.raises(ConfigError, match=r"control_hz is 7\.0"):
        KukaReachEnv(control_hz=7.0)
    with pytest.raises(ConfigError, match="max_steps is '2'"):
        KukaReachEnv(max_steps="2")  # type: ignore[arg-type]
    arm = KukaReachEnv(fidelity="kinematic")
    arm.reset(seed=0)
    with pytest.raises(ActionError, match=r"shape \(2,\); valid: \(7,\)"):
        arm.step(np.zeros(2))
    arm.step(np.zeros(7))
    with pytest.raises(ConfigError, match="n_others is '1'"):
        CarNavigateEnv(n_others="1")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="n_others is -1"):
        CarNavigateEnv(n_others=-1)
