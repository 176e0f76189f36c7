"""What every level of the warehouse owes its agents: it can be done, comes back exactly, and says what it pays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from fleet.config import BatteryConfig
from fleet.envs import warehouse_v1
from fleet.envs.core.base import EnvState
from fleet.envs.policies import make_policy
from fleet.envs.warehouse.env import WarehouseEnv
from fleet.envs.warehouse.levels import LEVELS
from fleet.envs.warehouse.rewards import TERMS, RewardWeights
from fleet.envs.warehouse.rows import GRIP_AT, N_CAR_NUMBERS, STOP_AT
from fleet.tasks.board import TaskState

WORTH = RewardWeights()
FIDELITIES = [pytest.param("kinematic"), pytest.param("physics", marks=pytest.mark.bullet)]


@pytest.fixture
def make() -> Iterator[Callable[..., WarehouseEnv]]:
    """Return a maker of warehouses that are closed after the test."""
    made = []

    def one(**arguments: Any) -> WarehouseEnv:
        made.append(warehouse_v1.parallel_env(**arguments))
        return made[-1]

    yield one
    for env in made:
        env.close()


def sums(env: WarehouseEnv, policy: str, seed: int, n_steps: int = 10_000) -> dict[str, float]:
    """Play an episode by a script; returns the team's sums of terms."""
    mind = make_policy("warehouse", policy)
    totals = dict.fromkeys(TERMS, 0.0)
    observations, _ = env.reset(seed=seed)
    while env.agents and env.n_steps < n_steps:
        observations, _, _, _, infos = env.step(mind.act(env, observations))
        for info in infos.values():
            for term in TERMS:
                totals[term] += info[term]
    return totals


def by_chance(env: WarehouseEnv, seed: int, n_steps: int) -> list[Any]:
    """Play on by chance; returns what the environment said."""
    rng, said = np.random.default_rng(seed), []
    while env.agents and len(said) < n_steps:
        actions = {
            agent: rng.uniform(-1.0, 1.0, env.action_space(agent).shape).astype(np.float32) for agent in env.agents
        }
        said.append((*env.step(actions), env.state()))
    return said


# --- Levels


@pytest.mark.parametrize("fidelity", FIDELITIES)
@pytest.mark.parametrize("car_action", ["drive", "residual"])
def test_the_script_docks(make: Callable[..., WarehouseEnv], car_action: str, fidelity: str) -> None:
    env = make(level="dock", car_action=car_action, fidelity=fidelity)
    done = [sums(env, "classical", seed) for seed in range(4)]
    assert [one["docked"] for one in done] == [WORTH.docked] * 4
    assert all(one["progress"] > 0.2 for one in done)
    assert env.n_steps < env.max_cycles


@pytest.mark.parametrize("fidelity", FIDELITIES)
@pytest.mark.parametrize("arm_action", ["joint", "tip", "residual"])
def test_the_script_picks_and_sets(make: Callable[..., WarehouseEnv], arm_action: str, fidelity: str) -> None:
    env = make(level="transfer", arm_action=arm_action, fidelity=fidelity)
    assert env.possible_agents == ["arm_0", "arm_1"]
    done = sums(env, "classical", 2)
    assert (done["gripped"], done["loaded"], done["delivered"]) == (2 * WORTH.gripped, WORTH.loaded, WORTH.delivered)
    assert env.n_steps < 120


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_plans_are_played_as_fast_as_joints_can_turn(make: Callable[..., WarehouseEnv], fidelity: str) -> None:
    env = make(level="transfer", arm_action="residual", pace=2.0, fidelity=fidelity)
    n_steps, shares = {}, []
    for pace in (0.0, 0.5, 1.0):
        env.reset(seed=2)
        failed = 0.0
        while env.agents:
            _, _, _, _, infos = env.step({agent: np.append(np.zeros(7), pace) for agent in env.agents})
            failed += sum(info["failed"] for info in infos.values())
            assert env.plans is not None
            shares.append(np.abs(env.plans.qd / env.simulation.scene.arms.max_velocity_radps).max())
        assert failed == 0.0
        n_steps[pace] = env.n_steps
    assert n_steps[1.0] <= n_steps[0.5] < 0.8 * n_steps[0.0]
    assert 0.99 < max(shares) < 1.01


def test_the_script_brings_car_and_arm_together(make: Callable[..., WarehouseEnv]) -> None:
    env = make(level="pair", arm_action="tip")
    for seed in range(3):
        done = sums(env, "classical", seed)
        assert done["docked"] == WORTH.docked
        assert done["loaded"] == 2 * WORTH.loaded or done["delivered"] == 2 * WORTH.delivered


