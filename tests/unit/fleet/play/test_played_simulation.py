"""Runs whose parts are policies: good ones, and those that do nothing or harm."""

import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from fleet.arrays import FloatArray
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.envs.dispatch.env import DispatchConfig
from fleet.envs.policies import Policy
from fleet.envs.warehouse.rows import NEIGHBOURS_AT, STATION_AT, STOP_AT
from fleet.insight.metrics import Summary
from fleet.missions.phases import CarPhase
from fleet.play.decisions import Decisions
from fleet.play.docking import DockingDriver
from fleet.play.policies import PlayedPolicy, played_policy
from fleet.play.simulation import PlayedSimulation
from fleet.simulation import Simulation
from fleet.training.learned_run import LearnedRun
from fleet.world.protocol import World


class Idle:
    """Takes nothing and goes nowhere."""

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del env
        return dict.fromkeys(observations, 0)


class Wrong(Idle):
    """Says what cannot be done."""

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del env
        return dict.fromkeys(observations, 99)


class Swerving:
    """Steers to the left and drives as fast as it can."""

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del env
        return {agent: np.ones(2, dtype=np.float32) for agent in observations}


class Reversing:
    """Goes back as fast as it can."""

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del env
        return {agent: np.array([0.0, -1.0], dtype=np.float32) for agent in observations}


def of(policy: Policy) -> PlayedPolicy:
    return PlayedPolicy(policy=policy, decisions=Decisions(policy="of a test"))


def played(policies: Mapping[str, PlayedPolicy], *, n_tasks: int = 3, **settings: Any) -> tuple[Summary, list[str]]:
    """Run to the end; the summary, and why policies were replaced."""
    why: list[str] = []
    config = RunConfig(
        **{"site": "cell", "robots": 2, "fidelity": Fidelity.KINEMATIC, "tasks": n_tasks, **settings},
        arms=ArmConfig(workers_n=0),
    )

    def note(event: Any) -> None:
        if event.kind == "policy_replaced":
            why.append(event.facts["cause"])

    with PlayedSimulation(config, policies, on_event=note) as simulation:
        simulation.run()
        return simulation.summary(), why


def check(summary: Summary) -> None:
    """Everything delivered, nothing touched, every parcel where the books say."""
    assert (summary.tasks_done, summary.tasks_failed) == (summary.tasks_total, 0)
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)
    assert (summary.parcel_balance, summary.parcels_misplaced) == (0, 0)


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, Fidelity.GRID])
def test_policies_of_dispatch_and_traffic_do_all_the_work(fidelity: Fidelity) -> None:
    policies = {"dispatch": played_policy("dispatch", "nearest", 0), "traffic": played_policy("traffic", "pibt", 0)}
    summary, why = played(policies, site="small", robots=4, n_tasks=6, fidelity=fidelity)
    check(summary)
    assert why == []
    for one in policies.values():
        assert one.decisions.policy_share == 1.0
    assert policies["dispatch"].decisions.n_granted == 6


def test_a_fleet_that_asks_more_often_than_once_a_step_is_answered_to_the_end() -> None:
    """The episode of the policy ended when it had been asked as often as it has steps, and the run broke off."""
    dispatch = played_policy("dispatch", "nearest", 0)
    settings: dict[str, Any] = {"site": "small", "robots": 6, "n_tasks": 20, "duration_s": 60.0}
    summary, _ = played({"dispatch": dispatch}, **settings, fidelity=Fidelity.GRID)
    assert summary.sim_s == pytest.approx(60.0)
    assert dispatch.decisions.n_policy > 60.0 / DispatchConfig.decision_s


def test_the_same_seed_is_the_same_run() -> None:
    def run(seed: int) -> str:
        policies = {
            "dispatch": played_policy("dispatch", "random", seed),
            "docking": played_policy("docking", "pursuit", 0),
        }
        return played(policies, n_tasks=1, seed=seed)[0].state_hash

    assert run(1) == run(1) != run(2)


def test_a_policy_docks_cars() -> None:
    docking = played_policy("docking", "pursuit", 0)
    summary, why = played({"docking": docking})
    check(summary)
    assert (docking.decisions.n_made, docking.decisions.n_policy, why) == (6, 6, [])


def test_a_car_that_a_policy_docks_keeps_its_limits_of_acceleration() -> None:
    config = RunConfig(site="cell", robots=1, tasks=1, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0))
    with PlayedSimulation(config, {"docking": of(Reversing())}) as simulation:
        driver, told = cast(DockingDriver, simulation.driver), [(False, 0.0)]
        commands = driver.commands

        def watched(world: World) -> FloatArray:
            found = commands(world)
            told.append((bool(driver.docking[0]), float(found[0, 1])))
            return found

        driver.commands = watched  # type: ignore[method-assign]
        for _ in range(1200):
            simulation.tick()
        car = simulation.scene.car
        changes = [abs(now - before) for (docks, before), (still, now) in pairwise(told) if docks and still]
        assert max(changes) == pytest.approx(car.max_brake_mps2 * simulation.tick_s)


