"""PIBT in the long run: nobody freezes, nobody starves."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from maps.grid import EAST, NORTH
from maps.lane_graph import LaneGraph, build_lane_graph
from maps.site import Site
from planners.errors import PlanningError
from planners.mapf.distance_table import DistanceTable
from planners.mapf.pibt import Pibt, PibtConfig
from planners.mapf.problem import Instance
from planners.mapf.validate import breaches
from tests.unit.planners.mapf.lanes import (
    graph_of,
    instance_of,
    one_way_grid,
    one_way_loop,
    random_starts,
    rotating_grid,
)

STEPS_PER_WINDOW = 4
HORIZON = 6


def lifelong(
    graph: LaneGraph,
    n: int,
    *,
    windows: int,
    dwell: int,
    goals_of: npt.NDArray[np.int64],
    seed: int = 0,
) -> npt.NDArray[np.int64]:
    """Windows in which each agent completed a goal, as counts of shape (windows, n).

    An agent at its goal is served there for `dwell` windows, in which it does not move, then it gets another goal
    that nobody else is sent to.
    """
    rng = np.random.default_rng(seed)
    planner = Pibt(seed=seed)
    blocked = np.zeros(graph.n_cells, dtype=np.bool_)
    tables = DistanceTable(graph, blocked)
    states = np.array(random_starts(graph, n, rng), dtype=np.int32)
    goals = rng.choice(goals_of, size=n, replace=False).astype(np.int32)
    served = np.zeros(n, dtype=np.int64)  # windows that are left to dwell
    since = np.zeros(n)
    completed = np.zeros((windows, n), dtype=np.int64)
    for window in range(windows):
        instance = Instance(
            graph=graph,
            starts=states,
            goals=goals,
            priorities=since + np.arange(n) * 1e-6,
            stay=np.ones(n, dtype=np.bool_),
            fixed=served > 0,
            blocked=blocked,
            allow_rotation=False,
            horizon=HORIZON,
        )
        plan = planner.plan(instance, tables)
        if window % 50 == 0:
            assert breaches(instance, plan) == []
        states = plan.states[STEPS_PER_WINDOW]
        since += STEPS_PER_WINDOW
        arrived = (states == goals) & (served == 0)
        served = np.where(arrived, dwell + 1, served)
        served = np.maximum(served - 1, 0)
        leaving = np.flatnonzero((states == goals) & (served == 0))
        completed[window, leaving] = 1
        for agent in leaving:
            goals[agent] = rng.choice(np.setdiff1d(goals_of, goals))
            since[agent] = 0
    return completed


def longest_pause(completed: npt.NDArray[np.int64]) -> int:
    """Windows in a row in which no agent at all completed a goal."""
    busy = np.flatnonzero(completed.any(axis=1))
    return int(np.diff(busy, prepend=-1, append=len(completed)).max())


@pytest.mark.parametrize("dwell", [0, 3, 8])
@pytest.mark.parametrize("share", [0.05, 0.2, 0.4])
def test_a_one_way_grid_never_freezes(share: float, dwell: int) -> None:
    graph = one_way_grid(10, 16)
    n = int(share * graph.n_cells)
    goals = np.unique(graph.state_cell, return_index=True)[1]  # one state per cell
    completed = lifelong(graph, n, windows=1000, dwell=dwell, goals_of=goals, seed=n + dwell)
    assert longest_pause(completed) <= 40
    halves = completed.reshape(2, 500, n).sum(axis=(1, 2))
    assert halves[1] >= 0.85 * halves[0]
    assert (completed.reshape(4, 250, n).sum(axis=1) > 0).all(), "an agent completed nothing in 250 windows"


@pytest.mark.parametrize("n", [4, 12, 24])
def test_a_site_whose_docks_lie_in_lanes_never_freezes(small_site: Site, n: int) -> None:
    """Goals are docks, with service, and parking places, as in a warehouse."""
    graph = build_lane_graph(small_site)
    docks = [graph.state_at(station.dock.cell, station.dock.heading) for station in small_site.stations]
    parking = [int(graph.states_of_cell(cell)[0]) for cell in small_site.parking]
    goals = np.array([*docks, *parking])
    completed = lifelong(graph, min(n, len(goals) - 2), windows=1000, dwell=3, goals_of=goals, seed=n)
    assert longest_pause(completed) <= 40
    assert (completed.reshape(2, 500, -1).sum(axis=1) > 0).all()


def test_impatience_lets_the_one_that_waits_longer_pass_first() -> None:
    """The agent that is not at its goal outgrows any priority difference inside the window."""
    instance = instance_of(one_way_loop(6), [0, 1], [3, 1], priorities=[0.0, 5.0], horizon=4)
    assert Pibt(PibtConfig(impatience=1.0)).plan(instance).states[-1, 0] == 3


def test_a_move_that_came_to_nothing_leaves_its_swept_cells_to_others() -> None:
    """Agent 0 would sweep cell 3 on its way to agent 1, who cannot move; agent 2 then enters cell 3."""
    graph = graph_of(range(4), [(0, 1), (2, 3)], sweeps={(0, 1): (3,)})
    instance = instance_of(graph, [0, 1, 2], [1, -1, 3], priorities=[3.0, 2.0, 1.0], horizon=1)
    assert Pibt().plan(instance).states[1].tolist() == [0, 1, 3]


def test_a_vehicle_that_faces_a_wall_turns_to_make_way() -> None:
    """Agent 1 stands across a corridor and cannot drive off at once; only the turn it begins opens the way."""
    graph = rotating_grid(1, 4)
    instance = instance_of(
        graph, [graph.state_at(0, EAST), graph.state_at(1, NORTH)], [graph.state_at(2, EAST), -1], horizon=8
    )
    plan = Pibt().plan(instance)
    assert breaches(instance, plan) == []
    assert plan.states[-1].tolist() == [graph.state_at(2, EAST), graph.state_at(3, EAST)]


def test_nobody_drives_into_a_cell_whose_vehicle_is_still_turning() -> None:
    """Both aim one cell on; the one ahead has to turn first, so both wait for its turn."""
    graph = rotating_grid(1, 4)
    starts = [graph.state_at(0, EAST), graph.state_at(1, NORTH)]
    instance = instance_of(graph, starts, [graph.state_at(1, EAST), graph.state_at(2, EAST)], horizon=2)
    plan = Pibt().plan(instance)
    assert plan.states[1].tolist() == [starts[0], graph.state_at(1, EAST)]
    assert plan.states[2].tolist() == [graph.state_at(1, EAST), graph.state_at(2, EAST)]


def test_each_call_draws_on() -> None:
    """A window that comes again is not planned the same way again, or a bad choice would repeat for ever."""
    graph = one_way_grid(6, 8)
    rng = np.random.default_rng(0)
    instance = instance_of(graph, random_starts(graph, 30, rng), rng.integers(graph.n_states, size=30).tolist())
    planner = Pibt(seed=0)
    assert len({planner.plan(instance).states.tobytes() for _ in range(5)}) > 1


def test_tables_of_another_graph_are_refused() -> None:
    blocked = np.zeros(6, dtype=np.bool_)
    with pytest.raises(PlanningError, match="another graph"):
        Pibt().plan(instance_of(one_way_loop(6), [0]), DistanceTable(one_way_loop(6), blocked))


def test_a_negative_impatience_is_refused() -> None:
    with pytest.raises(PlanningError, match="impatience = -1"):
        PibtConfig(impatience=-1)
