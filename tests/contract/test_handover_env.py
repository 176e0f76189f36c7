"""What the hand-over environment owes those who train on it: parcels, trays, latecomers, rewards, exactness."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.envs import handover_v0, make_vec
from fleet.envs.core.base import EnvState
from fleet.envs.handover.config import TERMS, HandoverWeights
from fleet.envs.handover.env import HandoverEnv
from fleet.envs.handover.motors import STOP_S, Motors
from fleet.envs.handover.parcels import REST_S, Happened
from fleet.envs.handover.rewards import COUNTED
from fleet.envs.handover.rows import N_ARM_NUMBERS, N_CAR_NUMBERS, N_OWN
from fleet.envs.policies import make_policy
from fleet.errors import ConfigError
from fleet.world.protocol import ParcelBody

RESTS = round(REST_S * 10) + 1
"""Steps after which a parcel that lies still has been noticed."""


@pytest.fixture
def env() -> Iterator[HandoverEnv]:
    """Return two cars and two arms on the cell, in the beginning of an episode."""
    made = handover_v0.parallel_env()
    made.reset(seed=0)
    yield made
    made.close()


def idle(env: HandoverEnv, n_steps: int, **actions: Any) -> list[dict[str, dict[str, Any]]]:
    """Let nobody do anything but those who are named; return infos."""
    told = []
    for _ in range(n_steps):
        still = {agent: np.zeros(env.action_space(agent).shape) for agent in env.agents}
        told.append(env.step(still | actions)[4])
    return told


def summed(told: list[dict[str, dict[str, Any]]], name: str) -> dict[str, float]:
    """Sum of an entry of infos, by agent."""
    return {agent: sum(infos[agent][name] for infos in told) for agent in told[0]}


def put(env: HandoverEnv, number: int, x: float, y: float, z: float) -> None:
    """Take a parcel from where it is and let it fall elsewhere."""
    known = env._book._known[number].order
    env._world.remove_parcel(number)
    pose = np.array([x, y, z + known.size_m[2] / 2, 0.0, 0.0, 0.0, 1.0])
    env._world.add_parcel(ParcelBody(parcel=number, size_m=known.size_m, mass_kg=known.mass_kg, pose=pose))


def beside_tray(env: HandoverEnv, car: int, ahead: float, left: float) -> tuple[float, float]:
    """Return a point in a car's frame, from the middle of its tray, in the world."""
    x, y, yaw = env._world.car_poses()[car].tolist()
    ahead += env._scene.car.tray_x_m
    return x + np.cos(yaw) * ahead - np.sin(yaw) * left, y + np.sin(yaw) * ahead + np.cos(yaw) * left


def test_a_parcel_belongs_to_the_tray_in_which_it_lies_also_near_its_walls(env: HandoverEnv) -> None:
    put(env, 0, *beside_tray(env, 1, 0.14, 0.10), 0.2)
    told = idle(env, RESTS - 2)
    assert env.happened[Happened.LOADED] == 0, "it has to lie still for a while"
    told += idle(env, 2)
    assert summed(told, "n_loaded") == {"car_0": 0.0, "car_1": 1.0, "arm_0": 0.0, "arm_1": 0.0}
    assert summed(told, "loaded")["car_1"] == HandoverWeights().loaded
    assert env._observer.cars.loads.tolist() == [0, 1]
    idle(env, 20)
    assert env.happened[Happened.LOADED] == 1, "it is loaded once"


@pytest.mark.parametrize(("ahead", "left"), [(0.0, 0.13), (0.0, -0.13), (0.17, 0.0), (-0.17, 0.0)])
def test_a_parcel_beside_a_tray_is_lost_and_taken_away(env: HandoverEnv, ahead: float, left: float) -> None:
    put(env, 0, *beside_tray(env, 0, ahead, left), 0.2)
    idle(env, RESTS)
    assert env.happened[Happened.LOST] == 1
    assert env.happened[Happened.LOADED] == 0
    assert 0 not in env._world.parcel_ids()


def test_a_parcel_on_a_slot_of_a_drop_arm_is_delivered_and_on_a_pick_arm_s_it_waits(env: HandoverEnv) -> None:
    slots = env._places.slots
    put(env, 0, *slots[3].tolist())
    put(env, 1, *slots[-1].tolist())
    idle(env, RESTS)
    assert env.happened[Happened.DELIVERED] == 1
    assert 0 in env._world.parcel_ids()
    assert 1 not in env._world.parcel_ids()


