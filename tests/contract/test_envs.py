"""What every PettingZoo environment owes the libraries that train on it, and what the warehouse owes its agents."""

from __future__ import annotations

import copy
import math
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from fleet.config import ArmConfig
from fleet.envs import warehouse_v1
from fleet.envs.core.base import ActionError, EnvState, EpisodeError, StateError
from fleet.envs.warehouse.env import WarehouseEnv
from fleet.envs.warehouse.rewards import TERMS, RewardWeights
from fleet.envs.warehouse.rows import N_CAR_NUMBERS, NEAR_M
from fleet.errors import ConfigError
from fleet.missions.phases import CarPhase
from fleet.sensors.lidar import Lidar, LidarRing
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_manager import ArmManager
from fleet.stations.arms.arm_planner import make_arm_planner
from fleet.tasks.board import TaskState

Actions = dict[str, npt.NDArray[np.float32]]

FIDELITIES = [pytest.param("kinematic"), pytest.param("physics", marks=pytest.mark.bullet)]
TEAM = ["car_0", "car_1", "arm_0", "arm_1"]


@pytest.fixture
def make() -> Iterator[Callable[..., WarehouseEnv]]:
    """Return a maker of warehouses that are closed after the test."""
    made = []

    def one(**arguments: object) -> WarehouseEnv:
        made.append(warehouse_v1.parallel_env(**({"site": "cell", "fidelity": "kinematic", "lidar": True} | arguments)))
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
    said: list[object] = [env.reset(seed=seed)]
    said += played(env, 0, n_steps)
    return said


def played(env: WarehouseEnv, seed: int, n_steps: int | None = None) -> list[object]:
    """Play on, and return all that the environment said."""
    rng = np.random.default_rng(seed)
    said: list[object] = []
    while env.agents and n_steps != len(said):
        said.append((*env.step(sampled(env, rng)), env.state()))
    return said


# --- Spaces, seeds, copies


@pytest.mark.parametrize("fidelity", FIDELITIES)
@pytest.mark.parametrize(
    ("team", "arguments"),
    [
        (TEAM, {}),
        (["car_0", "car_1", "car_2"], {"n_cars": 3, "n_arms": 0, "lidar": False}),
        (["arm_0"], {"n_cars": 0, "n_arms": 1, "classical_cars": 1, "arm_action": "tip"}),
    ],
)
def test_every_step_keeps_to_the_spaces_and_the_team(
    make: Callable[..., WarehouseEnv], team: list[str], arguments: dict[str, object], fidelity: str
) -> None:
    env = make(fidelity=fidelity, max_cycles=60, **arguments)
    assert env.possible_agents == team
    rng = np.random.default_rng(1)
    observations, infos = env.reset(seed=4)
    for n in range(1, 61):
        assert list(observations) == list(infos) == env.agents == team
        for agent, observation in observations.items():
            assert env.observation_space(agent).contains(observation)
        assert env.state_space.contains(env.state())
        observations, rewards, terminations, truncations, infos = env.step(sampled(env, rng))
        assert set(terminations.values()) == {False}
        assert set(truncations.values()) == {n == 60}
        for agent in team:
            assert list(infos[agent]) == [*TERMS, "illegal"]
            assert infos[agent].pop("illegal") == 0.0
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


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_same_seed_same_episodes(make: Callable[..., WarehouseEnv], fidelity: str) -> None:
    one, two = make(fidelity=fidelity, control_hz=30.0), make(fidelity=fidelity, control_hz=30.0, seed=9)
    first = episode(one, 3, 600)
    assert len(first) == 601
    # The series goes on alike, and begins anew with its seed.
    second = episode(one, None, 100)
    np.testing.assert_equal(episode(two, 3, 600), first)
    np.testing.assert_equal(episode(two, None, 100), second)
    np.testing.assert_equal(episode(one, 3, 100), first[:101])
    assert not np.array_equal(first[-1][-1], second[-1][-1])  # type: ignore[index]


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_same_seed_same_episode_with_planned_arms(make: Callable[..., WarehouseEnv], fidelity: str) -> None:
    one, two = make(n_arms=0, fidelity=fidelity), make(n_arms=0, fidelity=fidelity)
    said = worked(one, 250)
    np.testing.assert_equal(worked(one, 250), said)
    np.testing.assert_equal(worked(two, 250), said)
    assert one.simulation.board.count(TaskState.CARRIED) > 0


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_later_episodes_begin_with_what_the_lidar_meets_there(make: Callable[..., WarehouseEnv], fidelity: str) -> None:
    lidar = Lidar(noise_m=0.0)
    env = make(fidelity=fidelity, lidar=lidar)
    episode(env, 1, 40)
    observations, _ = env.reset(seed=2)
    world, car = env.simulation.world, env.simulation.scene.car
    ring = LidarRing(lidar, car.front_m, car.rear_m, car.half_width_m)
    met = ring.distances(world.rays(*ring.rays(world.car_poses())), np.random.default_rng(0))
    for agent, distances in zip(("car_0", "car_1"), met, strict=True):
        assert np.array_equal(observations[agent][N_CAR_NUMBERS:], distances.astype(np.float32))


