"""Arms that pick where the station's camera sees the parcel, and what becomes of a camera that does not see it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, Grip, RunConfig
from fleet.errors import ConfigError
from fleet.missions.parcels.perception import SeenPoses, Sighting
from fleet.robots.cars.racecar import racecar_spec
from fleet.simulation import Simulation
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.stations.arms.transfer import FetchRequest, TransferRequest
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Delivery
from fleet.world.bullet.world import BulletWorld
from fleet.world.protocol import ParcelBody
from fleet.world.site_scene import scene_of
from maps.site import load_site

pytestmark = pytest.mark.bullet

SIZE_M = (0.06, 0.05, 0.08)
SEEING = RunConfig(
    site="cell", robots=1, tasks=1, perception="camera", askew=True, duration_s=120.0, arms=ArmConfig(workers_n=0)
)  # type: ignore[arg-type]


class KnownPose:
    """In place of the stock: the pose of the one parcel."""

    def __init__(self, world: BulletWorld) -> None:
        self._world = world

    def pose(self, task: Task) -> np.ndarray:
        return self._world.parcel_poses()[0]


class Rig:
    """The cell's pick station with a parcel on a slot, its camera, and what it tells the log."""

    def __init__(self) -> None:
        site = load_site("cell")
        self.place = next(place for place in site.stations if place.kind == "pick")
        self.world = BulletWorld(scene_of(site, np.zeros((0, 3)), Grip.SUCTION))
        self.said: list[tuple[str, dict]] = []
        stations = [Station(arm, place, 0) for arm, place in enumerate(site.stations)]
        self.station = stations[site.stations.index(self.place)]
        log = lambda kind, **facts: self.said.append((kind, facts))  # noqa: E731
        self.eye = SeenPoses(stations, racecar_spec(), self.world, KnownPose(self.world), log)  # type: ignore[arg-type]
        order = Delivery(name="a", release_s=0.0, pick=self.place.name, drop="drop_1", mass_kg=0.2, size_m=SIZE_M)
        self.task = Task(index=0, order=order)

    def put(self, x: float, y: float, z: float, yaw: float = 0.4) -> None:
        if len(self.world.parcel_ids()):
            self.world.remove_parcel(0)
        pose = np.array([x, y, z, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)])
        self.world.add_parcel(ParcelBody(parcel=0, size_m=SIZE_M, mass_kg=0.2, pose=pose))

    def find(self) -> Sighting:
        return self.eye.find(self.task, self.station)


@pytest.fixture(scope="module")
def rig() -> Iterator[Rig]:
    rig = Rig()
    yield rig
    rig.world.close()


@pytest.mark.parametrize("slot", range(4))
def test_a_parcel_on_any_slot_is_located(rig: Rig, slot: int) -> None:
    x, y, z = rig.place.slots[slot]
    rig.put(x + 0.015, y - 0.015, z + SIZE_M[2] / 2)
    seen = rig.find()
    assert seen.reason == ""
    assert np.linalg.norm(seen.pose[:3] - rig.world.parcel_poses()[0, :3]) < 1e-3
    assert seen.size_m == (0.06, 0.05, 0.08)
    error = rig.eye.errors[-1]
    assert error.distance_m == pytest.approx(np.linalg.norm(seen.pose[:3] - rig.world.parcel_poses()[0, :3]))
    assert error.turn_rad < math.radians(1.5)
    assert rig.said[-1][0] == "parcel_located"
    assert rig.eye.looks[rig.place.name].parcel.max() == 0


def test_a_camera_that_sees_nothing_says_so(rig: Rig) -> None:
    x, y, z = rig.place.slots[0]
    rig.put(x + 3.0, y, z)
    before = rig.eye.n_blind
    assert rig.find().reason == f"camera_{rig.place.name} sees no part of the parcel"
    assert rig.eye.n_blind == before + 1
    assert rig.said[-1][0] == "parcel_not_located"


@pytest.mark.parametrize(("aside_m", "reason"), [(0.0, "sees no part of the parcel"), (0.05, "sees the parcel partly")])
def test_what_hides_a_parcel_is_told(rig: Rig, aside_m: float, reason: str) -> None:
    x, y, z = rig.place.slots[0]
    rig.put(x, y, z + SIZE_M[2] / 2, yaw=0.0)
    rig.world.add_obstacle(1, np.array([x, y + aside_m, z + 0.15]), np.array([0.2, 0.05, 0.005]))
    try:
        assert reason in rig.find().reason
    finally:
        rig.world.remove_obstacle(1)


