"""What judges runs with faults can itself fail: the search for what is possible, and dips."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reliability.dips import BEGINS_S, STEP_S, figures
from benchmarks.reliability.ends import Touches
from benchmarks.reliability.possible import Parts, WorkLeft
from benchmarks.reliability.wrecks import draw
from fleet.config import ArmConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.simulation import Simulation
from fleet.tasks.board import DONE_STATES, TaskState
from fleet.traffic.reversed_lanes import both_ways
from fleet.world.protocol import Contacts
from maps.lane_graph import build_lane_graph
from maps.warehouse import generate_warehouse

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


def test_a_car_that_is_taken_out_delivers_what_it_carries() -> None:
    with Simulation(CONFIG) as simulation:
        while not (carried := simulation.board.in_state(TaskState.CARRIED)):
            simulation.tick()
    out = tuple(ScenarioEvent(time_s=simulation.sim_s + 0.1, kind="car_out", target=f"car_{car}") for car in range(2))
    with Simulation(replace(CONFIG, events=out)) as simulation:
        left = follow(simulation)
        while simulation.sim_s < out[0].time_s + 1.0:
            simulation.tick()
        assert left.open_while_possible() == [task.order.name for task in carried]
        simulation.run()
        assert simulation.board.named(carried[0].order.name).state in DONE_STATES


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


def test_nobody_turns_round_where_the_lanes_do_not() -> None:
    """From the pick dock a car can go one cell on or back three, and comes out of neither with its nose the other way.

    The cells hang together past the wrecks, so that whoever turns on the spot would get through.
    """
    site = generate_warehouse(rows=9, cols=17, pick=1, drop=1, parking=6)
    parts, covered = Parts(site), np.zeros(site.grid.free.shape, dtype=np.bool_)
    pick, drop = (site.bays()[name] for name in ("pick_1", "drop_1"))
    assert parts.at(pick) & parts.at(drop)
    for cell in ((1, 4), (1, 5), (2, 1), (6, 2), (7, 2)):
        covered[cell] = True
    parts.cover(covered.ravel())
    assert parts.at(pick)
    assert not parts.at(pick) & parts.at(drop)
    covered[2, 1] = False
    parts.cover(covered.ravel())
    assert parts.at(pick) & parts.at(drop)


@pytest.mark.parametrize("seed", range(8))
def test_the_search_is_at_least_as_generous_as_the_lanes_of_the_fleet(seed: int) -> None:
    """Wherever a way leads for the fleet, forwards or backwards, the search finds that the cells hang together."""
    rng = np.random.default_rng(seed)
    site = generate_warehouse(rows=13, cols=20, pick=2, drop=2, parking=10)
    graph, parts = build_lane_graph(site), Parts(site)
    blocked = rng.random(graph.n_cells) < rng.uniform(0.0, 0.1)
    part = both_ways(graph, blocked)
    parts.cover(blocked)
    free = np.flatnonzero(~blocked[graph.state_cell])
    pairs = rng.choice(free, (400, 2))
    joined = part[pairs[:, 0]] == part[pairs[:, 1]]
    assert joined.sum() > 0
    for a, b in graph.state_cell[pairs[joined]].tolist():
        assert parts.at(a) & parts.at(b)


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