@pytest.mark.parametrize("actions", [("drive", "tip"), ("residual", "residual")])
def test_the_script_does_everything(make: Callable[..., WarehouseEnv], actions: tuple[str, str]) -> None:
    env = make(car_action=actions[0], arm_action=actions[1])
    done = sums(env, "classical", 3)
    assert done["delivered"] == 4 * WORTH.delivered  # two parcels, of each a car's part and an arm's


@pytest.mark.parametrize("fidelity", FIDELITIES)
@pytest.mark.parametrize("level", [level for level in LEVELS if level != "all"])
def test_every_level_comes_back_exactly(make: Callable[..., WarehouseEnv], level: str, fidelity: str) -> None:
    settings: dict[str, Any] = {
        "level": level,
        "fidelity": fidelity,
        "arm_action": "tip",
        "start": {"reach_m": (0.02, 0.2)},
        "car_sensing": {"dropout": 0.3, "delay_steps": 2},
        "arm_sensing": {"dropout": 0.3},
        "lidar": True,
    }
    env, other = make(**settings), make(**settings)
    first = env.reset(seed=5)
    before = by_chance(env, 1, 15)
    state = env.save_state()
    after = [by_chance(env, 2, 20), env.reset()]
    np.testing.assert_equal(env.reset(seed=5), first)
    np.testing.assert_equal(by_chance(env, 1, 15), before)
    env.load_state(state)
    np.testing.assert_equal([by_chance(env, 2, 20), env.reset()], after)
    other.load_state(EnvState(**{**state.__dict__, "quick": None}))
    np.testing.assert_equal([by_chance(other, 2, 20), other.reset()], after)


def test_starts_differ_and_tolerances_decide(make: Callable[..., WarehouseEnv]) -> None:
    env = make(level="dock", stop_m=0.5, stop_rad=1.0)
    offsets = []
    for seed in range(12):
        observations, _ = env.reset(seed=seed)
        offsets.append(observations["car_0"][[STOP_AT, STOP_AT + 1, 10, 12, 14]])
    rows = np.array(offsets)
    assert len(np.unique(rows[:, 0])) > 6
    assert (rows[:, 2] + rows[:, 3] == 1.0).all(), "every car is on its way to a dock"
    assert 2 <= rows[:, 4].sum() <= 10, "some with a parcel"
    assert (rows[:, 3] == rows[:, 4]).all()
    # A car that stands half a metre from its stop has docked at this tolerance, and not at the true one.
    for stop_m, docked in ((0.5, WORTH.docked), (0.05, 0.0)):
        env = make(level="dock", stop_m=stop_m, max_cycles=5, start={"near_m": (0.2, 0.3), "side_m": 0.0})
        env.reset(seed=1)
        paid = 0.0
        while env.agents:
            *_, infos = env.step({"car_0": np.zeros(2)})
            paid += infos["car_0"]["docked"]
        assert paid == docked


def test_parcels_begin_in_trays_as_the_start_says(make: Callable[..., WarehouseEnv]) -> None:
    for start, most in (({}, (1e-9, 1e-9)), ({"parcel_m": 0.04, "parcel_rad": np.pi}, (0.04, np.pi))):
        env, lying = make(level="transfer", start=start), []
        for seed in range(12):
            env.reset(seed=seed)
            simulation = env.simulation
            (task,) = (one for one in simulation.board.tasks if one.state is TaskState.CARRIED)
            assert task.car is not None
            x, y, yaw = simulation.world.car_poses()[task.car]
            pose = simulation.view.knowledge.inventory.pose(task)
            cos, sin = np.cos(yaw), np.sin(yaw)
            ahead, left = cos * (pose[0] - x) + sin * (pose[1] - y), cos * (pose[1] - y) - sin * (pose[0] - x)
            turn = math.remainder(2.0 * math.atan2(pose[5], pose[6]) - yaw, math.tau)
            lying.append(np.abs([ahead - simulation.scene.cars[task.car].tray_x_m, left, turn]))
        farthest = np.max(lying, axis=0)
        assert (farthest <= np.array([most[0], most[0], most[1]]) + 1e-9).all()
        assert (farthest >= 0.7 * np.array([most[0], most[0], most[1]]) - 1e-9).all()


