"""What every PettingZoo environment owes the libraries that train on it, and what the warehouse owes its agents."""

from __future__ import annotations

import copy
import math
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import numpy.typing as npt
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

from fleet.config import ArmConfig, ConfigError
from fleet.envs import warehouse_v0
from fleet.envs.observations import NEAR_M
from fleet.envs.rewards import TERMS, RewardWeights
from fleet.envs.warehouse import EpisodeError, WarehouseEnv
from fleet.roster import CarPhase
from fleet.stations.arm_cell import arm_cells
from fleet.stations.arm_desk import ArmDesk
from fleet.stations.arm_planner import make_arm_planner
from fleet.tasks.board import TaskState

Actions = dict[str, npt.NDArray[np.float32]]

ENVS = {"warehouse_v0": warehouse_v0}
HETEROGENEOUS = ("different observation space sizes", "Observations are different shapes")
"""What PettingZoo warns about whenever agents are of different types."""


@pytest.fixture(params=ENVS)
def module(request: pytest.FixtureRequest) -> ModuleType:
    """Return the module of one environment."""
    return ENVS[request.param]


@pytest.fixture
def make() -> Iterator[Callable[..., WarehouseEnv]]:
    """Return a maker of warehouses that are closed after the test."""
    made = []

    def one(**arguments: object) -> WarehouseEnv:
        made.append(WarehouseEnv(**arguments))  # type: ignore[arg-type]
        return made[-1]

    yield one
    for env in made:
        env.close()
        env.close()


def sampled(env: WarehouseEnv, rng: np.random.Generator) -> Actions:
    """Return random actions that lean forward, so that cars get somewhere."""
    actions = {}
    for agent in env.agents:
        action = rng.uniform(-1.0, 1.0, env.action_space(agent).shape)
        action[-1] = abs(action[-1])
        actions[agent] = action.astype(np.float32)
    return actions


def episode(env: WarehouseEnv, seed: int | None, n_steps: int | None = None) -> list[object]:
    """Play one episode, or its first steps, and return all that the environment said."""
    rng = np.random.default_rng(0)
    said: list[object] = [env.reset(seed=seed)]
    while env.agents and n_steps != len(said) - 1:
        said.append((*env.step(sampled(env, rng)), env.state()))
    return said


# --- PettingZoo's own tests


def test_parallel_api(module: ModuleType) -> None:
    env = module.parallel_env()
    parallel_api_test(env, num_cycles=200)
    env.close()


def test_api_of_the_turn_based_form(module: ModuleType) -> None:
    with warnings.catch_warnings():
        for text in HETEROGENEOUS:
            warnings.filterwarnings("ignore", message=f".*{text}")
        api_test(parallel_to_aec(module.parallel_env(max_cycles=60)), num_cycles=100)


def test_seeds(module: ModuleType) -> None:
    parallel_seed_test(module.parallel_env, num_cycles=100)
    seed_test(module.env, num_cycles=100)


def test_max_cycles(module: ModuleType) -> None:
    max_cycles_test(module)


def test_state(module: ModuleType) -> None:
    state_test(module.env(), module.parallel_env(), num_cycles=30)


