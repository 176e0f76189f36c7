"""Cars on the lanes of a layout on no grid."""

import numpy as np
import pytest

from fleet.errors import ConfigError
from fleet.free_lanes.picture import lane_picture
from fleet.free_lanes.run import LayoutRun, car_footprint
from fleet.world.kinematic import KinematicWorld
from maps.free_lanes.graph import FreeLanes, free_lanes
from tests.unit.maps.free_lanes.floors import ring, tree


@pytest.fixture(scope="module")
def arms() -> FreeLanes:
    return free_lanes(tree(), car_footprint(), where="tree")


def played(lanes: FreeLanes, n_cars: int, seconds: float, seed: int = 0) -> LayoutRun:
    run = LayoutRun(lanes, n_cars, KinematicWorld, seed=seed)
    while run.time_s < seconds:
        run.tick()
    return run


def test_cars_deliver_between_stations_of_a_tree(arms: FreeLanes) -> None:
    result = played(arms, 3, 240.0).result()
    assert result.deliveries >= 5
    assert result.trips >= 2 * result.deliveries
    assert (result.contacts, result.plans_cut) == (0, 0)
    assert result.min_clearance_m > 0.1
    assert result.longest_still_s < 60.0


def test_without_stations_cars_go_from_node_to_node_on_their_lanes() -> None:
    lanes = free_lanes(ring(), car_footprint(), where="ring")
    run = LayoutRun(lanes, 2, KinematicWorld)
    line = lanes.graph.path_points[:, :2]
    furthest = 0.0
    while run.time_s < 120.0:
        run.tick()
        apart = np.hypot(*(run.world.car_poses()[:, None, :2] - line).transpose(2, 0, 1)).min(axis=1)
        furthest = max(furthest, float(apart.max()))
    assert run.result().trips >= 4
    assert run.result().contacts == 0
    assert furthest < 0.06


def test_the_same_seed_is_the_same_run(arms: FreeLanes) -> None:
    poses = [played(arms, 3, 30.0, seed).world.car_poses() for seed in (1, 1, 2)]
    np.testing.assert_array_equal(poses[0], poses[1])
    assert not np.array_equal(poses[0], poses[2])


def test_more_cars_than_have_room_are_refused(arms: FreeLanes) -> None:
    with pytest.raises(ConfigError, match=r"--cars is 99; valid: 1 to \d+, as many as have room on the lanes"):
        LayoutRun(arms, 99, KinematicWorld)


def test_a_picture_names_nodes_and_stations(arms: FreeLanes) -> None:
    svg = lane_picture(arms).svg()
    assert all(word in svg for word in ("hub", "pick at east", "drop at west"))