def test_a_car_that_swerves_is_given_back_to_the_path_follower() -> None:
    docking = of(Swerving())
    summary, why = played({"docking": docking}, duration_s=60.0)
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)
    assert docking.decisions.n_policy == 0
    assert set(why) == {"left its lane"}
    assert docking.decisions.n_fallback == {"left its lane": len(why)}


class Veering(Idle):
    """Drives as `pursuit` does, but for the last 30 cm, where it steers to the left."""

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        actions = played_policy("docking", "pursuit", 0).policy.act(env, observations)
        for agent, seen in observations.items():
            if seen[STOP_AT] < 0.3:
                actions[agent][0] = 1.0
        return actions


def test_a_car_that_was_given_back_too_late_tries_again() -> None:
    turned_rad: list[float] = []
    config = RunConfig(site="cell", robots=1, tasks=1, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0))
    with PlayedSimulation(config, {"docking": of(Veering())}) as simulation:

        def watch(_: Simulation) -> None:
            if simulation.missions.phase[0] in (CarPhase.LOADING, CarPhase.UNLOADING):
                dock = simulation.graph.state_pose[simulation.traffic.goals[0]]
                turned_rad.append(abs(math.remainder(simulation.driver.estimate[0, 2] - dock[2], math.tau)))

        simulation.run(watch)
        check(simulation.summary())
    assert max(turned_rad) < 0.2  # else half a radian, where it was given back


class Watched:
    """Drives as `pursuit` does, and keeps what the cars saw."""

    def __init__(self) -> None:
        self.rows: list[np.ndarray] = []
        self._pursuit = played_policy("docking", "pursuit", 0).policy

    def check(self, env: Any) -> None:
        """It can play all."""

    def act(self, env: Any, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        self.rows += [np.asarray(seen) for seen in observations.values()]
        return self._pursuit.act(env, observations)


@pytest.mark.parametrize("level", ["dock", "all"])
def test_what_was_learned_alone_sees_nobody_else(level: str) -> None:
    watched = Watched()
    learned = LearnedRun(
        folder=Path("none"),
        recipe="dock",
        arguments={"level": level},
        environment="warehouse_v1",
        render_modes=(),
    )
    one = PlayedPolicy(policy=watched, decisions=Decisions(policy="of a test"), learned=learned)
    check(played({"docking": one}, site="small", robots=6, n_tasks=6)[0])
    rows = np.stack(watched.rows)
    sees_others = rows[:, NEIGHBOURS_AT:STATION_AT].any() or rows[:, STATION_AT + 3].any()
    assert sees_others == (level == "all")
    assert (rows[:, STATION_AT + 1] == 1.0).all() == (level == "dock")


def test_a_car_that_stands_for_a_moment_has_docked(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is looked at in every tick, as in the environment, not only when the policy decides."""
    docking = played_policy("docking", "pursuit", 0)
    config = RunConfig(site="cell", robots=1, tasks=1, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0))
    with PlayedSimulation(config, {"docking": docking}) as simulation:
        stands = DockingDriver.stands

        def between_decisions(driver: DockingDriver, car: int) -> bool:
            return stands(driver, car) and simulation.now % 2 == 0

        monkeypatch.setattr(DockingDriver, "stands", between_decisions)
        simulation.run()
    assert (docking.decisions.n_made, docking.decisions.n_policy) == (2, 2)


def test_cars_that_take_nothing_are_given_tasks() -> None:
    dispatch = of(Idle())
    summary, why = played({"dispatch": dispatch})
    check(summary)
    assert set(why) == {"took nothing for too long"}
    assert dispatch.decisions.n_fallback["took nothing for too long"] == len(why)
    assert dispatch.decisions.n_policy > 0  # it was free to wait, for a while


def test_a_policy_of_traffic_is_asked_up_to_the_end_of_the_time() -> None:
    traffic = played_policy("traffic", "pibt", 0)
    summary, _ = played({"traffic": traffic}, n_tasks=12, duration_s=30.0)
    assert summary.sim_s == 30.0
    assert summary.tasks_done < 12


def test_cars_that_go_nowhere_are_moved_on() -> None:
    traffic = of(Idle())
    summary, why = played({"traffic": traffic}, n_tasks=1, robots=1)
    check(summary)
    assert set(why) == {"nothing moved on"}
    assert traffic.decisions.policy_share is not None
    assert 0.0 < traffic.decisions.policy_share < 1.0


def test_illegal_answers_are_told() -> None:
    dispatch = of(Wrong())
    check(played({"dispatch": dispatch}, n_tasks=1, robots=1)[0])
    assert dispatch.decisions.n_policy == 0
    assert dispatch.decisions.n_fallback["illegal"] > 0