def test_a_parcel_that_falls_off_a_car_is_the_car_s_loss(env: HandoverEnv) -> None:
    put(env, 0, *beside_tray(env, 1, 0.0, 0.0), 0.2)
    idle(env, RESTS)
    put(env, 0, *beside_tray(env, 1, 0.5, 0.0), 0.2)
    told = idle(env, RESTS)
    assert summed(told, "lost") == {"car_0": 0.0, "car_1": -10.0, "arm_0": 0.0, "arm_1": 0.0}


@pytest.mark.parametrize("team_share", [0.0, 0.5])
def test_a_parcel_that_an_arm_drops_is_the_arm_s_loss_or_the_team_s(team_share: float) -> None:
    env = handover_v0.parallel_env(team_share=team_share)
    seen, _ = env.reset(seed=0)
    policy = make_policy("handover", "first_come")
    while env._world.held()[0] < 0:
        seen, *_ = env.step({**policy.act(env, seen), "car_0": np.zeros(2), "car_1": np.zeros(2)})
    told = idle(env, 8, arm_0=np.array([0.0, 0.0, 1.0, 0.0, 1.0]))
    told += idle(env, 12, arm_0=np.array([0.0, 1.0, 0.0, 0.0, 1.0]))
    assert env._world.held()[0] >= 0
    told += idle(env, 2 * RESTS + 5, arm_0=np.array([0.0, 0.0, 0.0, 0.0, -1.0]))
    assert summed(told, "n_lost") == {"car_0": 0.0, "car_1": 0.0, "arm_0": 1.0, "arm_1": 0.0}
    others = -10.0 * team_share
    assert summed(told, "lost") == {"car_0": others, "car_1": others, "arm_0": -10.0, "arm_1": others}
    env.close()


def test_an_arm_sets_a_parcel_in_the_tray_of_a_car_that_drives_on(env: HandoverEnv) -> None:
    policy = make_policy("handover", "first_come")
    seen, _ = env.reset(seed=0)
    speeds = []
    while env.happened[Happened.LOADED] == 0:
        assert env.agents, "never loaded"
        actions = policy.act(env, seen)
        left_m = 20.0 * seen["car_0"][N_OWN + 1]
        if left_m < 0.35:  # past its stop as slowly as a car drives
            actions["car_0"] = np.array([0.0, 0.11])
        actions["car_1"] = np.zeros(2)
        seen, *_ = env.step(actions)
        speeds.append(env._world.car_speeds()[0])
    assert np.abs(speeds[-20:]).min() > 0.1
    assert env._observer.cars.loads.tolist() == [1, 0]


@pytest.mark.parametrize("first", ["car_0", "car_1"])
def test_whichever_car_comes_first_is_served(env: HandoverEnv, first: str) -> None:
    policy = make_policy("handover", "first_come")
    seen, _ = env.reset(seed=1)
    waiting = N_OWN + 11
    assert seen["car_0"][waiting] == seen["car_1"][waiting] > 0.0, "both see that parcels wait"
    loaded: dict[str, float] = {"car_0": 0.0, "car_1": 0.0}
    while not any(loaded.values()):
        actions = policy.act(env, seen)
        other = "car_1" if first == "car_0" else "car_0"
        if env.n_steps < 120:
            actions[other] = np.zeros(2)
        seen, _, _, _, infos = env.step(actions)
        loaded = {car: infos[car]["n_loaded"] for car in loaded}
    assert [car for car, n in loaded.items() if n] == [first]


def test_cars_that_are_late_do_not_move_before_their_motors_run() -> None:
    env = handover_v0.parallel_env(late_s=20.0)
    seen, _ = env.reset(seed=3)
    starts_s = env._motors.pauses[:, 0, 1]
    assert (starts_s > 0.5).all()
    assert starts_s.max() <= 20.0
    parked = env._world.car_poses()[:, :2]
    for _ in range(int(10.0 * starts_s.min()) - 1):
        assert [seen[car][3] for car in ("car_0", "car_1")] == [0.0, 0.0]
        seen, *_ = env.step({"car_0": np.array([0.0, 1.0]), "car_1": np.array([0.0, 1.0])})
    np.testing.assert_array_equal(env._world.car_poses()[:, :2], parked)
    idle(env, 20, car_0=np.array([0.0, 1.0]), car_1=np.array([0.0, 1.0]))
    moved = np.abs(env._world.car_poses()[:, :2] - parked).max(axis=1) > 0.0
    assert moved.tolist() == (starts_s < env.n_steps / 10 - 0.1).tolist()
    env.close()


