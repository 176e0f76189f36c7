"""Parcels that an arm loses: noticed, found, picked again, or the task fails with a reason; never lost in silence."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, Grip, RunConfig, ScenarioEvent
from fleet.insight.metrics import Summary
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.stations.arms.arm_controller import ArmController, ArmPhase
from fleet.tasks.board import TaskState

SETTINGS = {"site": "cell", "robots": 1, "tasks": 1, "duration_s": 150.0, "arms": ArmConfig(workers_n=0)}


def drop(arm: int, carried_s: float, **settings: object) -> tuple[Summary, list[Event]]:
    log: list[Event] = []
    event = ScenarioEvent(time_s=0.0, kind="grip_lost", target=f"arm_{arm}", parameters={"carried_s": carried_s})
    config = RunConfig(**SETTINGS | {"fidelity": Fidelity.KINEMATIC, "events": (event,)} | settings)  # type: ignore[arg-type]
    with Simulation(config, on_event=log.append) as simulation:
        simulation.run()
        return simulation.summary(), log


def of_kind(log: list[Event], kind: str) -> list[Event]:
    return [event for event in log if event.kind == kind]


def check_done(summary: Summary) -> None:
    assert (summary.tasks_done, summary.tasks_failed, summary.parcels_dropped) == (1, 0, 1)
    assert (summary.parcel_balance, summary.parcels_misplaced) == (0, 0)
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)


@pytest.mark.parametrize(
    ("arm", "carried_s", "beside"), [(0, 0.3, False), (0, 1.0, True), (1, 0.3, False)], ids=["slot", "floor", "tray"]
)
def test_a_dropped_parcel_is_picked_again_from_where_it_lies(
    arm: int, carried_s: float, beside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ArmController, "fetches", False)
    summary, log = drop(arm, carried_s)
    check_done(summary)
    (dropped,) = of_kind(log, "parcel_dropped")
    assert dropped.facts["cause"] == "its tool has failed"
    assert dropped.facts["arm"] == f"arm_{arm}"
    again = of_kind(log, "transfer_repeated")
    assert again[0].facts["cause"] == f"arm_{arm} dropped the parcel (its tool has failed)"
    assert ("x_m" in again[0].facts) == beside


def test_a_parcel_that_is_dropped_before_its_car_is_there_is_fetched_again() -> None:
    summary, log = drop(0, 0.3)
    check_done(summary)
    assert len(of_kind(log, "fetched_ahead")) == 2
    assert of_kind(log, "transfer_repeated") == []


def test_a_parcel_that_falls_where_no_arm_gets_fails_its_task_with_a_reason() -> None:
    log: list[Event] = []
    config = RunConfig(**SETTINGS | {"fidelity": Fidelity.KINEMATIC})  # type: ignore[arg-type]
    with Simulation(config, on_event=log.append) as simulation:
        while not simulation.arm_manager.services[0].carries:
            simulation.tick()
        # Thrown, not dropped: into the next lane.
        simulation.world.fail_grip(0)
        simulation.tick()
        poses = simulation.world._parcels.poses  # type: ignore[attr-defined]
        poses[0, :2] += (0.0, 1.5)
        assert simulation.arm_manager.services[0].state in (ArmPhase.PLANNING, ArmPhase.MOVING)
        simulation.run()
        summary = simulation.summary()
        task = simulation.board.tasks[0]
        x, y, _ = simulation.view.inventory.pose(task)[:3]
    assert (summary.tasks_done, summary.tasks_failed, summary.parcel_balance) == (0, 1, 0)
    assert task.state is TaskState.FAILED
    assert "no way to the parcel" in task.reason
    assert f"parcel lies at ({round(float(x), 3)}, {round(float(y), 3)}, " in task.reason


@pytest.mark.bullet
@pytest.mark.slow
@pytest.mark.parametrize("grip", list(Grip))
def test_a_parcel_dropped_in_physics_is_picked_again_and_the_run_repeats(grip: Grip) -> None:
    runs = [drop(0, 0.2, fidelity=Fidelity.PHYSICS, grip=grip) for _ in range(2)]
    summary, log = runs[0]
    check_done(summary)
    assert of_kind(log, "transfer_repeated") or of_kind(log, "fetched_ahead")[1:]
    assert summary.state_hash == runs[1][0].state_hash
    assert summary.slip_max_m is not None
    assert summary.slip_max_m < (0.0001 if grip is Grip.SUCTION else 0.005)


@pytest.mark.bullet
def test_an_overloaded_cup_says_so() -> None:
    log: list[Event] = []
    config = RunConfig(**SETTINGS | {"fidelity": Fidelity.PHYSICS})  # type: ignore[arg-type]
    with Simulation(config, on_event=log.append) as simulation:
        while not simulation.arm_manager.services[0].carries:
            simulation.tick()
        simulation.world._grip._limit[0] = 0.5  # type: ignore[attr-defined]
        while not of_kind(log, "parcel_dropped"):
            simulation.tick()
        cause = str(of_kind(log, "parcel_dropped")[0].facts["cause"])
        assert cause.startswith("it pulled with ")
        assert cause.endswith(" N, the cup holds 0.5 N")
        assert simulation.arm_manager.n_dropped == 1
        assert np.all(simulation.world.held() == -1)


def test_a_parcel_in_the_air_over_a_tray_is_not_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    config = RunConfig(site="cell", robots=1, tasks=1, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0))
    with Simulation(config) as simulation:
        task, inventory = simulation.board.tasks[0], simulation.view.inventory
        while task.state is not TaskState.CARRIED:
            simulation.tick()
        pose = inventory.pose(task)
        for lift_m, inside in ((0.0, True), (0.06, True), (0.2, False)):
            raised = pose + np.array([0.0, 0.0, lift_m, 0.0, 0.0, 0.0, 0.0])
            monkeypatch.setattr(inventory, "pose", lambda _, raised=raised: raised)
            assert inventory.in_tray(task, 0) is inside


@pytest.mark.slow
@pytest.mark.bullet
def test_fingers_let_go_of_a_parcel_that_they_have_held_for_long() -> None:
    """In this run contacts that the engine keeps had turned on the way, and pulled the parcel up with the hand."""
    config = RunConfig(site="cell", robots=3, tasks=20, seed=4, grip=Grip.FRICTION, arms=ArmConfig(workers_n=0))
    with Simulation(config) as simulation:
        task = simulation.board.named("order_2")
        while task.state is not TaskState.LOADING or simulation.world.held()[0] != task.parcel:
            simulation.tick()
        while simulation.world.held()[0] == task.parcel:
            simulation.tick()
        for _ in range(round(1.0 / simulation.tick_s)):
            simulation.tick()
        car = simulation.scene.car
        on_floor_m = car.tray_floor_z_m + max(task.delivery.size_m) / 2
        assert simulation.view.inventory.pose(task)[2] < on_floor_m + 0.01