def test_something_else_than_the_parcel_is_told(rig: Rig) -> None:
    x, y, z = rig.place.slots[0]
    rig.put(x, y, z + SIZE_M[2] / 2)
    rig.task = Task(index=0, order=replace(rig.task.delivery, size_m=(0.09, 0.09, 0.09)))
    try:
        assert "none of the parcel's" in rig.find().reason
    finally:
        rig.task = Task(index=0, order=replace(rig.task.delivery, size_m=SIZE_M))


def test_parcels_are_delivered_by_what_cameras_see() -> None:
    with Simulation(SEEING) as simulation:
        asked: list[tuple[np.ndarray, np.ndarray]] = []
        manager, inventory = simulation.arm_manager, simulation.view.inventory
        fetch, submit = manager.fetch, manager.submit

        def noted_fetch(request: FetchRequest, tick: int) -> None:
            asked.append((request.pick_pose, inventory.pose(simulation.board.tasks[request.parcel])))
            fetch(request, tick)

        def noted(request: TransferRequest, tick: int) -> None:
            if manager.services[request.arm].state is not ArmPhase.HOLDING:
                asked.append((request.pick_pose, inventory.pose(simulation.board.tasks[request.parcel])))
            submit(request, tick)

        manager.fetch = noted_fetch  # type: ignore[method-assign]
        manager.submit = noted  # type: ignore[method-assign]
        simulation.run()
        summary = simulation.summary()
    assert (summary.tasks_done, summary.tasks_failed, summary.parcels_misplaced) == (1, 0, 0)
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)
    assert (summary.parcels_located, summary.looks_failed) == (2, 0)
    assert summary.pose_error_max_mm is not None
    apart_mm = [1000 * np.linalg.norm(seen[:3] - true[:3]) for seen, true in asked]
    # What the arm is told is what was seen, not the truth.
    assert 0 < min(apart_mm) <= max(apart_mm) == pytest.approx(summary.pose_error_max_mm, abs=1e-3)
    assert max(apart_mm) < 2.0


def test_the_same_seed_sees_and_does_the_same() -> None:
    hashes, errors = [], []
    for _ in range(2):
        with Simulation(replace(SEEING, duration_s=10.0)) as simulation:
            simulation.run()
            hashes.append(simulation.state_hash())
            errors.append(simulation.view.perception.errors)
    assert hashes[0] == hashes[1]
    assert errors[0] == errors[1]
    assert len(errors[0]) == 1


@pytest.mark.parametrize("fault", ["covered", "out of reach"])
def test_a_parcel_that_is_not_found_ends_in_a_reason(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with Simulation(SEEING) as simulation:
        if fault == "covered":
            slots = next(place for place in simulation.site.stations if place.kind == "pick").slots
            plate = np.array([*slots[:, :2].mean(axis=0), 1.6]), np.array([0.8, 0.8, 0.01])
            simulation.world.add_obstacle(7, *plate)
        else:
            find = SeenPoses.find
            away = np.array([0.0, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
            monkeypatch.setattr(
                SeenPoses, "find", lambda eye, *what: replace(find(eye, *what), pose=find(eye, *what).pose + away)
            )
        simulation.run()
        task, summary = simulation.board.tasks[0], simulation.summary()
    assert task.state is TaskState.FAILED
    assert ("camera_pick_1 sees no part of the parcel" in task.reason) == (fault == "covered")
    assert "parcel lies at" in task.reason
    assert summary.looks_failed == (5 if fault == "covered" else 0), "two before the car was there, and three then"
    assert summary.sim_s < 60


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, Fidelity.GRID])
def test_a_world_without_bodies_is_refused(fidelity: Fidelity) -> None:
    with pytest.raises(ConfigError, match=r"--perception is 'camera'; valid: truth, or camera with --fidelity physics"):
        RunConfig(perception="camera", fidelity=fidelity)  # type: ignore[arg-type]


def test_parcels_lie_anyhow_in_any_world() -> None:
    config = replace(SEEING, perception="truth", fidelity=Fidelity.KINEMATIC)  # type: ignore[arg-type]
    with Simulation(config) as simulation:
        while not len(simulation.world.parcel_ids()):
            simulation.tick()
        pose = simulation.world.parcel_poses()[0]
        station = next(station for station in simulation.stations if station.name == simulation.board.tasks[0].pick)
        aside = pose[:2] - station.place.slots[simulation.board.tasks[0].pick_slot or 0][:2]
        assert 0 < np.abs(aside).max() <= 0.015
        assert abs(pose[5]) > 1e-3
        simulation.run()
        assert simulation.summary().tasks_done == 1
