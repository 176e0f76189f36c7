"""Cars with batteries: everything is delivered, nobody is stranded, and chargers are shared."""

from collections import Counter

import numpy as np
import pytest

from fleet.config import ArmConfig, BatteryConfig, Fidelity, RunConfig
from fleet.errors import ConfigError
from fleet.insight.metrics import Summary
from fleet.missions.phases import CarPhase
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import TaskState
from fleet.tasks.reasons import TaskReason

SMALL_PACK = BatteryConfig(enabled=True, capacity_wh=3.0, charge_w=60.0, start=0.5)
"""Lasts for minutes, so that a short run sees many sessions."""


def run(battery: BatteryConfig, **settings: object) -> tuple[Summary, list[Event]]:
    chosen = {"fidelity": Fidelity.GRID, "robots": 4, "tasks": 16, "duration_s": 2400.0} | settings
    config = RunConfig(battery=battery, arms=ArmConfig(workers_n=0), **chosen)  # type: ignore[arg-type]
    log: list[Event] = []

    def look(simulation: Simulation) -> None:
        charging = [car for car, phase in enumerate(simulation.missions.phase) if phase is CarPhase.CHARGING]
        cells = simulation.graph.state_cell[simulation.executor.tail_states()[charging]]
        assert set(cells.tolist()) <= set(simulation.site.chargers)
        assert len(set(cells.tolist())) == len(charging)

    with Simulation(config, on_event=log.append) as simulation:
        simulation.run(look)
        return simulation.summary(), log


@pytest.mark.parametrize(
    ("fidelity", "seed", "site", "robots"),
    [
        (Fidelity.GRID, 0, "small", 4),
        (Fidelity.GRID, 1, "small", 8),
        (Fidelity.GRID, 2, "cell", 2),
        (Fidelity.KINEMATIC, 3, "small", 4),
        (Fidelity.KINEMATIC, 4, "small", 6),
    ],
)
def test_nobody_is_stranded_and_all_is_delivered(fidelity: Fidelity, seed: int, site: str, robots: int) -> None:
    summary, _ = run(SMALL_PACK, fidelity=fidelity, seed=seed, site=site, robots=robots, tasks=5 * robots)
    assert summary.tasks_done == summary.tasks_total
    assert summary.cars_stranded == 0
    assert summary.lowest_charge is not None
    assert summary.lowest_charge > 0.02
    assert summary.charging_sessions > 0
    assert summary.time_share_percent["charging"] > 1.0
    assert (summary.robot_contacts, summary.parcel_balance) == (0, 0)


def test_two_runs_charge_alike() -> None:
    (first, _), (second, _) = (run(SMALL_PACK, duration_s=300.0) for _ in range(2))
    assert first == second


def test_a_task_that_would_strand_the_car_is_refused() -> None:
    """With no more than the margin nobody is sent anywhere but to the chargers."""
    battery = BatteryConfig(
        enabled=True, capacity_wh=3.0, charge_w=60.0, start=0.1, critical=0.0, margin=0.0, low=0.11, idle_below=0.3
    )
    summary, log = run(battery, tasks=6)
    first = next(event for event in log if event.kind == "task" and event.facts["state"] == TaskState.ASSIGNED)
    charged = [event for event in log if event.kind == "to_charger" and event.sim_s < first.sim_s]
    assert charged, "charging comes before the first task"
    assert (summary.tasks_done, summary.cars_stranded) == (6, 0)


def test_a_task_for_which_nobody_has_the_charge_says_so() -> None:
    battery = BatteryConfig(
        enabled=True, capacity_wh=3.0, start=0.1, critical=0.0, margin=0.0, low=0.11, idle_below=0.3
    )
    config = RunConfig(battery=battery, fidelity=Fidelity.GRID, robots=3, tasks=3, arms=ArmConfig(workers_n=0))
    with Simulation(config) as simulation:
        simulation.tick()
        reports = [simulation.explain_assignment(task.order.name) for task in simulation.board.tasks]
        assert {report.reason for report in reports} == {TaskReason.CARS_CHARGE}


