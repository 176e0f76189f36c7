"""Ways of an arm keep above the cars in its dock, and are looked for in more than one manner."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.config import Grip
from fleet.robots import ARMS
from fleet.robots.cars.racecar import racecar_spec
from fleet.robots.tools import TOOLS
from fleet.stations.arms import cell_planner
from fleet.stations.arms.arm_cell import ArmCell, arm_cells
from fleet.stations.arms.arm_spheres import planned_arm
from fleet.stations.arms.cell_planner import ATTEMPTS, HOME, MARGIN_M, N_VIAS, TRAY, CellPlanner, PlaceError
from fleet.stations.arms.search import Search
from fleet.world.site_scene import scene_of
from maps.site import load_site, site_from_plan
from planners.motion.collision.collision import Boxes, CollisionChecker
from planners.motion.problem import MotionResult
from planners.motion.status import MotionStatus

SHELF_BEHIND_THE_ARM = [
    "##########",
    "#........#",
    "#.K....K.#",
    "#........#",
    "#.P.=_AD.#",
    "#.A.==_..#",
    "#._......#",
    "##########",
]
"""A lane two cells behind the arm of drop_1 leaves the way from its third slot to the tray just the margin."""


def drop_cell(grip: Grip) -> ArmCell:
    site = site_from_plan(SHELF_BEHIND_THE_ARM, name="shelf")
    cells = arm_cells(site, scene_of(site, np.zeros((1, 3)), grip))
    return cells[[station.name for station in site.stations].index("drop_1")]


def planner_of(cell: ArmCell, grip: Grip, search: Search | None = None) -> CellPlanner:
    tool = TOOLS[grip]
    arm = planned_arm(ARMS["iiwa"].spec(tool))
    return CellPlanner(cell, arm, racecar_spec(), search or Search("rrt_connect_native", 20_000))


class Picky(Search):
    """Finds no way with a parcel to certain configurations."""

    def __init__(self, refused: list[np.ndarray]) -> None:
        super().__init__("rrt_connect_native", 20_000)
        self.refused, self.seen = refused, 0

    def way(self, checker, start, goals, *, seed=0):
        self.seen += 1
        if any(np.array_equal(goals[0], q) for q in self.refused):
            return MotionResult(path=np.empty((0, 7)), status=MotionStatus.NO_SOLUTION, iterations=1)
        return super().way(checker, start, goals, seed=seed)


@pytest.mark.parametrize("grip", list(Grip))
@pytest.mark.parametrize("site", ["cell", "small", "twin"])
def test_an_arm_without_a_parcel_keeps_above_the_cars_that_pass_its_dock(site, grip):
    plan, tool = load_site(site), TOOLS[grip]
    arm, car = planned_arm(ARMS["iiwa"].spec(tool)), racecar_spec()
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


def test_another_search_is_tried_where_a_timed_motion_comes_too_near(monkeypatch):
    cell = drop_cell(Grip.FRICTION)
    planner = planner_of(cell, Grip.FRICTION)
    planner.prepare()
    later = {key: attempt for key, attempt in planner._known.attempts.items() if attempt != ATTEMPTS[0]}
    assert set(later) == {(2, TRAY, True), (TRAY, 2, True)}
    for (_, _, loaded), way in planner._known.ways.items():
        assert planner._way_checker(loaded=loaded).batch(way.q).all()
    again = planner_of(cell, Grip.FRICTION)
    again.prepare()
    assert all(np.array_equal(way.q, again._known.ways[key].q) for key, way in planner._known.ways.items())
    monkeypatch.setattr(cell_planner, "ATTEMPTS", ATTEMPTS[:1])
    monkeypatch.setattr(cell_planner, "N_VIAS", 1)
    with pytest.raises(PlaceError, match="slot 3: no way from above slot 3 to the tray: a timed motion leaves"):
        planner_of(cell, Grip.FRICTION).prepare()


def test_the_next_via_point_is_tried_where_no_way_leads_from_the_best():
    cell = drop_cell(Grip.SUCTION)
    usual = planner_of(cell, Grip.SUCTION)
    usual.prepare()
    best = usual._known.vias[1]
    search = Picky([best])
    planner = planner_of(cell, Grip.SUCTION, search)
    planner.prepare()
    assert not np.array_equal(planner._known.vias[1], best)
    assert set(planner._known.ways) == set(usual._known.ways)
    assert np.array_equal(planner._known.ways[1, HOME, False].q[0], planner._known.vias[1])


def test_a_place_is_refused_after_so_many_via_points():
    cell = drop_cell(Grip.SUCTION)
    usual = planner_of(cell, Grip.SUCTION)
    usual.prepare()
    refused = list(usual._good_vias(0))
    assert len(refused) > N_VIAS
    search = Picky(refused)
    planner = planner_of(cell, Grip.SUCTION, search)
    with pytest.raises(PlaceError, match="slot 1: no way from above slot 1 to the tray"):
        planner.prepare()
    assert 0 not in planner._known.vias
    # Two ways between rest and tray, then one search over each via point.
    assert search.seen == 2 + N_VIAS
