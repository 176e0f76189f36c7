"""Sheets: what each robot is, in figures with their sources."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

from fleet.errors import ConfigError
from fleet.robots import ARMS, CARS
from fleet.robots.standing import STANDING, StandingRobot
from fleet.robots.twist import TWIST_ROBOTS
from fleet.robots.twist.spec import TwistSpec
from maps.reading.near import hint

RobotKind = Literal["vehicle", "arm", "standing"]


@dataclass(frozen=True, kw_only=True)
class SheetFigure:
    """One number of a robot."""

    name: str
    value: str
    """With its unit."""
    source: str


@dataclass(frozen=True, kw_only=True)
class RobotSheet:
    """A robot in figures."""

    name: str
    kind: RobotKind
    drive: str
    footprint: str
    """Length x width x height [m], or the reach of an arm."""
    mass_kg: float
    payload_kg: float | None
    """None where the robot carries nothing here."""
    limits: str
    """The greatest speeds in a few words."""
    figures: tuple[SheetFigure, ...]


def robot_sheet(name: str) -> RobotSheet:
    """Look up a robot.

    Raises:
        ConfigError: There is none of this name.
    """
    if name not in SHEETS:
        valid = ", ".join(SHEETS)
        raise ConfigError(f"robot {name!r}{hint(name, list(SHEETS))}; valid: {valid}")
    return SHEETS[name]()


_UNITS = {
    "kg": "kg",
    "m": "m",
    "mps": "m/s",
    "mps2": "m/s²",
    "radps": "rad/s",
    "radps2": "rad/s²",
    "rad": "rad",
}


def _figure(field: str, value: float, source: str) -> SheetFigure:
    """A figure from a field's name, which ends with its unit."""
    words, _, unit = field.rpartition("_")
    return SheetFigure(name=words.replace("_", " "), value=f"{value:.4g} {_UNITS[unit]}", source=source)


def _car(name: str) -> RobotSheet:
    entry = CARS[name]
    spec = entry.spec()
    return RobotSheet(
        name=name,
        kind="vehicle",
        drive=spec.drive,
        footprint=_box(spec.front_m + spec.rear_m, 2 * spec.half_width_m, spec.height_m),
        mass_kg=spec.mass_kg,
        payload_kg=spec.max_payload_kg,
        limits=f"{spec.max_speed_mps:g} m/s, steering {spec.max_steering_rad:g} rad",
        figures=tuple(_figure(field, getattr(spec, field), source) for field, source in entry.sources.items()),
    )


def _twist(make: Callable[[], TwistSpec]) -> RobotSheet:
    spec = make()
    limits = {field.name: getattr(spec.limits, field.name) for field in fields(spec.limits)}
    numbers = {**vars(spec), **limits}
    return RobotSheet(
        name=spec.name,
        kind="vehicle",
        drive=spec.drive,
        footprint=_box(spec.front_m + spec.rear_m, 2 * spec.half_width_m, spec.height_m),
        mass_kg=spec.mass_kg,
        payload_kg=spec.max_payload_kg,
        limits=f"{spec.limits.max_speed_mps:g} m/s, {turning_radps(spec):.2g} rad/s",
        figures=tuple(_figure(field, numbers[field], source) for field, source in spec.sources.items()),
    )


def turning_radps(spec: TwistSpec) -> float:
    """How fast a robot may turn on the spot [rad/s]."""
    return min(spec.limits.max_yaw_rate_radps, spec.limits.max_rim_mps / spec.limits.lever_m)


def _arm(name: str) -> RobotSheet:
    kind = ARMS[name]
    least_m, most_m = kind.reach_m
    reach = f"{least_m:g} to {most_m:g}"
    mass = described_mass_kg(kind.urdf)
    described = f"{kind.urdf.parent.name}/{kind.urdf.name} in pybullet_data"
    speeds, torques = kind.max_velocity_radps, kind.max_torque_nm
    n = len(speeds)
    figures = (
        SheetFigure(name="joints", value=str(n), source=described),
        SheetFigure(name="mass", value=f"{mass:.4g} kg", source=described),
        SheetFigure(name="max payload", value=f"{kind.payload_kg:g} kg", source=kind.source),
        SheetFigure(name="serves from above", value=f"{reach} m away", source="searched here, with a tool"),
        SheetFigure(name="max speed", value=_range(speeds, "rad/s"), source=kind.source),
        SheetFigure(
            name="max acceleration",
            value=_range(kind.max_acceleration_radps2, "rad/s²"),
            source=kind.source,
        ),
        SheetFigure(name="max torque", value=_range(torques, "N m"), source=kind.source),
    )
    return RobotSheet(
        name=name,
        kind="arm",
        drive=f"{n} joints",
        footprint=f"serves {reach}",
        mass_kg=mass,
        payload_kg=kind.payload_kg,
        limits=_range(speeds, "rad/s"),
        figures=figures,
    )


def _stands(robot: StandingRobot) -> RobotSheet:
    described = f"{robot.path.parent.name}/{robot.path.name} in pybullet_data"
    mass = described_mass_kg(robot.path)
    here = "chosen here, so that it stands"
    return RobotSheet(
        name=robot.name,
        kind="standing",
        drive="legged",
        footprint="-",
        mass_kg=mass,
        payload_kg=None,
        limits=f"{robot.torque_nm:g} N m a joint",
        figures=(
            SheetFigure(name="maker", value=robot.maker, source=described),
            SheetFigure(name="mass", value=f"{mass:.4g} kg", source=described),
            SheetFigure(name="max torque", value=f"{robot.torque_nm:g} N m", source=f"{described}, or {here}"),
            SheetFigure(name="position gain", value=f"{robot.gains[0]:g}", source=here),
            SheetFigure(name="velocity gain", value=f"{robot.gains[1]:g}", source=here),
            SheetFigure(name="physics step", value=f"1/{1 / robot.step_s:.0f} s", source=here),
            SheetFigure(name="solver iterations", value=str(robot.n_iterations), source=here),
        ),
    )


def described_mass_kg(path: Path) -> float:
    """Sum of the masses of a description [kg]; links without one have none."""
    # Some comments of pybullet_data are no XML.
    text = path.read_text(encoding="utf-8", errors="replace")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError:
        root = ElementTree.fromstring(text[: text.index("</robot>") + len("</robot>")])
    return sum(float(mass.get("value", "0")) for mass in root.iter("mass"))


def _range(values: object, unit: str) -> str:
    numbers = [float(value) for value in values]  # type: ignore[attr-defined]
    low, high = min(numbers), max(numbers)
    return f"{low:.3g} {unit}" if math.isclose(low, high) else f"{low:.3g} to {high:.3g} {unit}"


def _box(length: float, width: float, height: float) -> str:
    return f"{length:.2f} x {width:.2f} x {height:.2f}"


SHEETS: dict[str, Callable[[], RobotSheet]] = {
    **{name: partial(_car, name) for name in CARS if name not in TWIST_ROBOTS},
    **{name: partial(_twist, spec) for name, spec in TWIST_ROBOTS.items()},
    **{name: partial(_arm, name) for name in ARMS},
    **{name: partial(_stands, robot) for name, robot in STANDING.items()},
}
"""A sheet of every robot, by name."""
