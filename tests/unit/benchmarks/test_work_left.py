"""What judges runs with faults can itself fail: the search for what is possible, and dips."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.reliability.dips import BEGINS_S, STEP_S, figures
from benchmarks.reliability.ends import Touches
from benchmarks.reliability.possible import WorkLeft
from benchmarks.reliability.wrecks import draw
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.simulation import Simulation
from fleet.tasks.board import TaskState
from fleet.world.protocol import Contacts

CONFIG = RunConfig(site="small", robots=2, tasks=4, fidelity=Fidelity.GRID, arms=ArmConfig(workers_n=0))


def follow(simulation: Simulation) -> WorkLeft:
    left = WorkLeft(simulation)
    simulation.view.events.subscribe(left.hear)
    return left


def test_a_task_that_fails_for_no_reason_is_seen() -> None:
    with Simulation(CONFIG) as simulation:
        left = follow(simulation)
        while not (waiting := simulation.board.in_state(TaskState.BACKLOG, TaskState.READY)):
            simulation.tick()
        simulation.view.inventory.withdraw(waiting[0], TaskState.FAILED, simulation.sim_s, "planted")
        left.tick()
        assert left.failed_while_possible == [f"{waiting[0].order.name}: planted"]
        assert waiting[0].order.name not in left.open_while_possible()
        assert left.open_while_possible()


def test_without_a_live_car_nothing_is_possible() -> None:
    with Simulation(CONFIG) as simulation:
        left = follow(simulation)
        simulation.tick()
        for car in range(2):
            simulation.lose_car(car, "planted")
        for _ in range(40):
            simulation.tick()
            left.tick()
        assert left.open_while_possible() == []
        assert left.failed_while_possible == []
        assert 0.0 <= max(left.ended_after_s) < 2.0


def test_a_dock_under_a_wreck_is_out_of_reach() -> None:
    with Simulation(CONFIG) as simulation:
        left = follow(simulation)
        drops = {task.delivery.drop for task in simulation.board.tasks}
        for station in simulation.stations:
            if station.name in drops:
                simulation.world.put_car(0, simulation.graph.state_pose[station.dock_state])
                simulation.lose_car(0, "planted")
                cut = {task.order.name for task in simulation.board.tasks if task.delivery.drop == station.name}
                break
        assert not cut & set(left.open_while_possible())


def test_arms_that_touch_each_other_are_seen() -> None:
    with Simulation(CONFIG) as simulation:
        touches = Touches(simulation)
        touches.tick()
        assert touches.n_uncaused == 0
        simulation.world.contacts = lambda: Contacts(robot=1, static=0)  # type: ignore[method-assign]
        for _ in range(2):
            touches.tick()
        assert touches.n_uncaused == 1


def test_a_dip_is_measured() -> None:
    at_s = np.arange(0.0, 900.1, STEP_S)
    usual = at_s / 10.0
    stopped_s = np.clip(at_s - BEGINS_S, 0.0, 60.0)
    back = np.clip((at_s - BEGINS_S - 60.0) / 120.0, 0.0, 1.0) * 6.0
    dip, behind, after_s = figures(usual, usual - stopped_s / 10.0 + back)
    assert dip == 0.0
    assert behind == pytest.approx(6.0)
    assert 0.0 < after_s <= 60.0  # from then on it catches up
    assert figures(usual, usual) == (100.0, 0.0, 0.0)
    slow = np.where(at_s > BEGINS_S, usual - (at_s - BEGINS_S) / 20.0, usual)
    assert figures(usual, slow)[2] == math.inf


def test_somebody_lives_on() -> None:
    sites = {"cell": (2, 2), "small": (3, 4)}
    for seed in range(40):
        config = draw(seed, sites, (2, 4))
        assert 1 <= len({event.target for event in config.events}) < config.robots