def test_every_look_of_the_lidar_has_noise_of_its_own(make: Callable[..., WarehouseEnv]) -> None:
    """Noise is drawn for many looks at once: the numbers are those of draws look by look, also after a return."""
    lidar = Lidar(noise_m=0.02)
    env = make(fidelity="kinematic", lidar=lidar, n_arms=0)
    env.reset(seed=2)
    simulation = env.simulation
    car = simulation.scene.car
    ring = LidarRing(lidar, car.front_m, car.rear_m, car.half_width_m)
    rng = np.random.default_rng(int(np.random.SeedSequence(env._seed).generate_state(2)[1]))
    ring.distances(np.ones(2 * lidar.n_rays), rng)  # the look of the reset
    state = None
    for n in range(40):
        observations = env.step({agent: np.array([0.3, 0.4]) for agent in env.agents})[0]
        world = env.simulation.world
        met = ring.distances(world.rays(*ring.rays(world.car_poses())), rng).astype(np.float32)
        assert np.array_equal([observations[f"car_{k}"][N_CAR_NUMBERS:] for k in range(2)], met), f"look {n}"
        if n == 20:
            state, kept = env.save_state(), rng.bit_generator.state
    env.load_state(state)
    rng.bit_generator.state = kept
    observations = env.step({agent: np.array([0.3, 0.4]) for agent in env.agents})[0]
    world = env.simulation.world
    met = ring.distances(world.rays(*ring.rays(world.car_poses())), rng).astype(np.float32)
    assert np.array_equal([observations[f"car_{k}"][N_CAR_NUMBERS:] for k in range(2)], met)


SHOW_HASH = """
import hashlib, sys, numpy as np
from fleet.envs import warehouse_v1
env = warehouse_v1.parallel_env(site="cell", fidelity=sys.argv[1], lidar=True, control_hz=30, max_cycles=300)
digest = hashlib.sha256()
for n in range(600):
    if not env.agents:
        observations, _ = env.reset(seed=5) if n == 0 else env.reset()
    else:
        observations, rewards, *_ = env.step(
            {agent: np.full(env.action_space(agent).shape, np.sin(0.1 * n)) for agent in env.agents}
        )
        digest.update(np.array(list(rewards.values())).tobytes())
    for observation in observations.values():
        digest.update(observation.tobytes())
print(digest.hexdigest())
"""


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_same_seed_same_episodes_in_another_process(repository: Path, fidelity: str) -> None:
    command = [sys.executable, "-c", SHOW_HASH, fidelity]
    said = [
        subprocess.run(command, cwd=repository, capture_output=True, text=True, check=True).stdout for _ in range(2)
    ]
    assert said[0] == said[1] != ""


def test_copies_are_made_by_the_arguments(make: Callable[..., WarehouseEnv]) -> None:
    env = make(n_cars=2, tasks=3, max_cycles=20, weights=RewardWeights(contact=-7.0), lidar=Lidar(n_rays=72))
    said = episode(env, 6)
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert twin.agents == []
        np.testing.assert_equal(episode(twin, 6), said)
        twin.close()