def test_motors_stop_now_and_then_and_start_again() -> None:
    motors = Motors(5.0, 6.0, 600.0, np.random.default_rng(0).spawn(3))
    assert motors.pauses.shape[0] == 3
    for pauses in motors.pauses:
        stops = pauses[np.isfinite(pauses[:, 0])]
        assert stops[0, 0] == 0.0
        assert 0.0 <= stops[0, 1] <= 5.0
        assert (stops[1:, 0] > stops[:-1, 1]).all()
        lasted = stops[1:, 1] - stops[1:, 0]
        assert STOP_S[0] <= lasted.min() <= lasted.max() <= STOP_S[1]
        assert 30 <= len(stops) <= 60  # once in 10 s of driving, and 4 s of standing
    middle_s = float(motors.pauses[1, 2].mean())
    assert not motors.run(middle_s)[1]
    assert motors.run(float(motors.pauses[1, 2, 1]))[1]
    assert Motors(0.0, 0.0, 60.0, np.random.default_rng(0).spawn(2)).run(0.0).tolist() == [True, True]


def test_a_car_whose_motor_stops_brakes_whatever_it_is_told() -> None:
    env = handover_v0.parallel_env(n_cars=1, stops_per_min=12.0)
    env.reset(seed=0)
    stop_s, start_s = env._motors.pauses[0, 1]
    idle(env, int(10.0 * stop_s) + 15, car_0=np.array([0.5, 0.5]))
    assert env._world.car_speeds()[0] == 0.0
    idle(env, round(10.0 * start_s) + 6 - env.n_steps, car_0=np.array([0.5, 0.5]))
    assert env._world.car_speeds()[0] != 0.0
    env.close()


@pytest.mark.parametrize("late", [{}, {"late_s": 15.0}, {"late_s": 5.0, "stops_per_min": 2.0}])
def test_the_script_delivers(late: dict[str, float]) -> None:
    env = handover_v0.parallel_env(**late)
    for seed in range(3):
        policy = make_policy("handover", "first_come", seed)
        seen, _ = env.reset(seed=seed)
        told = []
        while env.agents:
            seen, _, _, _, infos = env.step(policy.act(env, seen))
            told.append(infos)
        assert env.happened[Happened.DELIVERED] >= 2
        assert env.happened[Happened.LOST] == 0
        delivered = summed(told, "n_delivered")
        assert delivered["arm_1"] == delivered["car_0"] + delivered["car_1"] == env.happened[Happened.DELIVERED]
    env.close()


@pytest.mark.bullet
def test_the_script_delivers_in_physics() -> None:
    env = handover_v0.parallel_env(fidelity="physics", max_cycles=450)
    policy = make_policy("handover", "first_come")
    seen, _ = env.reset(seed=0)
    while env.agents:
        seen, *_ = env.step(policy.act(env, seen))
    assert env.happened[Happened.DELIVERED] >= 1
    assert env.happened[Happened.LOST] == 0
    env.close()


def test_the_same_parcels_arrive_whatever_agents_do(env: HandoverEnv) -> None:
    def arrived(works: bool) -> dict[int, Any]:
        policy = make_policy("handover", "first_come")
        seen, _ = env.reset(seed=4)
        orders: dict[int, Any] = {}
        while env.agents:
            orders |= {number: known.order for number, known in env._book._known.items()}
            seen, *_ = env.step(policy.act(env, seen) if works else {})
        return orders

    worked, idled = arrived(True), arrived(False)
    assert len(worked) > len(idled) == 4, "the slots are full"
    assert {number: worked[number] for number in idled} == idled
    assert sorted(worked) == list(range(len(worked)))


@pytest.mark.parametrize("fidelity", ["kinematic", pytest.param("physics", marks=pytest.mark.bullet)])
def test_a_saved_moment_comes_back_exactly(fidelity: str, tmp_path: Path) -> None:
    env = handover_v0.parallel_env(fidelity=fidelity, late_s=3.0, stops_per_min=6.0, max_cycles=90)
    policy = make_policy("handover", "first_come")
    seen, _ = env.reset(seed=2)
    for _ in range(40):
        seen, *_ = env.step(policy.act(env, seen))
    env.save_state().write(tmp_path / "state")

    def rest(seen: Any) -> list[Any]:
        told = []
        while env.agents:
            told.append(env.step(policy.act(env, seen)))
            seen = told[-1][0]
        return told

    expected = rest(seen)
    twin = pickle.loads(pickle.dumps(env))
    for other in (env, twin):
        env = other
        np.testing.assert_equal(rest(env.load_state(EnvState.read(tmp_path / "state"))), expected)
        env.close()


def test_rewards_are_the_sums_of_their_terms_and_weights_count(env: HandoverEnv) -> None:
    paid = handover_v0.parallel_env(weights=HandoverWeights(progress=0.0, time=-2.0))
    paid.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(30):
        actions = {agent: rng.uniform(-1, 1, env.action_space(agent).shape) for agent in env.agents}
        _, rewards, _, _, infos = env.step(actions)
        for agent, info in infos.items():
            assert list(info) == [*TERMS, *COUNTED, "illegal"]
            assert rewards[agent] == pytest.approx(sum(info[term] for term in TERMS))
        *_, infos = paid.step(actions)
        assert all(info["progress"] == 0.0 and info["time"] == -0.2 for info in infos.values())
    paid.close()


