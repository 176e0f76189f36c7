"""Cars that break down: on the grid, and in what agents and rollouts are told."""

from __future__ import annotations

from typing import Any

import numpy as np

from fleet.abstract.fleet import FleetSite, GridFleet
from fleet.abstract.kernel import NONE, Faults, Phase, Stage
from fleet.envs import dispatch_v1
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.dispatch.view import N_OWN
from fleet.envs.layers.order_streams import episode_orders
from fleet.envs.policies import make_policy
from maps.site import load_site

SMALL = FleetSite.of(load_site("small"))
OFTEN = {"site": "small", "n_cars": 6, "breakdowns_per_h": 40.0, "repair_s": 20.0, "lost_share": 0.2}


def fleet_of(n_cars: int, faults: Faults, seed: int = 0) -> GridFleet:
    """Return a fleet with ten minutes of orders."""
    return GridFleet(SMALL, n_cars, episode_orders(SMALL, n_cars, 1.5, 600.0, np.random.default_rng(1)), seed, faults)


def played(env: DispatchEnv, seed: int, n_steps: int = 80) -> list[Any]:
    """Return what is said in an episode of the nearest tasks."""
    policy, (observations, _) = make_policy("dispatch", "nearest"), env.reset(seed=seed)
    said: list[Any] = []
    for _ in range(n_steps):
        observations, *rest = env.step(policy.act(env, observations))
        said.append((observations, rest, env.view.phase.tolist()))
    return said


def test_cars_break_down_as_often_and_stand_as_long_as_asked() -> None:
    faults = Faults(rate=0.01, mean_steps=30.0, lost_share=0.0)
    n_broken, n_chances, stands = 0, 0, []
    for seed in range(40):
        grid = GridFleet(SMALL, 6, (), seed, faults)
        for _ in range(300):
            able = grid.cars.phase != Phase.OUT
            grid.move(grid.planned())
            broken = able & (grid.cars.phase == Phase.OUT)
            n_broken, n_chances = n_broken + int(broken.sum()), n_chances + int(able.sum())
            stands += grid.cars.left[broken].tolist()
    assert abs(n_broken - 0.01 * n_chances) < 4.0 * np.sqrt(0.01 * n_chances)
    assert min(stands) == 1
    assert abs(np.mean(stands) - 30.0) < 4.0 * 30.0 / np.sqrt(len(stands))


def test_the_books_are_right_and_who_stands_does_not_move() -> None:
    grid = fleet_of(12, Faults(rate=0.02, mean_steps=10.0, lost_share=0.02))
    cars, tasks, stations = grid.cars, grid.tasks, grid.stations
    n = len(stations.booked)
    n_stood = 0
    for _ in range(600):
        grid.assign_nearest()
        before, stood = cars.state.copy(), (cars.phase == Phase.OUT) & (cars.left > 0)
        grid.move(grid.planned())
        assert (cars.state == before)[stood].all()
        n_stood += int(stood.sum())
        assert np.array_equal(np.bincount(cars.station[cars.booked], minlength=n), stations.booked)
        to_pick = tasks.pick[tasks.stage == Stage.ASSIGNED]
        to_drop = tasks.drop[np.isin(tasks.stage, (Stage.ASSIGNED, Stage.CARRIED))]
        assert np.array_equal(np.bincount(np.append(to_pick, to_drop), minlength=n), stations.under_way)
        busy = np.flatnonzero(cars.task != NONE)
        assert np.array_equal(tasks.car[cars.task[busy]], busy)
        assert (tasks.car[tasks.stage == Stage.READY] == NONE).all()
        parked = (cars.station == NONE) | cars.held
        assert ((cars.spot != NONE) == parked).all()
    assert n_stood > 500
    lost = (cars.phase == Phase.OUT) & (cars.left == 0)
    assert lost.any()
    assert (cars.task[lost] == NONE).all()
    assert grid.counts.delivered.sum() > 10


def test_breakdowns_are_the_seed_s_and_come_back_with_a_saved_state() -> None:
    env, twin = dispatch_v1.parallel_env(**OFTEN), dispatch_v1.parallel_env(**OFTEN)
    said = played(env, 3)
    np.testing.assert_equal(played(twin, 3), said)
    assert any(Phase.OUT in phases for *_, phases in said)
    assert played(twin, 4)[0][2] != said[0][2] or played(twin, 4)[9][2] != said[9][2]
    played(env, 3, 30)
    state = env.save_state()
    for other in (env, twin):
        observations = other.load_state(state)
        policy = make_policy("dispatch", "nearest")
        for k in range(30, 80):
            observations, *rest = other.step(policy.act(other, observations))
            np.testing.assert_equal((observations, rest), said[k][:2])


def test_who_is_out_of_service_sees_no_phase_and_can_choose_nothing() -> None:
    env = dispatch_v1.parallel_env(**OFTEN)
    n_out = 0
    for observations, _, phases in played(env, 3):
        for seen, phase in zip(observations.values(), phases, strict=True):
            assert seen["observation"][4:9].sum() == (phase != Phase.OUT)
            if phase == Phase.OUT:
                n_out += 1
                assert seen["action_mask"].tolist() == [1] + [0] * env.config.candidates_n
                assert seen["observation"][N_OWN - 1] == 0.0
    assert n_out > 20


def test_an_outlook_expects_cars_back_after_the_mean_time_and_lost_ones_never() -> None:
    env = dispatch_v1.parallel_env(**OFTEN)
    n_back = n_lost = 0
    policy, (observations, _) = make_policy("dispatch", "nearest"), env.reset(seed=3)
    for _ in range(80):
        observations, *_ = env.step(policy.act(env, observations))
        cars = env.fleet.grid.cars  # type: ignore[union-attr, attr-defined]
        outlook = env.fleet.outlook()  # type: ignore[union-attr]
        out = cars.phase == Phase.OUT
        back, lost = out & (cars.left > 0), out & (cars.left == 0)
        assert (outlook.left[back] == 20).all(), "how long it will take nobody knows"
        assert (outlook.phase[back] == np.where(outlook.job[back] == NONE, Phase.FREE, Phase.TO_DROP)).all()
        assert (outlook.phase[lost] == Phase.OUT).all()
        n_back, n_lost = n_back + int(back.sum()), n_lost + int(lost.sum())
    assert min(n_back, n_lost) > 0


def test_a_task_that_was_given_back_can_be_chosen_again() -> None:
    env = dispatch_v1.parallel_env(**OFTEN)
    policy, (observations, _) = make_policy("dispatch", "nearest"), env.reset(seed=3)
    had: dict[int, int] = {}
    n_again = 0
    for _ in range(80):
        observations, *_ = env.step(policy.act(env, observations))
        cars = env.fleet.grid.cars  # type: ignore[union-attr, attr-defined]
        for task in env.view.task.tolist():
            n_again += task in had
            had.pop(task, None)
        had |= {int(task): car for car, task in enumerate(cars.task) if cars.phase[car] == Phase.TO_PICK}
    assert n_again > 0