def test_render(module: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    render_test(module.env)


def test_registry() -> None:
    for kind, registry in (("parallel", pettingzoo.parallel_registry), ("aec", pettingzoo.aec_registry)):
        assert "fleet/warehouse-v0" in registry
        env = pettingzoo.make(kind, "fleet/warehouse-v0", n_cars=2, max_cycles=7)
        assert env.possible_agents == ["car_0", "car_1", "arm_0", "arm_1"]
        assert env.unwrapped.max_cycles == 7
        env.close()


# --- What they leave out


@pytest.mark.parametrize("control", ["all", "cars", "arms"])
@pytest.mark.parametrize("n_cars", [1, 3])
def test_every_step_keeps_to_the_spaces_and_the_team(
    make: Callable[..., WarehouseEnv], control: str, n_cars: int
) -> None:
    env = make(control=control, n_cars=n_cars, max_cycles=100)
    team = env.possible_agents
    rng = np.random.default_rng(1)
    observations, infos = env.reset(seed=4)
    for n in range(1, 101):
        assert list(observations) == list(infos) == env.agents == team
        for agent, observation in observations.items():
            assert env.observation_space(agent).contains(observation)
        assert env.state_space.contains(env.state())
        observations, rewards, terminations, truncations, infos = env.step(sampled(env, rng))
        assert set(terminations.values()) == {False}
        assert set(truncations.values()) == {n == 100}
        for agent in team:
            assert set(infos[agent]) == set(TERMS)
            assert math.isfinite(rewards[agent])
            assert rewards[agent] == pytest.approx(sum(infos[agent].values()))
    assert env.agents == []
    with pytest.raises(EpisodeError, match="reset"):
        env.step({})


def test_observations_are_the_caller_s_own(make: Callable[..., WarehouseEnv]) -> None:
    env = make()
    observations, _ = env.reset(seed=0)
    before = env.state()
    for observation in observations.values():
        observation[:] = 7.0
    assert np.array_equal(env.state(), before)


def test_same_seed_same_episodes(make: Callable[..., WarehouseEnv]) -> None:
    one, two = make(), make(seed=9)
    first = episode(one, 3)
    np.testing.assert_equal(episode(two, 3), first)
    # The series goes on alike, and begins anew with its seed.
    second = episode(one, None)
    np.testing.assert_equal(episode(two, None), second)
    np.testing.assert_equal(episode(one, 3), first)
    assert not np.array_equal(first[-1][-1], second[-1][-1])  # type: ignore[index]


def test_same_seed_same_episode_with_planned_arms(make: Callable[..., WarehouseEnv]) -> None:
    one = episode(make(control="cars"), 3, 100)
    np.testing.assert_equal(episode(make(control="cars"), 3, 100), one)


SHOW_HASH = """
import hashlib, numpy as np
from fleet.envs import warehouse_v0
env = warehouse_v0.parallel_env(n_cars=2)
env.reset(seed=5)
digest = hashlib.sha256()
for n in range(100):
    env.step({agent: np.full(env.action_space(agent).shape, np.sin(0.1 * n)) for agent in env.agents})
    digest.update(env.state().tobytes())
print(digest.hexdigest())
"""


def test_same_seed_same_episode_in_another_process(repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there = subprocess.run(
        [sys.executable, "-c", SHOW_HASH], cwd=repository, capture_output=True, text=True, check=True
    )
    exec(SHOW_HASH, {})
    assert capsys.readouterr().out == there.stdout != ""


def test_copies_are_made_by_the_arguments(make: Callable[..., WarehouseEnv]) -> None:
    env = make(n_cars=2, tasks=3, max_cycles=20, weights=RewardWeights(contact=-7.0))
    played = episode(env, 6)
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert twin.agents == []
        np.testing.assert_equal(episode(twin, 6), played)
        twin.close()


def test_importing_the_package_loads_no_simulation(repository: Path) -> None:
    code = (
        "import sys, fleet.envs; print(any(name in sys.modules for name in ('numba', 'pybullet', 'fleet.simulation')))"
    )
    found = subprocess.run([sys.executable, "-c", code], cwd=repository, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"n_cars": 4}, "1 to 3 on site cell"),
        ({"n_cars": 0}, "1 to 3"),
        ({"fidelity": "grid"}, "kinematic, physics"),
        ({"control": "car"}, "all, cars, arms"),
        ({"control_hz": 0.0}, "> 0"),
        ({"max_cycles": 0}, ">= 1"),
        ({"seed": -1}, ">= 0"),
        ({"tasks": 0}, ">= 1"),
        ({"render_mode": "ansi"}, "rgb_array"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        WarehouseEnv(**arguments)  # type: ignore[arg-type]


def test_a_control_rate_that_is_no_divisor_is_refused(make: Callable[..., WarehouseEnv]) -> None:
    with pytest.raises(ConfigError, match="20 / 1, 2, 3"):
        make(control_hz=7.0).reset()


def test_illegal_actions_are_made_legal(make: Callable[..., WarehouseEnv]) -> None:
    ends = []
    for car, arm in ((np.array([5.0, 1e9]), None), (np.array([1.0, 1.0]), np.full(8, np.nan)), ([1, 1], np.zeros(8))):
        env = make()
        env.reset(seed=2)
        for _ in range(20):
            env.step({"car_0": car, "arm_0": arm, "nobody_7": np.zeros(1)})
        ends.append(env.state())
    np.testing.assert_equal(ends[1:], ends[:1] * 2)


# --- Agents at work


def drive(observation: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Pursue the observed way-points, near the goal a point beyond it, and slow down towards the path's end."""
    ahead_m, points = observation[15] * NEAR_M, observation[16:24].reshape(4, 2) * NEAR_M
    goal = observation[6:8] * math.hypot(12.0, 8.0)
    x, y = goal + 0.4 * observation[8:10] if np.hypot(*goal) < 0.4 else points[0]
    steering = math.atan(0.325 * 2.0 * y / max(x * x + y * y, 0.04))
    way_m = ahead_m if ahead_m > 0.3 else points[-1, 0]
    is_served = observation[11] or observation[13]
    speed = 0.0 if is_served or abs(way_m) < 0.01 else np.clip(1.5 * way_m, -0.3, 0.9)
    return np.array([np.clip(steering / 0.8, -1, 1), speed / 2.0], dtype=np.float32)


class PlannedArms:
    """Arm agents that play the plans of the classical fleet."""

    def __init__(self, env: WarehouseEnv) -> None:
        simulation = env.simulation
        assert simulation is not None
        names = tuple(station.name for station in simulation.stations)
        planner = make_arm_planner(
            arm_cells(simulation.site, simulation.scene), names, simulation.scene.arm, simulation.config
        )
        scene = simulation.scene
        self._simulation = simulation
        self._desk = ArmDesk(planner, ArmConfig(latency_s=0.0), scene.car, scene.arm_start, simulation.tick_s)
        self._ticks_n = round(0.1 / simulation.tick_s)
        self._tick = 0
        self._asked: dict[int, object] = {}

    def actions(self) -> Actions:
        """Return what takes the arms to where their plans will be a step later."""
        simulation, desk = self._simulation, self._desk
        before, held = desk.q.copy(), simulation.world.held()
        for arm in range(simulation.world.n_arms):
            transfer = simulation.desk.transfer(arm)
            if transfer is not None and transfer is not self._asked.get(arm) and desk.is_idle(arm):
                self._asked[arm] = transfer
                desk.submit(transfer, self._tick)
        for _ in range(self._ticks_n):
            desk.tick(self._tick, held)
            self._tick += 1
        speeds = (desk.q - before) / 0.1 / simulation.scene.arm.max_velocity_radps
        grip = np.where(desk.grip, 1.0, -1.0)
        return {f"arm_{arm}": np.append(speeds[arm], grip[arm]) for arm in range(len(grip))}


def delivered(env: WarehouseEnv, n_steps: int, *, cars: bool, arms: bool, seed: int = 0) -> dict[str, float]:
    """Let capable agents work until the episode ends; returns the sums of each car's or arm's terms."""
    observations, _ = env.reset(seed=seed)
    planned = PlannedArms(env) if arms else None
    sums = dict.fromkeys(TERMS, 0.0)
    for _ in range(n_steps):
        actions = planned.actions() if planned is not None else {}
        if cars:
            actions |= {agent: drive(observations[agent]) for agent in env.agents if agent.startswith("car")}
        observations, _, terminations, truncations, infos = env.step(actions)
        for term, value in infos[env.possible_agents[0]].items():
            sums[term] += value
        if not env.agents:
            assert set(terminations.values()) == {True}
            assert set(truncations.values()) == {False}
            break
    assert env.simulation is not None
    tasks = env.simulation.board.tasks
    assert {task.state for task in tasks} <= {TaskState.DELIVERED, TaskState.COLLECTED}, [task.reason for task in tasks]
    assert env.simulation.dispatcher.stock.misplaced() == []
    return sums


@pytest.mark.parametrize("control", ["all", "cars", "arms"])
def test_agents_that_know_their_work_finish_the_tasks(make: Callable[..., WarehouseEnv], control: str) -> None:
    env = make(control=control, max_cycles=2000)
    sums = delivered(env, 2000, cars=control != "arms", arms=control != "cars")
    assert sums["loaded"] == RewardWeights().loaded
    assert sums["delivered"] == RewardWeights().delivered
    assert sums["progress"] > 0.0
    if control != "arms":
        assert sums["progress"] > 5.0


def test_a_car_beside_its_path_is_neither_released_nor_recovered(make: Callable[..., WarehouseEnv]) -> None:
    env = make(control="cars", max_cycles=2000)
    observations, _ = env.reset(seed=0)
    simulation = env.simulation
    assert simulation is not None
    grid, dependencies, phase = (
        simulation.site.grid,
        simulation.executor.dependencies,
        simulation.dispatcher.roster.phase,
    )
    for _ in range(15):
        observations, *_ = env.step({"car_0": drive(observations["car_0"])})
    visited, held = set(), []
    for n in range(60):
        # A wide circle across the lanes.
        observations, *_ = env.step({"car_0": np.array([0.35, 0.5])})
        if n == 10:
            held = dependencies.held_cells(0)
        elif n > 10:
            visited.add(int(grid.index(*grid.cell_at(*simulation.world.car_poses()[0, :2]))))
            assert dependencies.held_cells(0) == held
            assert simulation.driver.off_lane() == []
            assert phase[0] is CarPhase.TO_PICK
    assert len(visited - set(held)) > 5
    for _ in range(100):
        observations, *_ = env.step({"car_0": drive(observations["car_0"])})
    assert phase[0] in (CarPhase.LOADING, CarPhase.TO_DROP), "it found back to its path"


@pytest.mark.bullet
def test_physics(make: Callable[..., WarehouseEnv]) -> None:
    env = make(fidelity="physics", max_cycles=15)
    said = episode(env, 1)
    assert len(said) == 16
    np.testing.assert_equal(episode(env, 1), said)