def test_cars_that_begin_on_their_ways_are_apart(make: Callable[..., WarehouseEnv]) -> None:
    env = make(level="dock", site="cell", n_cars=2, max_cycles=1, start={"near_m": (0.5, 12.0)})
    for seed in range(65, 75):  # with 71 they began in one cell once
        env.reset(seed=seed)
        (x, y), (other_x, other_y) = env.simulation.world.car_poses()[:, :2]
        assert np.hypot(x - other_x, y - other_y) >= 1.0
        env.step({agent: np.zeros(2) for agent in env.agents})


# --- Actions


@pytest.mark.bullet
def test_cars_are_held_to_their_limits_in_physics_too(make: Callable[..., WarehouseEnv]) -> None:
    def speeds(**arguments: Any) -> list[float]:
        env = make(level="dock", start={"near_m": (4.0, 4.0)}, **arguments)
        env.reset(seed=1)
        told = [1.0] * 5 + [0.0] * 3
        return [float(env.step({"car_0": np.array([0.0, one])})[0]["car_0"][4]) * 2.0 for one in told]

    kinematic = speeds()
    assert speeds(ramp=True) == kinematic
    assert speeds(ramp=True, fidelity="physics") == pytest.approx(kinematic, abs=0.01)
    assert speeds(fidelity="physics")[0] > 4.0 * kinematic[0]


def test_a_car_is_braked_where_its_grant_ends_and_backs_off_as_it_is_told(make: Callable[..., WarehouseEnv]) -> None:
    def granted_m(told: float, n_steps: int, **arguments: Any) -> float:
        env = make(
            level="dock", start={"near_m": (0.3, 0.3), "side_m": 0.0, "turn_rad": 0.0}, stop_rad=0.01, **arguments
        )
        env.reset(seed=1)
        left = [0.0]
        while env.agents and len(left) <= n_steps:
            left.append(float(env.step({"car_0": np.array([0.0, told])})[0]["car_0"][15]) * 3.0)
        return left[-1]

    assert granted_m(1.0, 15) < -0.3
    assert -0.05 < granted_m(1.0, 15, grants_hold=True) < 0.0
    assert granted_m(-1.0, 5, grants_hold=True) == granted_m(-1.0, 5) > 0.3


@pytest.mark.parametrize("grants_hold", [False, True])
def test_a_car_that_is_served_stands_where_grants_hold(make: Callable[..., WarehouseEnv], grants_hold: bool) -> None:
    start = {"cars": "docked", "side_m": 0.0, "turn_rad": 0.0}
    env = make(level="pair", start=start, grants_hold=grants_hold, stop_m=0.3)
    env.reset(seed=1)
    stood = None
    while stood is None or len(stood) < 15:
        observations = env.step({"car_0": np.array([0.5, -0.5 if stood else 0.0])})[0]
        served = observations["car_0"][11] + observations["car_0"][13] > 0.0
        if served:
            stood = [*(stood or []), env.simulation.world.car_poses()[0].copy()]
        assert stood is None or served
    gone_m = math.hypot(*(stood[-1] - stood[0])[:2])
    assert gone_m == 0.0 if grants_hold else gone_m > 0.1


def test_a_car_in_the_dead_band_brakes(make: Callable[..., WarehouseEnv]) -> None:
    env = make(level="dock", dead_band=0.2, start={"near_m": (3.0, 3.0)})
    env.reset(seed=0)
    for _ in range(10):
        env.step({"car_0": np.array([0.0, 1.0])})
    assert env.simulation.world.car_speeds()[0] == pytest.approx(1.0, abs=0.05)
    for _ in range(8):
        env.step({"car_0": np.array([0.0, 0.19])})
    assert env.simulation.world.car_speeds()[0] == 0.0


def test_a_grip_latches(make: Callable[..., WarehouseEnv]) -> None:
    """Who changes its mind keeps what it holds; who asks for half a second lets go, and stays open."""
    env = make(level="transfer", arm_action="tip", n_arms=1, max_cycles=1000)
    mind = make_policy("warehouse", "classical")
    observations, _ = env.reset(seed=0)
    while env.simulation.world.held()[0] < 0:
        observations, *_ = env.step(mind.act(env, observations))
    for grip in (-1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0, -1.0, 1.0):
        observations, *_ = env.step({"arm_0": np.array([0.0, 0.0, 0.0, 0.0, grip])})
        assert env.simulation.world.held()[0] >= 0
    opening = []
    for _ in range(5):
        observations, *_ = env.step({"arm_0": np.array([0.0, 0.0, 0.0, 0.0, -1.0])})
        opening.append(float(observations["arm_0"][GRIP_AT + 1]))
    assert opening == pytest.approx([0.2, 0.4, 0.6, 0.8, -1.0], abs=0.06)
    assert env.simulation.world.held()[0] < 0
    for _ in range(8):
        observations, *_ = env.step({"arm_0": np.array([0.0, 0.0, 0.0, 0.0, 1.0])})
        assert env.simulation.world.held()[0] < 0


