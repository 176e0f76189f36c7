"""Two arms over one tray, played without a world and judged by PyBullet: whatever happens, they never meet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pybullet
import pytest

from fleet.config import ArmConfig, Grip
from fleet.robots import ARMS
from fleet.robots.tools import TOOLS
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.stations.arms.arm_manager import ArmManager
from fleet.stations.arms.arm_planner import ArmSetup, LocalArmPlanner
from fleet.stations.arms.shared_dock import SharedDock, share_docks
from fleet.stations.arms.transfer import TRAY, FetchRequest, TransferRequest
from fleet.world.site_scene import scene_of
from maps.site import load_site

TICK_S = 0.05
SIZE_M = (0.07, 0.07, 0.07)
SITE = load_site("twin")
SCENE = scene_of(SITE, np.zeros((1, 3)), Grip.SUCTION)
TOOL = TOOLS["suction"]
PAIR = replace(SCENE, arms=SCENE.arms.part((0, 1)), arm_base=SCENE.arm_base[:2], arm_start=SCENE.arm_start[:2])


@pytest.fixture(scope="module")
def planner():
    setup = ArmSetup(
        cells=arm_cells(SITE, SCENE)[:2],
        names=("pick_1", "pick_2"),
        specs=SCENE.arms.specs[:2],
        planner="rrt_connect_native",
        n_iterations=20_000,
        confirm=False,
    )
    return LocalArmPlanner(setup)


@pytest.fixture(scope="module")
def referee(tmp_path_factory):
    """Distance of the two arms by the engine's own meshes, at most 0.2 m."""
    client = pybullet.connect(pybullet.DIRECT)
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(ARMS["iiwa"].text(TOOL))
    arms = [
        pybullet.loadURDF(
            str(path),
            pose[:3],
            pybullet.getQuaternionFromEuler((0, 0, pose[3])),
            useFixedBase=True,
            physicsClientId=client,
        )
        for pose in (station.arm.pose for station in SITE.stations[:2])
    ]

    def distance_m(q):
        for arm, angles in zip(arms, q, strict=True):
            positions = [[x] for x in angles]
            pybullet.resetJointStatesMultiDof(arm, list(range(7)), positions, physicsClientId=client)
        return min((p[8] for p in pybullet.getClosestPoints(*arms, distance=0.2, physicsClientId=client)), default=0.2)

    yield distance_m
    pybullet.disconnect(client)


class Cell:
    """Both arms of the site's pick dock, with a world that only knows what is held."""

    def __init__(self, planner, referee, *, shared=True):
        self.arm_manager = ArmManager(planner, ArmConfig(), PAIR, TICK_S)
        self.docks = share_docks(SITE, SCENE, self.arm_manager.services) if shared else ()
        self.held = np.array([-1, -1])
        self.least_m = np.inf
        self.now = 0
        self._referee = referee

    def request(self, arm, slot=0):
        x, y, z = SITE.stations[arm].slots[slot]
        return TransferRequest(
            arm=arm,
            parcel=arm,
            size_m=SIZE_M,
            pick_pose=np.array([x, y, z + SIZE_M[2] / 2, 0, 0, 0, 1]),
            pick_via=slot,
            place_via=TRAY,
            car_pose=np.array(SITE.stations[arm].dock.pose),
        )

    def unloading(self, arm, slot):
        """The way back: from the tray to a slot."""
        x, y = SITE.stations[arm].dock.tray_xy
        pose = np.array([x, y, SCENE.car.tray_floor_z_m + SIZE_M[2] / 2, 0, 0, 0, 1])
        return replace(self.request(arm, slot), pick_pose=pose, pick_via=TRAY, place_via=slot)

    def fetch(self, arm, slot=0):
        whole = self.request(arm, slot)
        self.arm_manager.fetch(
            FetchRequest(arm=arm, parcel=arm, size_m=SIZE_M, pick_pose=whole.pick_pose, pick_via=slot), self.now
        )

    def tick(self):
        self.arm_manager.tick(self.now, self.held)
        self.held = np.where(self.arm_manager.grip, np.where(self.held < 0, [0, 1], self.held), -1)
        self.least_m = min(self.least_m, self._referee(self.arm_manager.q))
        self.now += 1

    def run(self, until, limit=2000):
        while not until():
            self.tick()
            assert self.now < limit, [service.state for service in self.arm_manager.services]

    @property
    def idle(self):
        return self.arm_manager.is_idle(0) and self.arm_manager.is_idle(1)