def test_importing_the_package_loads_no_simulation(repository: Path) -> None:
    code = (
        "import sys, fleet.envs; print(any(name in sys.modules for name in ('numba', 'pybullet', 'fleet.simulation')))"
    )
    found = subprocess.run([sys.executable, "-c", code], cwd=repository, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "False"


# --- Saved states


@pytest.mark.parametrize("fidelity", FIDELITIES)
@pytest.mark.parametrize("n_arms", [2, 0])
def test_a_state_comes_back_exactly(
    make: Callable[..., WarehouseEnv], tmp_path: Path, fidelity: str, n_arms: int
) -> None:
    env = make(fidelity=fidelity, n_arms=n_arms, max_cycles=120)
    env.reset(seed=11)
    played(env, 1, 40)
    state = env.save_state()
    assert (state.quick is not None) == (fidelity == "kinematic")
    expected = [played(env, 2), episode(env, None, 30)]  # to the end, and the next episode
    for _ in range(2):
        np.testing.assert_equal(env.load_state(state)["car_0"][:N_CAR_NUMBERS], expected_row(env))
        np.testing.assert_equal([played(env, 2), episode(env, None, 30)], expected)
    state.write(tmp_path / "state")
    other = make(fidelity=fidelity, n_arms=n_arms, max_cycles=120)
    other.load_state(EnvState.read(tmp_path / "state"))
    np.testing.assert_equal([played(other, 2), episode(other, None, 30)], expected)


def hits(
    env: WarehouseEnv, seed: int, n_steps: int, saved: dict[int, EnvState] | None = None
) -> tuple[list[bytes], list[Actions]]:
    """Play with actions that are held for a while, so that robots hit things; return all states and the actions."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    states: list[bytes] = [env.simulation.world.state_bytes()]
    actions: list[Actions] = []
    for step in range(n_steps):
        if saved is not None and step in (37, 117):
            saved[step] = env.save_state()
        actions.append(sampled(env, rng) if step % 8 == 0 else actions[-1])
        env.step(actions[-1])
        states.append(env.simulation.world.state_bytes())
    return states, actions


@pytest.mark.parametrize("seed", [8, 6])
def test_later_episodes_and_saved_moments_are_exact_whatever_touched(
    make: Callable[..., WarehouseEnv], seed: int
) -> None:
    """What the engine remembered of touches in earlier episodes, or after a moment was saved, decided last bits."""
    fresh, env = (make(site="small", fidelity="physics", n_cars=4) for _ in range(2))
    first, actions = hits(fresh, seed, 140)
    assert sum(fresh.simulation.world.contacts().__dict__.values()) > 0
    hits(env, seed + 10, 30)
    saved: dict[int, EnvState] = {}
    assert hits(env, seed, 140, saved)[0] == first, "a later episode, in which moments are saved"
    for step, state in saved.items():
        env.load_state(state)
        assert env.simulation.world.state_bytes() == first[step]
        for k in range(step, min(step + 15, 140)):
            env.step(actions[k])
            assert env.simulation.world.state_bytes() == first[k + 1], f"saved at {step}, differs at {k}"


def expected_row(env: WarehouseEnv) -> npt.NDArray[np.float32]:
    """Return the first agent's row as `state()` has it."""
    row: npt.NDArray[np.float32] = env.state()[:N_CAR_NUMBERS]
    return row


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_a_state_with_something_in_the_grip_comes_back_exactly(
    make: Callable[..., WarehouseEnv], tmp_path: Path, fidelity: str
) -> None:
    env = make(fidelity=fidelity, n_cars=1, n_arms=0, tasks=1)
    observations, _ = env.reset(seed=0)
    while not (env.simulation.world.held() >= 0).any():
        observations, *_ = env.step({"car_0": drive(observations["car_0"])})
    held = env.save_state()
    expected = played(env, 2, 60)
    env.load_state(held)
    np.testing.assert_equal(played(env, 2, 60), expected)
    held.write(tmp_path / "state")
    command = [sys.executable, "-c", LOAD_AND_HASH, str(tmp_path / "state"), fidelity]
    here = env.load_state(held)["car_0"].tobytes().hex()
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() == here


LOAD_AND_HASH = """
import sys
from pathlib import Path
from fleet.envs import warehouse_v1
from fleet.envs.core.base import EnvState
state = EnvState.read(Path(sys.argv[1]))
env = warehouse_v1.parallel_env(**state.arguments)
print(env.load_state(state)["car_0"].tobytes().hex())
"""


def test_states_of_other_environments_are_refused(make: Callable[..., WarehouseEnv], tmp_path: Path) -> None:
    env = make()
    with pytest.raises(EpisodeError, match="save_state"):
        env.save_state()
    env.reset(seed=0)
    state = env.save_state()
    with pytest.raises(StateError, match="n_cars = 2; valid: 1"):
        make(n_cars=1).load_state(state)
    (tmp_path / "state").write_bytes(b"something else")
    with pytest.raises(StateError, match="EnvState"):
        EnvState.read(tmp_path / "state")


# --- Bad input


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"n_cars": 4}, "0 to 3 on site cell"),
        ({"n_cars": -1}, "0 to 3"),
        ({"n_cars": 1.5}, "an integer"),
        ({"n_cars": True}, "an integer"),
        ({"max_cycles": True}, ">= 1"),
        ({"seed": True}, ">= 0"),
        ({"n_arms": 3}, "0 to 2"),
        ({"n_cars": 0, "n_arms": 0}, "at least one agent"),
        ({"n_cars": 0}, "at least one car"),
        ({"classical_cars": 2}, "0 to 1"),
        ({"fidelity": "grid"}, "kinematic, mixed, physics"),
        ({"arm_action": "torque"}, "joint, tip"),
        ({"control_hz": 0.0}, "0.1 to 1000"),
        ({"control_hz": math.nan}, "0.1 to 1000"),
        ({"control_hz": True}, "control_hz is True; valid: a number from 0.1 to 1000"),
        ({"physics_hz": True}, "physics_hz is True; valid: a number from 60"),
        ({"max_cycles": 0}, ">= 1"),
        ({"seed": -1}, ">= 0"),
        ({"tasks": 0}, "1 to 10000"),
        ({"lidar": 36}, "Lidar"),
        ({"camera": (64, 64)}, "kinematic"),
        ({"camera": 64}, "height and width"),
        ({"site": None}, "a name or a path"),
        ({"arm_action": ["joint"]}, "joint, tip"),
        ({"level": "l1"}, "dock, transfer, pair, all"),
        ({"n_cars": (3, 2)}, "or two, ascending"),
        ({"n_cars": (0, 2), "n_arms": 0}, "at least one agent"),
        ({"car_action": "tip"}, "drive, residual"),
        ({"dead_band": 1.0}, "0 to 0.9"),
        ({"ramp": 1}, "ramp is 1; valid: True, False"),
        ({"grants_hold": "yes"}, "grants_hold is 'yes'; valid: True, False"),
        ({"team_share": 1.5}, "team_share is 1.5; valid: a number from 0 to 1"),
        ({"stop_m": 0.0}, "0.005 to 0.5"),
        ({"start": {"cars": "home"}}, "parked, anywhere, near, docked"),
        ({"start": {"speed": 1.0}}, "start is 'speed'; valid: cars, near_m"),
        ({"start": "near"}, "Start, a table, or None"),
        ({"start": {"near_m": (2.0, 1.0)}}, "ascending"),
        ({"car_sensing": {"dropout": 1.0}}, "below 1"),
        ({"arm_sensing": {"delay_steps": -1}}, "0 to 100"),
        ({"breakdowns": {"losses_per_h": -1.0}}, "breakdowns.losses_per_h"),
        ({"battery": True}, "BatteryConfig"),
        ({"weights": {"progress": 1.0}}, "RewardWeights"),
        ({"render_mode": "ansi"}, "rgb_array"),
    ],
)
def test_bad_arguments_are_refused(make: Callable[..., WarehouseEnv], arguments: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        make(**arguments)


def test_weights_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(ConfigError, match="weight progress is nan; valid: a number"):
        RewardWeights(progress=math.nan)


def test_unknown_arguments_are_refused(make: Callable[..., WarehouseEnv]) -> None:
    with pytest.raises(TypeError, match="n_robots"):
        make(n_robots=3)


def test_illegal_actions_are_made_legal_and_told(make: Callable[..., WarehouseEnv]) -> None:
    env = make(n_cars=1)
    ends = []
    stands = np.array([0.0] * 7 + [-1.0])
    for car, arm in (
        (np.array([5.0, np.inf]), None),
        ([1.0, 0.0], np.append(np.full(7, np.nan), -2.0)),
        ([1, np.nan], stands),
    ):
        env.reset(seed=2)
        for _ in range(20):
            *_, infos = env.step({"car_0": car, "arm_0": arm, "arm_1": stands})
        assert infos["car_0"]["illegal"] == (not np.isfinite(car).all() or np.abs(car).max() > 1)
        assert infos["arm_0"]["illegal"] == (arm is not stands)
        assert infos["arm_1"]["illegal"] == 0.0
        ends.append(env.state())
    np.testing.assert_equal(ends[1:], ends[:1] * 2)


@pytest.mark.parametrize(
    ("actions", "words"),
    [
        ({"car_0": np.zeros(3)}, r"car_0 has shape \(3,\); valid: \(2,\)"),
        ({"car_0": 1.0}, r"shape \(\)"),
        ({"arm_1": "up"}, "arm_1"),
        ({"car_7": np.zeros(2)}, "car_7; valid: car_0, car_1, arm_0, arm_1"),
    ],
)
def test_actions_that_are_none_change_nothing(
    make: Callable[..., WarehouseEnv], actions: dict[str, object], words: str
) -> None:
    env = make()
    with pytest.raises(EpisodeError, match="reset"):
        env.step({})
    env.reset(seed=0)
    before = env.state()
    with pytest.raises(ActionError, match=words):
        env.step(actions)
    np.testing.assert_equal(env.state(), before)
    assert len(played(env, 0, 3)) == 3


# --- Agents at work


def drive(observation: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Pursue the route, near the goal a point beyond it, and slow down towards the end of what is granted."""
    ahead_m, points = observation[15] * NEAR_M, observation[19:27].reshape(4, 2) * NEAR_M
    goal = observation[6:8] * math.hypot(12.0, 8.0)
    x, y = goal + 0.4 * observation[8:10] if np.hypot(*goal) < 0.4 else points[0]
    steering = math.atan(0.325 * 2.0 * y / max(x * x + y * y, 0.04))
    is_served = observation[11] or observation[13]
    # Slower than a tenth of a metre per second is a brake.
    speed = 0.0 if is_served or abs(ahead_m) < 0.02 else np.clip(1.5 * ahead_m, -0.3, 0.9)
    speed = speed if abs(speed) > 0.105 or speed == 0.0 else math.copysign(0.105, ahead_m)
    return np.array([np.clip(steering / 0.8, -1, 1), speed], dtype=np.float32)


def worked(env: WarehouseEnv, n_steps: int) -> list[object]:
    """Let cars that know their work drive for a while, and return what they saw."""
    observations, _ = env.reset(seed=0)
    said = []
    for _ in range(n_steps):
        observations, *_ = env.step({agent: drive(observations[agent]) for agent in env.agents})
        said.append(list(observations.values()))
        if not env.agents:
            break
    return said


class PlannedArms:
    """Arm agents that play the plans of the classical fleet."""

    def __init__(self, env: WarehouseEnv) -> None:
        simulation = env.simulation
        names = tuple(station.name for station in simulation.stations)
        planner = make_arm_planner(
            arm_cells(simulation.site, simulation.scene), names, simulation.scene.arms, simulation.config
        )
        scene = simulation.scene
        self._simulation = simulation
        self._arm_manager = ArmManager(planner, ArmConfig(latency_s=0.0), scene, simulation.tick_s)
        self._n_ticks = round(0.1 / simulation.tick_s)
        self._tick = 0
        self._asked: dict[int, object] = {}

    def actions(self) -> Actions:
        """Return what takes the arms to where their plans will be a step later."""
        simulation, arm_manager = self._simulation, self._arm_manager
        before, held = arm_manager.q.copy(), simulation.world.held()
        for arm in range(simulation.world.n_arms):
            transfer = simulation.arm_manager.transfer(arm)
            if transfer is not None and transfer is not self._asked.get(arm) and arm_manager.is_idle(arm):
                self._asked[arm] = transfer
                arm_manager.submit(transfer, self._tick)
        for _ in range(self._n_ticks):
            arm_manager.tick(self._tick, held)
            self._tick += 1
        speeds = (arm_manager.q - before) / 0.1 / simulation.scene.arms.max_velocity_radps
        grip = np.where(arm_manager.grip, 1.0, -1.0)
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
        for term in TERMS:
            sums[term] += infos[env.possible_agents[0]][term]
        if not env.agents:
            assert set(terminations.values()) == {True}
            assert set(truncations.values()) == {False}
            break
    tasks = env.simulation.board.tasks
    assert {task.state for task in tasks} <= {TaskState.DELIVERED, TaskState.COLLECTED}, [task.reason for task in tasks]
    assert env.simulation.view.inventory.misplaced() == []
    return sums


@pytest.mark.parametrize(
    "fidelity", [pytest.param("kinematic"), pytest.param("physics", marks=[pytest.mark.bullet, pytest.mark.slow])]
)
@pytest.mark.parametrize("who", ["all", "cars", "arms"])
def test_agents_that_know_their_work_finish_the_tasks(
    make: Callable[..., WarehouseEnv], who: str, fidelity: str
) -> None:
    n_cars = 0 if who == "arms" else 1
    env = make(
        n_cars=n_cars,
        classical_cars=1 - n_cars,
        n_arms=0 if who == "cars" else None,
        fidelity=fidelity,
        max_cycles=2000,
        team_share=1.0,
    )
    sums = delivered(env, 2000, cars=who != "arms", arms=who != "cars")
    assert sums["loaded"] == RewardWeights().loaded
    assert sums["delivered"] == RewardWeights().delivered
    assert sums["progress"] > (0.0 if who == "arms" else 5.0)


def test_a_car_beside_its_path_is_neither_released_nor_recovered(make: Callable[..., WarehouseEnv]) -> None:
    env = make(n_cars=1, n_arms=0, max_cycles=2000)
    observations, _ = env.reset(seed=0)
    simulation = env.simulation
    grid, dependencies, phase = (
        simulation.site.grid,
        simulation.executor.dependencies,
        simulation.missions.phase,
    )
    for _ in range(15):
        observations, *_ = env.step({"car_0": drive(observations["car_0"])})
    visited, held = set(), []
    for n in range(60):
        # A wide circle across the lanes.
        observations, *_ = env.step({"car_0": np.array([0.35, 1.0])})
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


def test_tips_go_where_they_are_told(make: Callable[..., WarehouseEnv]) -> None:
    env = make(n_cars=1, arm_action="tip", control_hz=20.0)
    observations, _ = env.reset(seed=0)
    scale = np.array([1.5, 1.5, 1.5, 1, 1, 1])
    x, y, z, *_ = observations["arm_0"][14:20] * scale
    action = np.array([0.2, 0.3, -0.2, 0.0, -1.0])  # outwards, around the base, down
    for _ in range(20):
        observations, *_ = env.step({"arm_0": action})
    there_x, there_y, there_z, *points = observations["arm_0"][14:20] * scale
    assert math.hypot(there_x, there_y) - math.hypot(x, y) == pytest.approx(0.1, abs=0.01)
    assert math.remainder(math.atan2(there_y, there_x) - math.atan2(y, x), math.tau) == pytest.approx(0.3, abs=0.03)
    assert there_z - z == pytest.approx(-0.1, abs=0.01)
    np.testing.assert_allclose(points, [0.0, 0.0, -1.0], atol=0.03)


@pytest.mark.bullet
def test_lidar_sees_the_same_in_both_worlds(make: Callable[..., WarehouseEnv]) -> None:
    lidar = Lidar(n_rays=180, range_m=6.0, noise_m=0.0)
    envs = [make(fidelity=name, n_cars=3, n_arms=0, lidar=lidar, control_hz=20.0) for name in ("kinematic", "physics")]
    for env in envs:
        env.reset(seed=0)
    gaps = []
    for _ in range(40):
        seen = [env.step({f"car_{k}": np.array([0.2 * k, 0.3]) for k in range(3)})[0] for env in envs]
        poses = [env.simulation.world.car_poses() for env in envs]
        ((_, ring),) = envs[1]._now().observer._rings
        world = envs[0].simulation.world
        # The same poses in both: those of the physical cars.
        world._cars.poses[:] = poses[1]
        origins, ends = ring.rays(poses[1])
        flat = ring.distances(world.rays(origins, ends), np.random.default_rng(0))
        gaps.append(np.abs(flat - np.array([seen[1][f"car_{k}"][N_CAR_NUMBERS:] for k in range(3)])))
    # A ray past a corner may meet it in one world only; a parked car's body dips by a millimetre.
    assert np.mean(np.array(gaps) * 6.0 > 0.02) < 0.01
    assert np.min(flat) < 0.2


@pytest.mark.bullet
def test_cameras_see(make: Callable[..., WarehouseEnv]) -> None:
    env = make(fidelity="physics", n_cars=1, n_arms=0, camera=(32, 48))
    observations, _ = env.reset(seed=0)
    assert env.observation_space("car_0").contains(observations["car_0"])
    assert np.ptp(observations["car_0"]["image"]) > 50
