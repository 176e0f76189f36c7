"""Speed: steps of `warehouse_v1` per second of CPU time, beside the bare engine; one process, random actions."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.training.bare import PHYSICS_HZ, BareLoop
from fleet.config import RunConfig
from fleet.envs import warehouse_v1
from fleet.envs.warehouse.env import WarehouseEnv
from fleet.run.setup import RunSetup
from fleet.world.scene import Scene

CONTROL_HZ = 30.0
N_RAYS = 36
N_ACTIONS = 64
"""Sets of actions drawn in advance, used in turn."""


@dataclass(frozen=True, kw_only=True)
class Team:
    """Robots of one row."""

    site: str
    n_cars: int
    n_arms: int
    target: str = ""
    bare_target: str = ""

    @property
    def n_agents(self) -> int:
        """Agents of the team."""
        return self.n_cars + self.n_arms

    def __str__(self) -> str:
        return f"{self.n_agents} agents ({self.n_cars} cars, {self.n_arms} arms, {self.site})"


PHYSICS = (
    Team(site="cell", n_cars=2, n_arms=1, target=">= 500", bare_target=">= 80"),
    Team(site="small", n_cars=8, n_arms=4, target=">= 130"),
    Team(site="small", n_cars=16, n_arms=4, target=">= 75"),
)
KINEMATIC = (
    Team(site="small", n_cars=12, n_arms=4, target=">= 10000"),
    Team(site="medium", n_cars=28, n_arms=4, target=">= 10000"),
    Team(site="medium", n_cars=40, n_arms=12, target=">= 10000"),
)


def measure_speed(trial: Trial) -> Iterator[Row]:
    """Environment steps and resets."""
    n_rounds, seconds = (8, 0.25) if trial.quick else (24, 0.5)
    for team in PHYSICS:
        env = _env(team, "physics")
        bare = BareLoop(_scene(team), team.n_cars, N_RAYS, _n_steps(), like_fleet=True)
        loose = BareLoop(_scene(team), team.n_cars, N_RAYS, _n_steps())
        # In turns, so that all meet the same load; the fastest round is the least disturbed one.
        players = [_player(env), _bare_player(bare, team), _bare_player(loose, team)]
        rates = np.array([[_rate(player, seconds) for player in players] for _ in range(n_rounds)])
        ours, theirs, looses = rates.max(axis=0).tolist()
        share, loose_share = (100.0 * float(np.median(rates[:, 0] / rates[:, k])) for k in (1, 2))
        yield Row(name=f"physics, {team}", value=ours, unit="steps/s", kind=Kind.RATE, target=team.target)
        yield Row(name=f"bare PyBullet, {team.n_cars} cars, {team.site}", value=theirs, unit="steps/s", kind=Kind.RATE)
        yield Row(name="  share of the bare loop", value=share, unit="%", target=team.bare_target)
        yield Row(name="  bare PyBullet, smoother floor", value=looses, unit="steps/s", kind=Kind.RATE)
        yield Row(name="  share of that loop", value=loose_share, unit="%")
        bare.close()
        loose.close()
        yield from _resets(trial, env, f"physics, {team}", n_rounds)
        env.close()
    for team in KINEMATIC:
        env = _env(team, "kinematic")
        played = _player(env)
        rate = max(_rate(played, seconds) for _ in range(n_rounds))
        yield Row(
            name=f"kinematic, {team}",
            value=rate * team.n_agents,
            unit="agent steps/s",
            kind=Kind.RATE,
            target=team.target,
        )
        yield from _resets(trial, env, f"kinematic, {team}", n_rounds)
        env.close()
    trial.notes.append(
        f"{CONTROL_HZ:.0f} Hz control, {PHYSICS_HZ:.0f} Hz physics, {N_RAYS} rays per car, per second of CPU time of "
        "one process, the fastest of several rounds; shares are medians. The bare loop has the same scene, robots, "
        "parcels, floor, motors, solver, rays and kind of actions; the engine casts all of its rays (decision 34), and "
        "it has no contacts to judge, no orders, traffic and rewards. The second one has the floor that the engine "
        "makes by itself, on which cars slide and the engine has less to do (decision 33)."
    )


def _n_steps() -> int:
    return round(PHYSICS_HZ / CONTROL_HZ)


def _scene(team: Team) -> Scene:
    return RunSetup.of(RunConfig(site=team.site, robots=team.n_cars)).scene


def _env(team: Team, fidelity: str) -> WarehouseEnv:
    return warehouse_v1.parallel_env(
        site=team.site,
        n_cars=team.n_cars,
        n_arms=team.n_arms,
        fidelity=fidelity,
        lidar=True,
        control_hz=CONTROL_HZ,
        physics_hz=PHYSICS_HZ,
        max_cycles=300,
    )


def _player(env: WarehouseEnv) -> Callable[[], None]:
    """One step of random actions, resets included."""
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    spaces = env.action_spaces.items()
    actions = [
        {agent: rng.uniform(-1.0, 1.0, space.shape).astype(np.float32) for agent, space in spaces}
        for _ in range(N_ACTIONS)
    ]
    turn = 0

    def step() -> None:
        nonlocal turn
        if not env.agents:
            env.reset()
        env.step(actions[turn % N_ACTIONS])
        turn += 1

    for _ in range(50):
        step()
    return step


def _bare_player(bare: BareLoop, team: Team) -> Callable[[], None]:
    """One step of the same kind of actions."""
    rng = np.random.default_rng(0)
    scene = _scene(team)
    car, n_arms = scene.car, len(scene.arm_base)
    limits = (car.max_steering_rad, car.max_speed_mps / car.wheel_radius_m)
    cars = rng.uniform(-1.0, 1.0, (N_ACTIONS, team.n_cars, 2)) * limits
    arms = rng.uniform(-1.0, 1.0, (N_ACTIONS, n_arms, 7)) * scene.arms.max_velocity_radps[0]
    arms[:, team.n_arms :] = 0.0
    turn = 0

    def step() -> None:
        nonlocal turn
        if turn % 300 == 0:
            bare.reset()
        bare.step(cars[turn % N_ACTIONS], arms[turn % N_ACTIONS])
        turn += 1

    for _ in range(50):
        step()
    return step


def _rate(step: Callable[[], None], seconds: float) -> float:
    """Steps per second of CPU time."""
    began, n_steps = time.process_time(), 0
    while (spent := time.process_time() - began) < seconds:
        for _ in range(5):
            step()
        n_steps += 5
    return n_steps / spent


def _resets(trial: Trial, env: WarehouseEnv, name: str, n_rounds: int) -> Iterator[Row]:
    """Resets in mid-episode; the first step after it is the same every time."""
    took: list[float] = []
    stands = np.zeros(2, dtype=np.float32)
    first = None
    env.reset(seed=1)  # the episode before may have come to its end
    for _ in range(4 * n_rounds):
        for _ in range(20):
            env.step({agent: env.action_space(agent).sample() for agent in env.agents})
        began = time.process_time()
        env.reset(seed=1)
        took.append(time.process_time() - began)
        env.step({agent: stands for agent in env.agents if agent.startswith("car")})
        first = env.state() if first is None else first
        trial.check(np.array_equal(first, env.state()), f"{name}: an episode begins differently after a reset")
    yield Row(name="  reset", value=1e3 * min(took), unit="ms", kind=Kind.TIME, target="<= 2")