def test_both_arms_load_one_tray_at_once(planner, referee):
    alone = Cell(planner, referee)
    alone.arm_manager.submit(alone.request(0), 0)
    alone.run(lambda: alone.idle)
    both = Cell(planner, referee)
    for arm in (0, 1):
        both.arm_manager.submit(both.request(arm), 0)
    both.run(lambda: both.idle)
    assert both.least_m > 0.015
    assert alone.now < both.now < 1.5 * alone.now
    # The referee would notice: without the dock the arms meet.
    blind = Cell(planner, referee, shared=False)
    for arm in (0, 1):
        blind.arm_manager.submit(blind.request(arm), 0)
    blind.run(lambda: blind.idle)
    assert blind.least_m < 0.0


def test_an_arm_whose_sibling_rests_never_waits_for_it(planner, referee):
    cell = Cell(planner, referee)
    cell.arm_manager.submit(cell.request(0), 0)
    said = set()
    while not said or not cell.idle:
        cell.tick()
        said.add(cell.arm_manager.services[0].waits_for)
    assert said == {-1}


def test_one_arm_fetches_while_the_other_has_the_tray(planner, referee):
    cell = Cell(planner, referee)
    cell.arm_manager.submit(cell.request(0), 0)
    cell.run(lambda: cell.docks[0].holder == 0)
    cell.fetch(1, slot=2)
    cell.run(lambda: cell.arm_manager.services[1].state is ArmPhase.HOLDING)
    assert cell.arm_manager.is_ready(1, parcel=1)
    assert not cell.arm_manager.is_ready(1, parcel=0)
    cell.arm_manager.submit(cell.request(1, slot=2), cell.now)
    cell.run(lambda: cell.idle)
    assert cell.docks[0].holder is None
    assert cell.least_m > 0.015


def test_a_fetched_parcel_can_be_put_back(planner, referee):
    cell = Cell(planner, referee)
    cell.fetch(1, slot=1)
    cell.run(lambda: cell.arm_manager.services[1].state is ArmPhase.HOLDING)
    down = cell.arm_manager.q[1].copy()
    cell.arm_manager.put_back(1)
    cell.run(lambda: cell.held[1] < 0)
    grasp = planner._planner(1)._motions.tip(cell.arm_manager.q[1])[:3, 3]
    assert grasp[2] < planner._planner(1)._motions.tip(down)[2, 3] - 0.1
    cell.run(lambda: cell.idle)
    np.testing.assert_allclose(cell.arm_manager.q[1], SCENE.arm_start[1], atol=1e-6)


def test_a_parcel_that_vanishes_from_the_grip_sends_the_arm_home(planner, referee):
    cell = Cell(planner, referee)
    cell.fetch(0)
    cell.run(lambda: cell.arm_manager.services[0].state is ArmPhase.HOLDING)
    cell.arm_manager.grip[0] = False
    cell.held[0] = -1
    cell.run(lambda: cell.idle)
    assert "dropped" in cell.arm_manager.reason(0)


@pytest.mark.parametrize("look", [True, False])
def test_an_arm_stops_when_the_one_ahead_of_it_slows_down(planner, referee, look, monkeypatch):
    if not look:
        monkeypatch.setattr(SharedDock, "look_again", lambda self, changed: None)
    cell = Cell(planner, referee)
    for arm in (0, 1):
        cell.arm_manager.submit(cell.request(arm), 0)
    first, second = cell.arm_manager.services
    cell.run(lambda: cell.docks[0].holder == 1 and second.under_way is not None)
    assert first.under_way is not None
    cell.arm_manager.slow(0, 0.02)
    assert second.paused == look
    cell.run(lambda: cell.idle, limit=3000)
    assert (cell.least_m > 0.015) == look


@pytest.mark.parametrize("unloads", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_arms_stay_apart_whatever_happens(planner, referee, seed, unloads):
    """Random starts, random changes of pace, parcels lost on the way."""
    rng = np.random.default_rng(seed)
    cell = Cell(planner, referee)
    left = [3, 3]
    while any(left) or not cell.idle:
        for arm in (0, 1):
            if left[arm] and cell.arm_manager.is_idle(arm) and rng.random() < 0.3:
                left[arm] -= 1
                ask = cell.unloading if unloads else cell.request
                cell.arm_manager.submit(ask(arm, int(rng.integers(4))), cell.now)
            if rng.random() < 0.01:
                cell.arm_manager.slow(arm, float(rng.choice([0.4, 0.7, 1.0])))
            if cell.held[arm] >= 0 and rng.random() < 0.01:
                cell.held[arm] = -1
                cell.arm_manager.grip[arm] = False
        cell.tick()
        assert cell.now < 3000  # nobody waits for ever
    assert cell.least_m > 0.0
