"""Benchmark of the driving: how far the physical car is from its lane and from its dock, against the true pose."""

from __future__ import annotations

import numpy as np

from benchmarks.harness import Benchmark, Kind, Row, Trial, main
from fleet.arrays import FloatArray
from fleet.config import ArmConfig, RunConfig
from fleet.missions.phases import CarPhase
from fleet.robots.angle import wrapped
from fleet.simulation import Simulation
from fleet.traffic.drivers import PathDriver


def measure(trial: Trial) -> list[Row]:
    """Drive deliveries on `small` and compare the true poses with the lanes and docks."""
    lateral, docking, turn, speeds = [], [], [], []
    for seed in trial.seeds:
        config = RunConfig(robots=3, seed=seed, arms=ArmConfig(workers_n=0))
        with Simulation(config) as simulation:
            before = list(simulation.missions.phase)
            while not simulation.finished:
                simulation.tick()
                lateral += _lateral(simulation)
                speeds.append(float(np.abs(simulation.world.car_speeds()).max()))
                for car, phase in enumerate(simulation.missions.phase):
                    if phase in (CarPhase.LOADING, CarPhase.UNLOADING) and before[car] is not phase:
                        offset = _dock_offset(simulation, car)
                        docking.append(offset[0])
                        turn.append(offset[1])
                before = list(simulation.missions.phase)
            summary = simulation.summary()
            trial.check(summary.tasks_done == summary.tasks_total, f"seed {seed}: not everything was delivered")
    return [
        Row(name="docking manoeuvres", value=len(docking), unit=""),
        Row(name="cross-track error, largest", value=float(np.max(lateral)), unit="m", target="<= 0.05"),
        Row(name="cross-track error, rms", value=float(np.sqrt(np.mean(np.square(lateral)))), unit="m"),
        Row(name="docking error, largest", value=float(np.max(docking)), unit="m", target="<= 0.03"),
        Row(name="docking error, median", value=float(np.median(docking)), unit="m"),
        Row(name="docking heading error, largest", value=float(np.degrees(np.max(turn))), unit="deg"),
        Row(name="speed, largest", value=float(np.max(speeds)), unit="m/s", kind=Kind.PLAIN, target=">= 0.95"),
    ]


def _lateral(simulation: Simulation) -> list[float]:
    """Distance of each moving car's true rear axle from the line it was granted [m]."""
    driver = simulation.driver
    if not isinstance(driver, PathDriver):
        raise TypeError("tracking is measured on a driver that follows paths")
    out = []
    poses, speeds = simulation.world.car_poses(), simulation.world.car_speeds()
    for car in np.flatnonzero(np.abs(speeds) > 0.05).tolist():
        points = driver.buffer.points[car, : driver.buffer.count[car], :2]
        out.append(_distance(points, poses[car, :2]))
    return out


def _distance(points: FloatArray, xy: FloatArray) -> float:
    """Distance from a point to a polyline [m]."""
    if len(points) < 2:
        return float(np.linalg.norm(points[0] - xy))
    a, d = points[:-1], np.diff(points, axis=0)
    length = np.maximum((d**2).sum(axis=1), 1e-12)
    u = np.clip(((xy - a) * d).sum(axis=1) / length, 0.0, 1.0)
    return float(np.linalg.norm(a + u[:, None] * d - xy, axis=1).min())


def _dock_offset(simulation: Simulation, car: int) -> tuple[float, float]:
    """Distance [m] and turn [rad] between a car that is about to be served and its dock's stop pose."""
    pose = simulation.world.car_poses()[car]
    docks = np.array([station.place.dock.pose for station in simulation.stations])
    dock = docks[np.argmin(np.hypot(docks[:, 0] - pose[0], docks[:, 1] - pose[1]))]
    turn = wrapped(pose[2] - dock[2])
    return float(np.hypot(*(pose[:2] - dock[:2]))), abs(turn)


BENCHMARK = Benchmark(
    name="tracking",
    summary="the physical car against its lane and its dock, noisy pose estimate, travel speed 1 m/s",
    measure=measure,
    seeds=(0, 1, 2, 3),
    quick_seeds=(0,),
)

if __name__ == "__main__":
    raise SystemExit(main(BENCHMARK))