def test_progress_adds_up_to_what_has_become_of_the_way() -> None:
    # Full steering, so that it is at another place of the lanes in every other step.
    env = handover_v0.parallel_env(n_cars=1)
    env.reset(seed=0)
    before = env._observer.cars.left_m[0, 0]
    told = idle(env, 300, car_0=np.array([1.0, 0.6]))
    assert summed(told, "progress")["car_0"] == pytest.approx(before - env._observer.cars.left_m[0, 0])
    env.close()


def test_an_arm_that_goes_up_and_down_over_a_parcel_is_paid_once(env: HandoverEnv) -> None:
    def down_and_up() -> float:
        told = idle(env, 5, arm_0=np.array([0.0, 0.0, -0.5, 0.0, -1.0]))
        told += idle(env, 5, arm_0=np.array([0.0, 0.0, 0.5, 0.0, -1.0]))
        return summed(told, "progress")["arm_0"]

    assert down_and_up() > 0.02
    assert down_and_up() < 0.005
    told = idle(env, 8, arm_0=np.array([0.0, 0.0, -0.5, 0.0, -1.0]))
    assert summed(told, "progress")["arm_0"] > 0.01


@pytest.mark.parametrize("settings", [{"n_cars": 1}, {"n_cars": 3}, {"site": "small", "n_cars": 4}])
def test_what_is_seen_is_in_its_space_and_of_one_size(settings: dict[str, Any]) -> None:
    env = handover_v0.parallel_env(**settings, late_s=2.0, parcels_per_min=60.0)
    rng = np.random.default_rng(0)
    seen, _ = env.reset(seed=0)
    for _ in range(80):
        sizes = {agent: N_CAR_NUMBERS if agent.startswith("car") else N_ARM_NUMBERS for agent in env.possible_agents}
        assert {agent: len(row) for agent, row in seen.items()} == sizes
        assert all(env.observation_space(agent).contains(row) for agent, row in seen.items())
        assert env.state_space.contains(env.state())
        np.testing.assert_array_equal(env.state(), np.concatenate(list(seen.values())))
        seen, *_ = env.step(
            {agent: rng.uniform(-1, 1, env.action_space(agent).shape).astype(np.float32) for agent in env.agents}
        )
    env.close()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"n_cars": 4}, "n_cars is 4; valid: 1 to 3 on site cell"),
        ({"n_cars": 0}, "n_cars"),
        ({"fidelity": "grid"}, "fidelity.*kinematic, physics"),
        ({"late_s": -1.0}, "late_s is -1.0; valid: a number from 0 to 600"),
        ({"stops_per_min": 61}, "stops_per_min"),
        ({"parcels_per_min": 0.0}, "parcels_per_min"),
        ({"team_share": 1.5}, "team_share"),
        ({"speed_mps": 3.0}, "speed_mps"),
        ({"hold_s": "long"}, "hold_s"),
        ({"control_hz": 7.0}, "control_hz is 7.0; valid: 20 / 1, 2, 3, ..."),
        ({"site": "dense", "n_cars": 2, "weights": 3}, "weights"),
        ({"site": 5}, "site"),
    ],
)
def test_bad_settings_are_refused_by_name(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        handover_v0.parallel_env(**settings)
    with pytest.raises(ConfigError, match="weight lost"):
        HandoverWeights(lost=float("nan"))


def test_many_are_stepped_as_one() -> None:
    vec = make_vec("handover", 2, n_cars=1, max_cycles=5)
    alone = handover_v0.parallel_env(n_cars=1, max_cycles=5)
    view = vec.reset(seeds=[7, 8])
    seen, _ = alone.reset(seed=8)
    np.testing.assert_array_equal(view.observations["car"][1, 0], seen["car_0"])
    assert view.observations["arm"].shape == (2, 2, N_ARM_NUMBERS)
    for _ in range(5):
        step = vec.step({"car": np.full((2, 1, 2), 0.3), "arm": np.full((2, 2, 5), 0.3)})
        seen, rewards, *_ = alone.step({agent: np.full(alone.action_space(agent).shape, 0.3) for agent in alone.agents})
        assert step.rewards["arm"][1].tolist() == [rewards["arm_0"], rewards["arm_1"]]
    assert step.truncated.all()
    assert step.final is not None
    np.testing.assert_array_equal(step.final.observations["arm"][1, 1], seen["arm_1"])
    vec.close()
    alone.close()
