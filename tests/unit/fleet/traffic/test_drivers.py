"""Drivers: moves that are handed over together are driven in their order."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fleet.config import EstimateConfig
from fleet.robots.cars.models import CarModels
from fleet.robots.cars.racecar import racecar_spec
from fleet.robots.pursuit import PathError
from fleet.traffic.drivers import RELEASE_M, PathDriver, StateDriver
from maps.lane_graph import LaneGraph, build_lane_graph
from maps.site import Site, load_site


@pytest.fixture(scope="module")
def graph() -> LaneGraph:
    site: Site = load_site("small")
    return build_lane_graph(site)


def moves_from(graph: LaneGraph, state: int, n: int) -> list[int]:
    """Moves that follow each other."""
    moves = []
    for _ in range(n):
        moves.append(int(graph.out_move[graph.out_ptr[state]]))
        state = int(graph.move_to[moves[-1]])
    return moves


def path_driver(graph: LaneGraph, states: list[int]) -> PathDriver:
    rng = np.random.default_rng(0)
    return PathDriver(
        graph, CarModels.alike(racecar_spec(), len(states)), graph.state_pose[states], 0.05, EstimateConfig(), rng
    )


def array(numbers: list[int]) -> np.ndarray:
    return np.array(numbers, dtype=np.int32)


def test_moves_of_several_cars_lie_behind_each_other(graph: LaneGraph) -> None:
    """Twenty moves need more room than a path and a queue have at first."""
    states = [int(graph.move_from[0]), int(graph.move_from[len(graph.move_from) // 2])]
    ways = [moves_from(graph, state, 20) for state in states]
    driver, singly = path_driver(graph, states), path_driver(graph, states)
    driver.append(array([0] * 20 + [1] * 20), array(ways[0] + ways[1]))
    for first, second in zip(*ways, strict=True):
        singly.append(array([1, 0]), array([second, first]))
    lengths = [float(graph.move_length[way].sum()) for way in ways]
    for car in range(2):
        np.testing.assert_array_equal(driver.remaining(car), singly.remaining(car))
        assert driver.buffer.end_s(car) == pytest.approx(lengths[car])
        assert not driver.at_rest(car)


def test_moves_end_shortly_before_their_ends(graph: LaneGraph) -> None:
    state = int(graph.move_from[0])
    way = moves_from(graph, state, 3)
    driver = path_driver(graph, [state])
    driver.append(array([0, 0, 0]), array(way))
    ends = np.cumsum(graph.move_length[way])
    driver.follower.progress[0] = ends[1] - 1.01 * RELEASE_M
    assert driver.finished().tolist() == [0]
    driver.follower.progress[0] = ends[2]
    assert driver.finished().tolist() == [0, 0]
    assert driver.finished().tolist() == []


def test_a_move_from_elsewhere_is_refused_by_name(graph: LaneGraph) -> None:
    state = int(graph.move_from[0])
    away = max(range(graph.n_moves), key=lambda m: float(np.hypot(*(graph.path_points[graph.path_ptr[m], :2]))))
    with pytest.raises(PathError, match="path of car 0 ends at"):
        path_driver(graph, [state]).append(array([0]), array([away]))


def test_the_grid_is_driven_state_by_state(graph: LaneGraph) -> None:
    state = int(graph.move_from[0])
    way = moves_from(graph, state, 6)
    targets = graph.move_to[way].tolist()
    at = np.array([state], dtype=np.int64)
    driver = StateDriver(graph, array([state]), lambda: at)
    world: Any = SimpleNamespace(car_poses=lambda: graph.state_pose[at])
    assert driver.at_rest(0)
    driver.append(array([0] * 6), array(way))
    np.testing.assert_array_equal(driver.remaining(0), graph.state_pose[[state, *targets], :2])
    assert driver.commands(world)[0, 0] == targets[0]
    assert driver.finished().tolist() == []
    at[0] = targets[0]
    assert driver.commands(world)[0, 0] == targets[1]
    assert driver.finished().tolist() == [0]
    driver.give_up(0)
    assert driver.commands(world)[0, 0] == targets[0]
    assert driver.at_rest(0)


def test_a_rest_between_two_moves_ends_with_what_made_the_car_slow(graph: LaneGraph) -> None:
    """It was kept until somebody else was hindered, and then waited for."""
    states = np.array([0, 5], dtype=np.int32)
    driver = StateDriver(graph, states, lambda: states)
    world: Any = SimpleNamespace(tick_s=0.05)
    nobody = np.empty(0, dtype=np.int32)
    driver.hindrances.slow(0, 0.1)
    assert driver._stand(np.array([0], dtype=np.int32), world).tolist() == [True, False]
    driver.hindrances.slow(0, 1.0)
    assert driver._stand(nobody, world).tolist() == [False, False]
    driver.hindrances.hold(1)
    assert driver._stand(nobody, world).tolist() == [False, True]
