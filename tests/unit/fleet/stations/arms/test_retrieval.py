"""Parcels that lie anywhere are reached, by motions that join and keep clear; where there is no way, it says why."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.config import Grip
from fleet.robots import ARMS
from fleet.robots.cars.racecar import racecar_spec
from fleet.robots.tools import TOOLS
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_spheres import planned_arm
from fleet.stations.arms.cell_planner import CellPlanner
from fleet.stations.arms.search import Search
from fleet.stations.arms.transfer import LOOSE, TRAY, Signal, TransferRequest
from fleet.world.site_scene import scene_of
from maps.site import load_site
from planners.motion.collision.collision import CollisionChecker
from planners.motion.path.trajectory import Trajectory

EDGE_M = 0.06


@pytest.fixture(scope="module")
def planner() -> CellPlanner:
    plan, tool = load_site("cell"), TOOLS["suction"]
    return CellPlanner(
        arm_cells(plan, scene_of(plan, np.zeros((1, 3)), Grip.SUCTION))[0],
        planned_arm(ARMS["iiwa"].spec(tool)),
        racecar_spec(),
        Search("rrt_connect_native", 20_000),
    )


def lying_at(planner: CellPlanner, x: float, y: float, support_m: float) -> TransferRequest:
    """A cube on a support, x, y and height in the base frame; it is square to the world."""
    base_x, base_y, base_z, yaw = planner.cell.base_pose
    cos, sin = np.cos(yaw), np.sin(yaw)
    where = base_x + cos * x - sin * y, base_y + sin * x + cos * y, base_z + support_m + EDGE_M / 2
    return TransferRequest(
        arm=0,
        parcel=0,
        size_m=(EDGE_M,) * 3,
        pick_pose=np.array([*where, 0.0, 0.0, 0.0, 1.0]),
        pick_via=LOOSE,
        place_via=TRAY,
        car_pose=np.array(load_site("cell").stations[0].dock.pose),
    )


# On a pedestal behind other parcels, far out, and beside the base: the first two have ways down from few postures only.
@pytest.mark.parametrize("place", [(-0.36, 0.16, 0.25), (0.62, 0.42, 0.0), (0.71, -0.33, 0.0), (0.15, 0.42, 0.0)])
def test_motions_join_and_keep_clear(planner, place):
    request = lying_at(planner, *place)
    transfer = planner.transfer(request)
    assert transfer.reason == ""
    solid = CollisionChecker(planner._known.empty.model, planner._known.line_boxes, margin=0.0)
    here = planner._spec.home_rad
    for step in transfer.steps:
        if isinstance(step, Trajectory):
            np.testing.assert_allclose(step.q[0], here, atol=1e-9)
            assert solid.batch(step.q).all()
            here = step.q[-1]
        elif step is Signal.GRIP:
            tip = planner._motions.tip(here)
            top = planner.cell.base_from_world(request.pick_pose[:3]) + np.array([0.0, 0.0, EDGE_M / 2])
            np.testing.assert_allclose(tip[:3, 3], top, atol=0.004)
    np.testing.assert_allclose(here, planner._spec.home_rad, atol=1e-9)


@pytest.mark.parametrize(
    ("place", "why"),
    [((0.34, 0.16, 0.0), "unreachable"), ((0.37, -0.43, 0.0), "no room"), ((2.0, 0.0, 0.0), "unreach")],
)
def test_why_there_is_no_way(planner, place, why):
    transfer = planner.transfer(lying_at(planner, *place))
    assert not transfer.steps
    assert why in transfer.reason
    assert "lies at" in transfer.reason
