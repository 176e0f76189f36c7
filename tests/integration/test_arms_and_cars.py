"""Arms keep clear of the cars that pass their docks, as a referee of its own measures it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pybullet
import pytest

from fleet.config import ArmConfig, Fidelity, Grip, RunConfig
from fleet.missions.phases import CarPhase
from fleet.robots import ARMS
from fleet.robots.tools import TOOLS
from fleet.simulation import Simulation

MARGIN_M = 0.10
"""What is asked for: several times the errors with which cars follow their lanes and arms their set-points."""
FAR_M = 0.3
EVERY = 2
"""Ticks between two looks."""


class Referee:
    """The robots of a run as PyBullet's shapes: arms as meshes, cars and parcels as boxes."""

    def __init__(self, simulation: Simulation, folder: Path) -> None:
        self._simulation = simulation
        self._client = pybullet.connect(pybullet.DIRECT)
        path = folder / "arm.urdf"
        path.write_text(ARMS["iiwa"].text(TOOLS["suction"]))
        scene = simulation.scene
        self._arms = [
            pybullet.loadURDF(
                str(path),
                base[:3].tolist(),
                pybullet.getQuaternionFromEuler((0, 0, base[3])),
                useFixedBase=True,
                physicsClientId=self._client,
            )
            for base in scene.arm_base
        ]
        car = scene.car
        half = ((car.front_m + car.rear_m) / 2, car.half_width_m, car.height_m / 2)
        self._ahead_m, self._height_m = (car.front_m - car.rear_m) / 2, car.height_m
        self._cars = [self._box(half) for _ in scene.car_start]
        self._parcels: dict[int, int] = {}
        self.least_m = self.least_served_m = FAR_M
        self.where = ""

    def look(self) -> None:
        """Measure every arm against every car that it does not serve just now."""
        simulation, world = self._simulation, self._simulation.world
        poses, held = world.car_poses(), world.held()
        for body, (x, y, yaw) in zip(self._cars, poses, strict=True):
            place = (x + self._ahead_m * np.cos(yaw), y + self._ahead_m * np.sin(yaw), self._height_m / 2)
            self._move(body, place, (0, 0, np.sin(yaw / 2), np.cos(yaw / 2)))
        for parcel, pose in zip(world.parcel_ids().tolist(), world.parcel_poses(), strict=True):
            if parcel not in self._parcels:
                size = simulation.board.tasks[parcel].order.size_m
                self._parcels[parcel] = self._box(tuple(edge / 2 for edge in size))
            self._move(self._parcels[parcel], pose[:3], pose[3:])
        for arm, q in enumerate(world.arm_positions()):
            body = self._arms[arm]
            joints = [[angle] for angle in q]
            pybullet.resetJointStatesMultiDof(body, list(range(7)), joints, physicsClientId=self._client)
            parts = [body] + ([self._parcels[held[arm]]] if held[arm] >= 0 else [])
            base = simulation.scene.arm_base[arm, :2]
            for car in np.flatnonzero(np.hypot(*(poses[:, :2] - base).T) < 2.0).tolist():
                stands = simulation.missions.phase[car] in (CarPhase.LOADING, CarPhase.UNLOADING)
                others = [self._cars[car], *self._load(car)]
                distance_m = min(self._distance_m(part, other) for part in parts for other in others)
                if stands and simulation.missions.served[arm] == car:
                    self.least_served_m = min(self.least_served_m, distance_m)
                elif distance_m < self.least_m:
                    self.least_m, self.where = distance_m, f"arm_{arm} and car_{car} at {simulation.sim_s:.2f} s"

    def close(self) -> None:
        pybullet.disconnect(self._client)

    def _load(self, car: int) -> Iterator[int]:
        """The parcel that rides in a car."""
        task = self._simulation.missions.task_of[car]
        if task is not None and self._simulation.missions.loaded[car] and task.parcel in self._parcels:
            yield self._parcels[task.parcel]

    def _distance_m(self, a: int, b: int) -> float:
        points = pybullet.getClosestPoints(a, b, distance=FAR_M, physicsClientId=self._client)
        return min((point[8] for point in points), default=FAR_M)

    def _box(self, half: tuple[float, ...]) -> int:
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=self._client)
        body: int = pybullet.createMultiBody(baseMass=1.0, baseCollisionShapeIndex=shape, physicsClientId=self._client)
        return body

    def _move(self, body: int, place: object, quat_xyzw: object) -> None:
        pybullet.resetBasePositionAndOrientation(body, place, quat_xyzw, physicsClientId=self._client)


@pytest.mark.parametrize(
    ("site", "fidelity", "robots", "tasks"),
    [
        ("cell", Fidelity.KINEMATIC, 3, 10),
        ("small", Fidelity.KINEMATIC, 8, 30),
        ("twin", Fidelity.KINEMATIC, 8, 40),
        pytest.param("twin", Fidelity.PHYSICS, 4, 6, marks=[pytest.mark.bullet, pytest.mark.slow]),
    ],
)
def test_arms_keep_clear_of_passing_cars(site, fidelity, robots, tasks, tmp_path) -> None:
    config = RunConfig(
        site=site,
        fidelity=fidelity,
        robots=robots,
        tasks=tasks,
        grip=Grip.SUCTION,
        arms=ArmConfig(workers_n=0, planner="rrt_connect_native"),
    )
    with Simulation(config) as simulation:
        referee = Referee(simulation, tmp_path)
        try:
            while not simulation.finished:
                simulation.tick()
                if simulation.now % EVERY == 0:
                    referee.look()
        finally:
            referee.close()
    assert simulation.board.finished
    assert MARGIN_M < referee.least_m < FAR_M, referee.where
    # It sees arms that are near cars: those that reach into the tray before them.
    assert referee.least_served_m < 0.01
