"""Runs whose parts are policies: good ones, and those that do nothing or harm."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.envs.policies import Policy
from fleet.insight.metrics import Summary
from fleet.play.decisions import Decisions
from fleet.play.policies import PlayedPolicy, played_policy
from fleet.play.simulation import PlayedSimulation


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


def test_a_car_that_swerves_is_given_back_to_the_path_follower() -> None:
    docking = of(Swerving())
    summary, why = played({"docking": docking}, duration_s=60.0)
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)
    assert docking.decisions.n_policy == 0
    assert set(why) == {"left its lane"}
    assert docking.decisions.n_fallback == {"left its lane": len(why)}


def test_cars_that_take_nothing_are_given_tasks() -> None:
    dispatch = of(Idle())
    summary, why = played({"dispatch": dispatch})
    check(summary)
    assert set(why) == {"took nothing for too long"}
    assert dispatch.decisions.n_fallback["took nothing for too long"] == len(why)
    assert dispatch.decisions.n_policy > 0  # it was free to wait, for a while


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
