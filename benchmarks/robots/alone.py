"""Benchmark of robots by themselves: how exactly they drive, what an A1 carries and survives, what a step costs."""

from __future__ import annotations

import math
import time

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.proving.course import LANES
from fleet.proving.show import arrivals_apart
from fleet.proving.trial import TrialReport, drive, yaw_rate_error
from fleet.proving.vehicles import TICK_S, VEHICLES
from fleet.robots import CARS, CarModels
from fleet.robots.differential import SkidChassis
from fleet.robots.twist import TWIST_ROBOTS
from fleet.world.bullet.cars import Cars, CarSteps
from fleet.world.bullet.vehicles.floor import BareFloor, load_on_floor
from fleet.world.bullet.vehicles.legged import Legged
from fleet.world.bullet.vehicles.skid_steered import SkidSteered

LOAD_KG = 2.0
"""Of the parcel on the A1's back."""
PUSH_MPS = 0.8
_COUNTS = (2, 8)
"""Robots in a world; what one costs is told by the difference."""
_N_STEPS = 240
_N_REPEATS = 4
_CIRCLES = {"racecar": (0.2, 0.5), "husky": (0.4, 0.4), "a1": (0.4, 0.2)}
"""Command of each vehicle while its step is timed."""


def measure_alone(trial: Trial) -> list[Row]:
    """Drive every vehicle over its course, the A1 over lanes and through pushes, and time physics steps."""
    rows = [row for name in VEHICLES for row in _course(trial, name)]
    rows.append(
        Row(name="husky: yaw rate error", value=100 * yaw_rate_error(VEHICLES["husky"]), unit="%", target="<= 2")
    )
    return rows + _lanes(trial) + _pushes(trial) + _costs()


def _course(trial: Trial, name: str) -> list[Row]:
    vehicle = VEHICLES[name]
    physics, apart = [], []
    for seed in trial.seeds:
        report = drive(
            vehicle.physics(0.0, 1.0, np.random.default_rng(seed)),
            vehicle.control(np.random.default_rng(seed)),
            vehicle.course,
        )
        kinematic = drive(vehicle.kinematic(), vehicle.control(np.random.default_rng(seed)), vehicle.course)
        trial.check(report.arrived and kinematic.arrived, f"{name}, seed {seed}: did not arrive")
        trial.check(report.excess <= 1e-6, f"{name}, seed {seed}: a command was beyond its limits")
        physics.append(report)
        apart.append(arrivals_apart(report, kinematic))
    off = max(max(report.straight_m, report.curve_m, report.turn_m) for report in physics)
    return [
        Row(name=f"{name}: off its course, largest", value=off, unit="m", target=f"<= {vehicle.cross_track_m:g}"),
        Row(
            name=f"{name}: docking error, largest",
            value=max(report.dock_m for report in physics),
            unit="m",
            target="<= 0.03",
        ),
        Row(name=f"{name}: physics and model, arrivals apart", value=100 * max(apart), unit="%", target="<= 3"),
    ]


def _lanes(trial: Trial) -> list[Row]:
    reports: list[TrialReport] = []
    for seed in trial.seeds:
        rng = np.random.default_rng([7, seed])
        friction = float(rng.uniform(0.8, 1.0))
        vehicle = VEHICLES["a1"]
        reports.append(drive(vehicle.physics(LOAD_KG, friction, rng), vehicle.control(rng), LANES))
    slowest = min(LANES.way_m / report.time_s for report in reports)
    return [
        Row(name="a1, 50 m with 2 kg: falls", value=sum(r.fell for r in reports), unit="", target="<= 0"),
        Row(name="a1, 50 m with 2 kg: speed, least", value=slowest, unit="m/s", kind=Kind.PLAIN, target=">= 0.3"),
        Row(
            name="a1, 50 m with 2 kg: lean, largest",
            value=max(report.lean_rad for report in reports),
            unit="rad",
            target="<= 0.1",
        ),
    ]


def _pushes(trial: Trial) -> list[Row]:
    vehicle, up = VEHICLES["a1"], 0
    for seed in trial.seeds:
        rng = np.random.default_rng([8, seed])
        angle = float(rng.uniform(-math.pi, math.pi))
        pushed = (6.0, PUSH_MPS * math.cos(angle), PUSH_MPS * math.sin(angle))
        up += not drive(vehicle.physics(LOAD_KG, 1.0, rng), vehicle.control(rng), vehicle.course, pushed=pushed).fell
    share = 100.0 * up / len(trial.seeds)
    return [Row(name=f"a1, pushed by {PUSH_MPS:g} m/s: stays up", value=share, unit="%", target=">= 90")]


def _costs() -> list[Row]:
    step_s = {}
    for name in _CIRCLES:
        few, many = (min(_step_s(name, n) for _ in range(_N_REPEATS)) for n in _COUNTS)
        step_s[name] = (many - few) / (_COUNTS[1] - _COUNTS[0])
    return [
        Row(name="racecar: a physics step", value=1e6 * step_s["racecar"], unit="us", kind=Kind.TIME),
        Row(name="husky: of a racecar's step", value=step_s["husky"] / step_s["racecar"], unit="", target="<= 1.3"),
        Row(name="a1: of a racecar's step", value=step_s["a1"] / step_s["racecar"], unit="", target="<= 4"),
    ]


def _step_s(name: str, n_robots: int) -> float:
    """Processor time of a physics step with some robots that drive in circles, their commands and readings included."""
    floor = BareFloor()
    start = np.array([[3.0 * k, 0.0, 0.3] for k in range(n_robots)])
    robots: Cars | SkidSteered | Legged
    if name == "racecar":
        entry = CARS[name]
        models = CarModels.alike(entry.spec(), n_robots)
        robots = Cars(
            floor.client, models, start, (entry.urdf("sphere"),), CarSteps(length_s=floor.step_s, tick_s=TICK_S)
        )
    elif isinstance(chassis := TWIST_ROBOTS[name]().chassis, SkidChassis):
        robots = SkidSteered(floor.client, chassis, start)
    else:
        bodies = [load_on_floor(floor.client, chassis.description, pose) for pose in start]
        robots = Legged(floor.client, chassis, bodies, floor.step_s, TICK_S, np.random.default_rng(0))
    commands = np.tile(_CIRCLES[name], (n_robots, 1))
    n_per_tick = round(TICK_S / floor.step_s)
    try:
        began = time.process_time()
        for step in range(_N_STEPS):
            if step % n_per_tick == 0:
                robots.drive(commands)
            robots.before_step()
            floor.step()
            if step % n_per_tick == n_per_tick - 1:
                robots.reading()
        return (time.process_time() - began) / _N_STEPS
    finally:
        floor.close()