# --- Rewards


def test_a_team_shares_what_it_is_told_to(make: Callable[..., WarehouseEnv]) -> None:
    paid = {}
    for share in (0.0, 0.25, 1.0):
        env = make(n_cars=2, n_arms=1, team_share=share, tasks=1)
        mind, total = make_policy("warehouse", "classical"), dict.fromkeys(env.possible_agents, 0.0)
        observations, _ = env.reset(seed=1)
        while env.agents:
            observations, _, _, _, infos = env.step(mind.act(env, observations))
            for agent, info in infos.items():
                total[agent] += info["loaded"] / WORTH.loaded
        paid[share] = sorted(total.values())
    assert paid == {0.0: [0.0, 1.0, 1.0], 0.25: [0.25, 1.0, 1.0], 1.0: [1.0, 1.0, 1.0]}


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_a_contact_is_paid_by_those_who_touch(make: Callable[..., WarehouseEnv], fidelity: str) -> None:
    env = make(n_cars=3, n_arms=0, fidelity=fidelity)
    env.reset(seed=0)
    touched = dict.fromkeys(env.agents, 0.0)
    for _ in range(60):  # out of the parking place and into the wall, the others stand
        *_, infos = env.step({"car_0": np.array([0.0, 1.0])})
        for agent, info in infos.items():
            touched[agent] += info["contact"]
    assert touched["car_0"] < 0.0
    assert touched["car_1"] == touched["car_2"] == 0.0
    contacts = env.simulation.world.contacts()
    assert contacts.robot == 0
    assert -touched["car_0"] == contacts.static == env.simulation.world.contacts_of()[0][0]


# --- Teams


def test_teams_differ_in_size(make: Callable[..., WarehouseEnv]) -> None:
    env = make(n_cars=(1, 3), n_arms=1)
    assert env.possible_agents == ["car_0", "car_1", "car_2", "arm_0"]
    sizes = set()
    for seed in range(10):
        observations, infos = env.reset(seed=seed)
        sizes.add(len(env.agents))
        assert list(observations) == list(infos) == env.agents
        assert env.agents[-1] == "arm_0"
        said = by_chance(env, seed, 2)[-1]
        assert list(said[0]) == list(said[1]) == env.agents
        assert env.state_space.contains(env.state())
        rows = env.state()[: 3 * N_CAR_NUMBERS].reshape(3, -1)
        assert (rows[len(env.agents) - 1 :] == 0.0).all()
    assert sizes == {2, 3, 4}


def test_a_state_brings_back_its_team(make: Callable[..., WarehouseEnv]) -> None:
    env = make(n_cars=(1, 3), n_arms=1)
    env.reset(seed=0)
    state, team = env.save_state(), env.agents[:]
    expected = by_chance(env, 1, 10)
    seed = 1
    while len(env.reset(seed=seed)[0]) == len(team):
        seed += 1
    env.load_state(state)
    assert env.agents == team
    np.testing.assert_equal(by_chance(env, 1, 10), expected)


def test_cars_are_lost_for_good_and_stop_for_a_while(make: Callable[..., WarehouseEnv]) -> None:
    env = make(n_cars=3, n_arms=0, breakdowns={"losses_per_h": 100.0}, max_cycles=1200)
    observations, _ = env.reset(seed=3)
    mind = make_policy("warehouse", "classical")
    left, middle = [], None
    while env.agents:
        here = env.agents[:]
        observations, _, terminations, truncations, _ = env.step(
            mind.act(env, {agent: observations[agent] for agent in here})
        )
        assert list(observations) == list(terminations) == here
        gone = [agent for agent in here if agent not in env.agents]
        if env.agents and gone:
            left += gone
            assert all(terminations[agent] and not truncations[agent] for agent in gone)
            middle = env.save_state(), env.agents[:]
    assert left, "a car is lost every 12 s of three"
    assert middle is not None
    env.load_state(middle[0])
    assert env.agents == middle[1]
    assert len(env.reset(seed=3)[0]) == 3

    env = make(level="dock", breakdowns={"stops_per_h": 3600.0, "stop_s": 2.0}, start={"near_m": (3.0, 3.0)})
    env.reset(seed=0)
    told = [(env.step({"car_0": np.array([0.0, 0.3])})[0]["car_0"][N_CAR_NUMBERS - 1]) for _ in range(60)]
    assert set(told) == {0.0, 1.0}
    assert env.agents == ["car_0"]


