"""Cars with batteries: on the grid, in what agents are told, and in a policy that rests in time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fleet.abstract.fleet import FleetSite, GridFleet
from fleet.abstract.kernel import ENOUGH, LOW, NONE, Battery, Phase
from fleet.envs import dispatch_v1
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.dispatch.scenarios import SCENARIOS
from fleet.envs.layers.order_streams import episode_orders
from fleet.envs.policies import make_policy
from maps.site import load_site

SMALL = FleetSite.of(load_site("small"))
FEW = {"site": "small", "n_cars": 6, "battery_s": 100.0, "charge_s": 60.0}


def played(env: DispatchEnv, name: str, seed: int, n_steps: int) -> list[Any]:
    """Return what is said in the first steps of an episode."""
    policy, (observations, _) = make_policy("dispatch", name), env.reset(seed=seed)
    said: list[Any] = []
    for _ in range(n_steps):
        observations, *rest = env.step(policy.act(env, observations))
        said.append((observations, rest))
    return said


def test_the_books_of_chargers_and_charge_are_right_in_every_timestep() -> None:
    battery = Battery(drain=0.01, gain=0.02)
    orders = episode_orders(SMALL, 12, 1.0, 900.0, np.random.default_rng(0))
    grid = GridFleet(SMALL, 12, orders, 0, battery=battery)
    cars, chargers = grid.cars, SMALL.floor.charger_state
    assert cars.charge[[0, -1]].tolist() == [1.0, ENOUGH]
    n_charging = n_waiting = n_cleared = 0
    for _ in range(900):
        grid.assign_nearest()
        charge, charger, held = cars.charge.copy(), cars.charger.copy(), cars.held.copy()
        grid.move(grid.planned())
        at_charger = (charger != NONE) & (cars.state == chargers[np.maximum(charger, 0)])
        works = (
            np.isin(cars.phase, (Phase.TO_PICK, Phase.LOADING, Phase.TO_DROP, Phase.UNLOADING)) & ~held & ~at_charger
        )
        changed = battery.gain * at_charger - battery.drain * works
        np.testing.assert_array_equal(cars.charge, np.clip(charge + changed, 0.0, 1.0))
        has = cars.charger[cars.charger != NONE]
        assert len(np.unique(has)) == len(has)
        assert np.isin(cars.phase[cars.charger != NONE], (Phase.FREE, Phase.CHARGING)).all()
        waits = (cars.phase == Phase.CHARGING) & (cars.charger == NONE)
        if waits.any():
            assert len(has) == len(chargers), "nobody waits beside a charger that is left"
        assert (cars.charge[cars.phase == Phase.FREE] >= LOW).all()
        assert (cars.charge[cars.phase == Phase.CHARGING] < ENOUGH).all()
        parked = ((cars.station == NONE) & (cars.charger == NONE)) | cars.held
        assert ((cars.spot != NONE) == parked).all()
        n_charging, n_waiting = n_charging + int(at_charger.sum()), n_waiting + int(waits.sum())
        lost_it = (charger != NONE) & (cars.charger == NONE) & (cars.phase == Phase.FREE)
        n_cleared += int((lost_it & (cars.charge < 1.0)).sum())
    assert min(n_charging, n_waiting, n_cleared) > 0
    assert grid.counts.delivered.sum() > 12


def test_cars_are_told_of_charge_and_chargers_behind_all_else_and_of_nothing_without() -> None:
    with_battery, without = dispatch_v1.parallel_env(**FEW), dispatch_v1.parallel_env(site="small", n_cars=6)
    n = without.observer.n_numbers
    (seen, _), (usual, _) = with_battery.reset(seed=1), without.reset(seed=1)
    for agent, row in seen.items():
        assert len(row["observation"]) == n + 2
        np.testing.assert_array_equal(row["observation"][:4], usual[agent]["observation"][:4])
    assert (without.view.charge == 1.0).all()
    n_charging = 0
    for observations, _ in played(with_battery, "hungarian", 1, 60):
        rows = np.stack([one["observation"] for one in observations.values()])
        assert set(rows[:, -1].tolist()) <= {0.0, 0.5, 1.0}
        for one in observations.values():
            if one["observation"][4:9].sum() == 0.0:
                n_charging += 1
                assert one["action_mask"].sum() == 1
                assert one["observation"][-2] < ENOUGH
    np.testing.assert_allclose(rows[:, -2], with_battery.view.charge, atol=1e-6)
    assert n_charging > 20
    assert with_battery.view.chargers_left == pytest.approx(rows[0, -1])


def test_a_car_that_takes_nothing_charges_and_leaves_when_it_is_full() -> None:
    env = dispatch_v1.parallel_env(**FEW | {"n_cars": 2})
    observations, _ = env.reset(seed=0)
    assert env.view.charge.tolist() == [1.0, ENOUGH]
    for _ in range(20):
        observations, *_ = env.step(dict.fromkeys(observations, 0))
    assert env.view.charge.tolist() == [1.0, 1.0]
    assert env.view.chargers_left == 1.0
    env.close()


def test_charge_comes_back_with_a_saved_state() -> None:
    env, twin = dispatch_v1.parallel_env(**FEW), dispatch_v1.parallel_env(**FEW)
    said = played(env, "nearest", 3, 60)
    played(env, "nearest", 3, 30)
    state = env.save_state()
    for other in (env, twin):
        observations, policy = other.load_state(state), make_policy("dispatch", "nearest")
        for k in range(30, 60):
            observations, *rest = other.step(policy.act(other, observations))
            np.testing.assert_equal((observations, rest), said[k])


def test_an_outlook_expects_cars_back_when_they_have_enough() -> None:
    env = dispatch_v1.parallel_env(**FEW)
    policy, (observations, _) = make_policy("dispatch", "nearest"), env.reset(seed=3)
    n_charging = 0
    for _ in range(60):
        observations, *_ = env.step(policy.act(env, observations))
        outlook = env.fleet.outlook()  # type: ignore[union-attr]
        charging = env.view.phase == Phase.CHARGING
        assert (outlook.phase[charging] == Phase.FREE).all()
        np.testing.assert_allclose(outlook.left[charging], (ENOUGH - env.view.charge[charging]) * 60.0, atol=1.0)
        n_charging += int(charging.sum())
    assert n_charging > 0


def test_who_rests_in_time_delivers_more_and_without_batteries_rests_never() -> None:
    arguments = {**SCENARIOS["batteries"].arguments, "max_cycles": 200}
    env = dispatch_v1.parallel_env(**arguments)
    delivered = {}
    for name in ("rested", "hungarian"):
        played(env, name, 1, 200)
        delivered[name] = env.n_delivered
    assert delivered["rested"] > delivered["hungarian"]
    usual = dispatch_v1.parallel_env(site="small", n_cars=6)
    np.testing.assert_equal(played(usual, "rested", 1, 30), played(usual, "hungarian", 1, 30))
