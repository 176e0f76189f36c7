"""Grid world: lock step, legal moves only."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
import pytest

from fleet.errors import ConfigError
from fleet.world.grid import GridConfig, GridWorld, NotOnLaneError
from fleet.world.kinematic import CommandError
from fleet.world.scene import Scene
from maps.grid import GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph

GRAPH = grid_lane_graph(GridMap(np.ones((6, 10), dtype=np.bool_)), "rotating")
EAST = 0


def state_at(graph: LaneGraph, row: int, col: int, heading: int = EAST) -> int:
    """Return a state by its cell."""
    return int(graph.state_at(row * 10 + col, heading))


def step(world: GridWorld, states: list[int], ticks: int) -> list[npt.NDArray[np.float64]]:
    """Command the same states for some ticks; returns the poses after each."""
    out = []
    q = world.arm_positions()
    for _ in range(ticks):
        command = np.column_stack((states, np.zeros(len(states)))).astype(np.float64)
        world.step(command, q, np.zeros_like(q), np.zeros(world.n_arms, dtype=np.bool_))
        out.append(world.car_poses())
    return out


def test_car_stands_until_the_timestep_ends_then_is_there(hall: Scene) -> None:
    world = GridWorld(hall, GRAPH, GridConfig(tick_s=0.1, timestep_s=1.0))
    stay, go = state_at(GRAPH, 4, 4), state_at(GRAPH, 4, 2)
    poses = step(world, [go, stay], 11)
    assert [pose[0, 0] for pose in poses] == [1.5] * 9 + [2.5] * 2
    assert np.array_equal(poses[-1][0], GRAPH.state_pose[go])


def test_speed_is_the_mean_of_the_move_under_way(hall: Scene) -> None:
    world = GridWorld(hall, GRAPH, GridConfig(tick_s=0.1, timestep_s=2.0))
    stay, here, go = state_at(GRAPH, 4, 4), state_at(GRAPH, 4, 1), state_at(GRAPH, 4, 2)
    way_m = 0.0
    for target in [here] * 20 + [go] * 20 + [go] * 20:
        step(world, [target, stay], 1)
        assert world.car_speeds()[1] == 0.0
        way_m += world.car_speeds()[0] * world.tick_s
    assert way_m == pytest.approx(world.car_poses()[0, 0] - hall.car_start[0, 0])
    snapshot = world.save()
    step(world, [state_at(GRAPH, 4, 3), stay], 1)
    assert world.car_speeds().tolist() == [0.5, 0.0]
    world.load(snapshot)
    assert world.car_speeds().tolist() == [0.0, 0.0]


def test_command_of_the_last_tick_decides(hall: Scene) -> None:
    world = GridWorld(hall, GRAPH, GridConfig(tick_s=0.5, timestep_s=1.0))
    stay, here, go = state_at(GRAPH, 4, 4), state_at(GRAPH, 4, 1), state_at(GRAPH, 4, 2)
    step(world, [go, stay], 1)
    assert step(world, [here, stay], 1)[0][0, 0] == 1.5


@pytest.mark.parametrize("target", [state_at(GRAPH, 4, 3), -1, GRAPH.n_states], ids=["jump", "negative", "beyond"])
def test_illegal_move_is_refused(hall: Scene, target: int) -> None:
    world = GridWorld(hall, GRAPH)
    with pytest.raises(CommandError, match=f"car 0 in state {state_at(GRAPH, 4, 1)} is sent to state {target}"):
        step(world, [target, state_at(GRAPH, 4, 4)], 1)


def test_pushed_car_is_back_on_its_lane_after_the_next_move(hall: Scene) -> None:
    world = GridWorld(hall, GRAPH, GridConfig(tick_s=1.0, timestep_s=1.0))
    world.push_car(0, 0.1, 0.2, 0.3)
    stay, here, go = state_at(GRAPH, 4, 4), state_at(GRAPH, 4, 1), state_at(GRAPH, 4, 2)
    assert step(world, [here, stay], 1)[0][0] == pytest.approx([1.6, 1.7, 0.3])
    assert step(world, [go, stay], 1)[0][0] == pytest.approx([2.5, 1.5, 0.0])


def test_start_off_the_lane_is_refused(hall: Scene) -> None:
    scene = dataclasses.replace(hall, car_start=np.array([[1.5, 1.5, 0.4]]))
    with pytest.raises(NotOnLaneError, match=r"car 0 starts at x, y, yaw = \[1.5, 1.5, 0.4\]"):
        GridWorld(scene, GRAPH)


def test_timestep_is_whole_ticks() -> None:
    assert GridConfig(tick_s=0.05, timestep_s=1.0).n_ticks == 20
    with pytest.raises(ConfigError, match=r"multiple of 0\.3"):
        GridConfig(tick_s=0.3, timestep_s=1.0)