def test_an_empty_battery_ends_an_agent(make: Callable[..., WarehouseEnv]) -> None:
    battery = BatteryConfig(enabled=True, start=0.02, capacity_wh=0.5, margin=0.0, critical=0.0)
    env = make(n_cars=1, n_arms=1, battery=battery)
    env.reset(seed=0)
    while "car_0" in env.agents:
        *_, terminations, truncations, _ = env.step({})
    assert (terminations["car_0"], truncations["car_0"]) == (True, False)
    assert env.agents == ["arm_0"]


def test_agents_that_the_caller_removes_do_nothing(make: Callable[..., WarehouseEnv]) -> None:
    env = make(n_cars=2, n_arms=0)
    env.reset(seed=0)
    env.agents.remove("car_0")
    for _ in range(10):
        said = env.step({agent: np.array([0.0, 1.0]) for agent in env.agents})
        assert all(list(part) == ["car_1"] for part in said)
    assert env.simulation.world.car_speeds()[0] == 0.0 < env.simulation.world.car_speeds()[1]
    state = env.save_state()
    env.reset()
    env.load_state(state)
    assert env.agents == ["car_1"]


# --- Senses


def test_rows_come_late_and_get_lost(make: Callable[..., WarehouseEnv]) -> None:
    plain = make(n_cars=1, n_arms=0)
    late = make(n_cars=1, n_arms=0, car_sensing={"delay_steps": 3})
    lossy = make(n_cars=1, n_arms=0, car_sensing={"dropout": 0.5})
    seen: list[list[Any]] = []
    for env in (plain, late, lossy):
        rows = [env.reset(seed=0)[0]["car_0"]]
        rows += [env.step({"car_0": np.array([0.1, 0.5])})[0]["car_0"] for _ in range(30)]
        seen.append(rows)
    truth, delayed, holed = seen
    np.testing.assert_equal(delayed[3:], truth[:-3])
    same = [np.array_equal(a, b) for a, b in zip(truth, holed, strict=True)]
    assert 5 < sum(same) < 26
    assert all(ok or np.array_equal(holed[k], holed[k - 1]) for k, ok in enumerate(same) if k), (
        "what is lost is what was seen last"
    )


def test_sight_ends_where_it_is_told_to(make: Callable[..., WarehouseEnv]) -> None:
    for range_m, sees in ((3.0, 1.0), (0.5, 0.0)):
        env = make(n_cars=3, n_arms=0, car_sensing={"range_m": range_m})
        observations, _ = env.reset(seed=0)
        assert observations["car_0"][27] == sees


@pytest.mark.bullet
def test_with_a_camera_all_see_dictionaries(make: Callable[..., WarehouseEnv]) -> None:
    env = make(level="pair", fidelity="physics", camera=(16, 24))
    observations, _ = env.reset(seed=0)
    assert set(observations["car_0"]) == {"row", "image"}
    assert set(observations["arm_0"]) == {"row"}
    assert all(env.observation_space(agent).contains(seen) for agent, seen in observations.items())


def test_states_of_teams_that_differ_in_size_are_loaded_whatever_team_plays_now() -> None:
    """One that was saved with three cars was refused while two played."""
    env = warehouse_v1.parallel_env(site="small", n_cars=(1, 3), fidelity="kinematic", max_cycles=20)
    seeds: dict[int, int] = {}
    for seed in range(30):
        env.reset(seed=seed)
        seeds.setdefault(sum(agent.startswith("car") for agent in env.agents), seed)
    assert set(seeds) == {1, 2, 3}
    env.reset(seed=seeds[3])
    env.step({})
    state, agents = env.save_state(), list(env.agents)
    env.reset(seed=seeds[1])
    env.load_state(state)
    assert env.agents == agents
    other = warehouse_v1.parallel_env(site="small", n_cars=(1, 3), fidelity="kinematic", max_cycles=20)
    other.load_state(state)
    assert other.agents == agents
    env.close()
    other.close()


def test_pettingzoo_makes_a_level_as_long_as_it_is() -> None:
    import pettingzoo

    env = pettingzoo.make("parallel", "fleet/warehouse-v1", level="dock")
    assert env.max_cycles == warehouse_v1.parallel_env(level="dock").max_cycles == 300
    env.close()
