"""Show: a robot by itself: a picture of it, and what came of its loop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.errors import ConfigError
from fleet.proving.course import LANES, Course
from fleet.proving.joint_loop import JointLoop
from fleet.proving.sheets import RobotSheet
from fleet.proving.trial import TrialReport, drive, yaw_rate_error
from fleet.proving.vehicles import VEHICLES, PhysicalVehicle, VehicleControl
from fleet.robots.standing import STANDING
from fleet.world.bullet.vehicles.portrait import portrait
from fleet.world.bullet.vehicles.standing import Standing

BACK_TO = np.array([-0.3, 0.6, 0.3])
"""Where a pushed robot's lane is, from the robot: x, y, yaw [m, rad]."""
_PUSHED_AT_S = 6.0
STAND_S = 10.0
PUSH_NS = 3.0
Rows = tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """What is to be seen of a robot."""

    picture: npt.NDArray[np.uint8]
    """Colours, shape (height, width, 3)."""
    figures: Rows
    """Name and value with its unit."""
    ok: bool
    """Whether it drove, or stood, as it should."""


@dataclass(frozen=True, kw_only=True)
class ShowConfig:
    """What a vehicle is to do."""

    seed: int = 0
    """Of its sensors' errors."""
    load_kg: float = 0.0
    """Of a parcel in its tray."""
    lanes: bool = False
    """Fifty metres of lanes instead of its course."""
    push_mps: float = 0.0
    """By how much a push changes its speed on the way, in a direction that the seed says."""


def show(sheet: RobotSheet, config: ShowConfig) -> Shown:
    """Let a robot do what it can, alone.

    Raises:
        ConfigError: It is to drive lanes and cannot turn on the spot.
    """
    if sheet.kind == "vehicle":
        return _vehicle(sheet.name, config)
    if sheet.kind == "arm":
        return _arm(sheet.name)
    return _standing(sheet.name)


def _vehicle(name: str, config: ShowConfig) -> Shown:
    vehicle = VEHICLES[name]
    if config.lanes and not vehicle.turns:
        valid = ", ".join(each for each in VEHICLES if VEHICLES[each].turns)
        raise ConfigError(f"--lanes with {name}, which cannot turn on the spot; valid: {valid}")
    posing = _physics(name, config)
    try:
        for _ in range(20):
            posing.advance(np.zeros(2))
        picture = portrait(*posing.seen())
    finally:
        posing.close()
    course = LANES if config.lanes else vehicle.course
    pushed = None
    if config.push_mps:
        angle = np.random.default_rng(config.seed).uniform(-math.pi, math.pi)
        pushed = (_PUSHED_AT_S, config.push_mps * math.cos(angle), config.push_mps * math.sin(angle))
    physics = drive(_physics(name, config), _control(name, config), course, pushed=pushed)
    kinematic = drive(vehicle.kinematic(), _control(name, config), course)
    rows = [
        ("way driven", f"{course.way_m:.1f} m, to the dock" if physics.arrived else "no: it did not arrive"),
        ("fell", "yes" if physics.fell else "no"),
        ("time, physics", f"{physics.time_s:.2f} s"),
        ("time, kinematic", f"{kinematic.time_s:.2f} s"),
        ("arrivals apart", f"{100 * arrivals_apart(physics, kinematic):.1f} % at most"),
        ("mean speed", f"{course.way_m / physics.time_s:.2f} m/s"),
        ("off the course, straights", _mm(physics.straight_m)),
        ("off the course, curves", _mm(physics.curve_m)),
        ("off the course, turns on the spot", _mm(physics.turn_m)),
        ("docking error", f"{_mm(physics.dock_m)}, {math.degrees(physics.dock_rad):.1f} degrees"),
        ("greatest lean", f"{physics.lean_rad:.3f} rad"),
        ("commands beyond limits", f"{100 * physics.excess:.1f} %"),
    ]
    if vehicle.turns:
        back = drive(_physics(name, config), _control(name, config), Course.back_to(BACK_TO))
        rows.append(("back to a lane 0.6 m beside it", f"{back.time_s:.1f} s, {_mm(back.dock_m)} off"))
        rows.append(("yaw rate error, commands held", f"{100 * yaw_rate_error(vehicle, load_kg=config.load_kg):.1f} %"))
    return Shown(picture=picture, figures=tuple(rows), ok=physics.arrived and kinematic.arrived)


def _physics(name: str, config: ShowConfig) -> PhysicalVehicle:
    return VEHICLES[name].physics(config.load_kg, 1.0, np.random.default_rng(config.seed))


def _control(name: str, config: ShowConfig) -> VehicleControl:
    return VEHICLES[name].control(np.random.default_rng(config.seed))


def arrivals_apart(one: TrialReport, other: TrialReport) -> float:
    """Greatest share by which the arrivals at the ends of legs differ, of the other's time."""
    a, b = np.array(one.arrivals_s), np.array(other.arrivals_s)
    return float(np.abs(a / b - 1.0).max())


def _arm(name: str) -> Shown:
    loop = JointLoop(name)
    try:
        picture = portrait(loop.bench.client, loop.bench.body)
        report = loop.run()
    finally:
        loop.close()
    rows = (
        ("joints swung", f"{report.time_s:.0f} s"),
        ("greatest speed", f"{100 * report.speed_share:.0f} % of its limit"),
        ("error, root mean square", f"{1000 * report.rms_rad:.2f} mrad"),
        ("greatest error", f"{1000 * report.worst_rad:.2f} mrad"),
    )
    return Shown(picture=picture, figures=rows, ok=True)


def _standing(name: str) -> Shown:
    reports = []
    for push in (None, np.array([PUSH_NS, 0.0])):
        standing = Standing(STANDING[name])
        try:
            if push is None:
                picture = portrait(standing.client, standing.body)
            reports.append(standing.run(STAND_S, push))
        finally:
            standing.close()
    quiet, pushed = reports
    rows = (
        (f"stands {STAND_S:g} s", "yes" if quiet.stands else "no"),
        ("height of its base", f"{quiet.height_m:.3f} m"),
        ("drift", _mm(quiet.drift_m)),
        ("greatest lean", f"{quiet.lean_rad:.4f} rad"),
        (f"stands after a push of {PUSH_NS:g} N s", "yes" if pushed.stands else "no"),
        ("drift with the push", _mm(pushed.drift_m)),
    )
    return Shown(picture=picture, figures=rows, ok=quiet.stands)


def _mm(length_m: float) -> str:
    return f"{1000 * length_m:.1f} mm"
