"""Layouts of others as they are: every node and station of them can be driven to, and cars drive without contact."""

import os
from pathlib import Path

import pytest

from fleet.cli.layout.lanes_file import read_lanes
from fleet.free_lanes.run import LayoutRun
from fleet.world.kinematic import KinematicWorld
from tests.unit.maps.free_lanes.test_free_lanes import check

INSTANCES = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).parents[3] / "shared" / "instances")) / "interop"


@pytest.mark.parametrize(
    ("file", "n_nodes", "n_passed", "ratio"),
    [
        ("opentcs/Demo-01.xml", 59, 11, 2.2),
        ("rmf/nav/office/0.yaml", 29, 4, 1.5),
    ],
)
def test_cars_drive_on_a_layout_of_somebody_else(file: str, n_nodes: int, n_passed: int, ratio: float) -> None:
    path = INSTANCES / file
    if not path.is_file():
        pytest.skip(f"no {path}; set FLEET_INSTANCES to the folder that holds interop")
    lanes = read_lanes(path, None, None)
    assert len(lanes.layout.nodes) == n_nodes
    assert len(lanes.states_at) == n_nodes - n_passed
    assert lanes.path_ratio < ratio
    check(lanes)
    run = LayoutRun(lanes, 4, KinematicWorld)
    while run.time_s < 300.0:
        run.tick()
    result = run.result()
    assert (result.contacts, result.plans_cut) == (0, 0)
    assert result.deliveries >= 4
    assert result.longest_still_s < 60.0
