"""Recordings of cars alone: where they are and where they may go, as a reader of the file finds it."""

from pathlib import Path

import numpy as np
import pytest

from fleet.free_lanes.run import LayoutRun, car_footprint
from fleet.session.car_watch import CarWatch
from fleet.session.drawn_floors import lane_floor, yard_floor
from fleet.world.kinematic import KinematicWorld
from fleet.yard.run import YardRun
from maps.free_lanes.graph import free_lanes
from maps.yard import load_yard
from tests.unit.fleet.recording.test_rerun_recorder import STEP_M, rows
from tests.unit.maps.free_lanes.floors import tree


def test_cars_are_where_they_were_and_their_ways_end_at_spots(tmp_path: Path) -> None:
    run = YardRun(load_yard("depot"), 3, KinematicWorld)
    watch = CarWatch(run, yard_floor(run.yard), tmp_path / "yard.rrd")
    poses = {}
    while run.time_s < 6.0:
        run.tick()
        watch.look()
        poses[run.ticks] = run.world.car_poses()
    granted, planned = run.ways()
    watch.close()
    drawn = rows(tmp_path / "yard.rrd", "/world/cars/body", "InstancePoses3D:translations")
    assert len(drawn) > 100
    assert poses[max(drawn)][:, 0].std() > 0.5  # they have spread
    for tick, places in drawn.items():
        assert np.array(places)[:, :2] == pytest.approx(poses[tick][:, :2], abs=STEP_M + 1e-9)
    # What is granted begins at the car; what is planned goes on from there to a spot.
    for car in range(3):
        assert np.hypot(*(granted[car][0] - run.world.car_poses()[car, :2])) < 0.15
        way = np.concatenate([granted[car], planned[car]])
        off_m = np.hypot(*(run.yard.spots[:, None, :2] - way[None, -1:]).transpose(2, 0, 1))
        assert off_m.min() < 0.01
        assert 0.0 < np.hypot(*np.diff(granted[car], axis=0).T).sum() < 0.8
    # A floor without cells has no plates, which would lie in its corner.
    assert not has(tmp_path / "yard.rrd", "/world/cells/granted")


def test_cars_on_free_lanes_are_where_they_were_and_signs_lead_along_the_lanes(tmp_path: Path) -> None:
    lanes = free_lanes(tree(), car_footprint(), where="tree")
    run = LayoutRun(lanes, 2, KinematicWorld)
    watch = CarWatch(run, lane_floor(lanes), tmp_path / "tree.rrd")
    poses, words = {}, set()
    while run.time_s < 12.0:
        run.tick()
        watch.look()
        poses[run.ticks] = run.world.car_poses()
        words |= set(run.car_words)
    watch.close()
    drawn = rows(tmp_path / "tree.rrd", "/world/cars/body", "InstancePoses3D:translations")
    assert len(drawn) > 200
    for tick, places in drawn.items():
        assert np.array(places)[:, :2] == pytest.approx(poses[tick][:, :2], abs=STEP_M + 1e-9)
    assert "driving empty" in words
    floor, line = lane_floor(lanes), lanes.graph.path_points
    assert floor.station_names == tuple(station.name for station in lanes.layout.stations)
    for begin, end in floor.lanes:
        nearest = line[np.hypot(*(line[:, :2] - begin).T).argmin()]
        yaw = np.arctan2(*(end - begin)[::-1])
        assert np.hypot(*(nearest[:2] - begin)) < 0.1
        assert abs(np.remainder(yaw - nearest[2] + np.pi, 2 * np.pi) - np.pi) < 0.3
    # Stations have their signs where cars stand, less than a length of theirs from the node.
    for station, place in zip(lanes.layout.stations, floor.dock_xy, strict=True):
        node = next(node for node in lanes.layout.nodes if node.name == station.node)
        assert np.hypot(node.x - lanes.corner_m[0] - place[0], node.y - lanes.corner_m[1] - place[1]) < 2.5


def has(path: Path, entity: str) -> bool:
    """Whether a recording has anything of an entity."""
    from rerun.chunk import RrdReader

    return any(True for _ in RrdReader(path).stream().filter(content=entity))
