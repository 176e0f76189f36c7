"""Ways of an arm keep above the cars in its dock."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.config import Grip
from fleet.robots import iiwa_spec, racecar_spec
from fleet.robots.tools import TOOLS
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_spheres import planned_arm
from fleet.stations.arms.cell_planner import MARGIN_M, CellPlanner
from fleet.stations.arms.search import Search
from fleet.world.site_scene import scene_of
from maps.site import load_site
from planners.motion.collision.collision import Boxes, CollisionChecker


@pytest.mark.parametrize("grip", list(Grip))
@pytest.mark.parametrize("site", ["cell", "small", "twin"])
def test_an_arm_without_a_parcel_keeps_above_the_cars_that_pass_its_dock(site, grip):
    plan, tool = load_site(site), TOOLS[grip]
    arm, car = planned_arm(iiwa_spec(tool), tool), racecar_spec()
    cell = arm_cells(plan, scene_of(plan, np.zeros((1, 3)), grip))[0]
    planner = CellPlanner(cell, arm, car, Search("rrt_connect_native", 20_000))
    planner.prepare()
    passing = Boxes.one(cell.dock_box[0], cell.dock_box[1], yaw=cell.dock_yaw)
    checker = CollisionChecker(arm.spheres, passing)
    ways = [way for (_, _, loaded), way in planner._known.ways.items() if not loaded]
    assert len(ways) == 2 * (len(cell.slots) + 1)
    assert min(checker.clearance(q) for way in ways for q in way.q) >= MARGIN_M - 1e-9
    # The box holds a car with the largest parcel, wherever it stands in the dock.
    x, y, yaw = plan.stations[0].dock.pose
    for along in (-0.3, 0.0, 0.3):
        world = np.array([x + along * np.cos(yaw), y + along * np.sin(yaw), car.tray_floor_z_m + 0.1])
        centre = cell.base_from_world(world) - cell.dock_box[0]
        across = -np.sin(cell.dock_yaw) * centre[0] + np.cos(cell.dock_yaw) * centre[1]
        assert abs(across) + car.half_width_m < cell.dock_box[1, 1]
        assert world[2] < 2 * cell.dock_box[1, 2]