def test_without_the_rules_a_car_would_be_stranded() -> None:
    """The same cars, when charging is forbidden by thresholds at zero and the rule is planted away."""
    battery = BatteryConfig(
        enabled=True, capacity_wh=1.0, start=0.3, margin=0.0, critical=0.0, low=0.0, enough=0.5, idle_below=0.0
    )
    config = RunConfig(battery=battery, fidelity=Fidelity.GRID, robots=2, duration_s=300.0, arms=ArmConfig(workers_n=0))
    with Simulation(config) as simulation:
        charging = simulation.view.charging
        assert charging is not None
        charging.allows = lambda cars, *_: np.ones(len(cars), dtype=np.bool_)  # type: ignore[method-assign]
        simulation.run()
        assert simulation.summary().cars_stranded > 0
        assert CarPhase.DEAD in simulation.missions.phase


def test_a_car_gives_a_task_back_when_its_battery_becomes_critical() -> None:
    with Simulation(
        RunConfig(battery=SMALL_PACK, fidelity=Fidelity.GRID, robots=2, tasks=4, arms=ArmConfig(workers_n=0))
    ) as simulation:
        while CarPhase.TO_PICK not in simulation.missions.phase:
            simulation.tick()
        car = simulation.missions.phase.index(CarPhase.TO_PICK)
        assert simulation.batteries is not None
        simulation.batteries.charge[car] = 0.1
        for _ in range(round(1.5 / simulation.tick_s)):
            simulation.tick()
        assert simulation.missions.phase[car] is CarPhase.TO_CHARGER
        assert simulation.missions.task_of[car] is None


def test_cars_make_room_for_those_that_need_the_charger_more() -> None:
    """Four cars, one charger: each comes to it."""
    battery = BatteryConfig(
        enabled=True, capacity_wh=3.0, charge_w=120.0, start=0.25, chargers_n=1, low=0.26, enough=0.4, full=1.0
    )
    summary, log = run(battery, tasks=8, duration_s=900.0)
    assert len(Counter(event.facts["car"] for event in log if event.kind == "to_charger")) == 4
    assert summary.cars_stranded == 0


@pytest.mark.parametrize("charge", [0.2, 0.7], ids=["low", "idle"])
def test_a_car_that_is_cut_off_keeps_nobody_from_charging(charge: float) -> None:
    config = RunConfig(
        battery=BatteryConfig(enabled=True), fidelity=Fidelity.GRID, robots=2, tasks=1, arms=ArmConfig(workers_n=0)
    )
    with Simulation(config) as simulation:
        assert simulation.batteries is not None
        simulation.batteries.charge[:] = (charge - 0.05, charge)
        lanes = simulation.site.lanes
        for cell in lanes[lanes[:, 0] == simulation.site.parking[0], 1].tolist():
            simulation.traffic.set_blocked(cell, True)
        simulation.cancel("order_1")
        for _ in range(2):
            simulation.tick()
        roster = simulation.missions
        assert roster.phase == [CarPhase.IDLE, CarPhase.TO_CHARGER]
        while roster.phase[1] is not CarPhase.CHARGING:
            simulation.tick()
        simulation.batteries.charge[1] = simulation.batteries.config.enough + 0.05
        for _ in range(round(1.5 / simulation.tick_s)):
            simulation.tick()
        assert roster.phase[1] is CarPhase.CHARGING, "it need not make room for one that cannot come"


def test_a_site_without_that_many_chargers() -> None:
    config = RunConfig(battery=BatteryConfig(enabled=True, chargers_n=9))
    with pytest.raises(ConfigError, match=r"battery.chargers_n is 9; valid: 1 to 2 \(chargers of site small\)"):
        Simulation(config)


def test_batteries_are_off_unless_asked_for() -> None:
    with Simulation(RunConfig(fidelity=Fidelity.GRID, arms=ArmConfig(workers_n=0))) as simulation:
        simulation.tick()
        assert simulation.batteries is None
        assert simulation.summary().lowest_charge is None
