"""Recordings of yards: where the cars are and where they may go, as a reader of the file finds it."""

from pathlib import Path

import numpy as np
import pytest

from fleet.session.yard_watch import YardWatch
from fleet.world.kinematic import KinematicWorld
from fleet.yard.run import YardRun
from maps.yard import load_yard
from tests.unit.fleet.recording.test_rerun_recorder import STEP_M, rows


def test_cars_are_where_they_were_and_their_ways_end_at_spots(tmp_path: Path) -> None:
    run = YardRun(load_yard("depot"), 3, KinematicWorld)
    watch = YardWatch(run, tmp_path / "yard.rrd")
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


def has(path: Path, entity: str) -> bool:
    """Whether a recording has anything of an entity."""
    from rerun.chunk import RrdReader

    return any(True for _ in RrdReader(path).stream().filter(content=entity))
