"""Delays: none for a car that drives as it could, and every second that it loses."""

import numpy as np
import pytest

from fleet.config import Fidelity, RunConfig
from fleet.session.delays import EACH_CAR, MEAN, MOST, DelayWatch, delay_names
from fleet.simulation import Simulation
from fleet.traffic.drivers import MOVE_S
from planners.mapf.problem import NO_GOAL


def one_car() -> Simulation:
    """A car alone on the grid, where a move takes exactly its time."""
    return Simulation(RunConfig(site="cell", robots=1, tasks=2, fidelity=Fidelity.GRID))


def look(delays: DelayWatch, simulation: Simulation) -> float:
    (delay_s,) = delays.look(simulation.view.driver.remaining_lines())
    return float(delay_s)


def test_a_car_alone_comes_as_early_as_it_can() -> None:
    with one_car() as simulation:
        delays, seen = DelayWatch(simulation.view), []
        while not simulation.finished:
            simulation.tick()
            seen.append(look(delays, simulation))
        known = np.array(seen)[~np.isnan(seen)]
        # The move that is being made counts until its end, and moves into docks are shorter than others.
        assert len(known) > 100
        assert np.abs(known).max() <= 2 * MOVE_S + 0.2


def test_a_car_that_is_stopped_is_late_by_that_time() -> None:
    """A friction of the first hour: plan against execution was nowhere to be seen."""
    with one_car() as simulation:
        delays = DelayWatch(simulation.view)
        while not look(delays, simulation) >= 0.0 or simulation.sim_s < 2.0:
            simulation.tick()
        before, goal = look(delays, simulation), int(simulation.view.traffic.goals[0])
        simulation.view.driver.stop(0)
        until_s = simulation.sim_s + 10.0
        while simulation.sim_s < until_s:
            simulation.tick()
            after = look(delays, simulation)
        assert int(simulation.view.traffic.goals[0]) == goal
        assert after - before == pytest.approx(10.0, abs=2 * MOVE_S)


def test_a_new_goal_begins_with_no_delay_and_an_arrival_ends_it() -> None:
    with one_car() as simulation:
        delays, goal, n_goals, arrived = DelayWatch(simulation.view), NO_GOAL, 0, False
        while not simulation.finished:
            simulation.tick()
            delay_s, now = look(delays, simulation), int(simulation.view.traffic.goals[0])
            if now != goal:
                assert np.isnan(delay_s) or delay_s == 0.0
                goal, n_goals = now, n_goals + 1
            arrived |= now != NO_GOAL and np.isnan(delay_s)
        assert n_goals >= 4
        assert arrived


def test_a_fleet_without_room_for_a_line_each_has_mean_and_most() -> None:
    assert delay_names(2) == ("car_0", "car_1")
    assert delay_names(EACH_CAR + 1) == (MEAN, MOST)
    with Simulation(RunConfig(site="medium", robots=EACH_CAR + 1, tasks=40, fidelity=Fidelity.GRID)) as simulation:
        delays = DelayWatch(simulation.view)
        for _ in range(200):
            simulation.tick()
            figures = delays.figures(simulation.view.driver.remaining_lines())
        seconds = delays.look(simulation.view.driver.remaining_lines())
        assert figures == {MEAN: pytest.approx(np.nanmean(seconds)), MOST: pytest.approx(np.nanmax(seconds))}
        assert figures[MOST] > figures[MEAN] > 0.0
