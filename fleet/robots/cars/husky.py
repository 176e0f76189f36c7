"""Husky as a car of fleets; what it is and where its numbers come from stands in `fleet.robots.twist.husky`."""

from __future__ import annotations

from dataclasses import replace

from fleet.robots.differential import TwistFollowerConfig
from fleet.robots.model import CarEntry, WheelShape
from fleet.robots.spec import CarSpec, DriveKind
from fleet.robots.twist.car import twist_car
from fleet.robots.twist.husky import TRAY, WHEEL_RADIUS_M, body_boxes, husky_spec, husky_urdf, wheel_places


def _spec() -> CarSpec:
    """Give sizes, limits and drive; a standing one is held by its tyres with 0.9 of its weight."""
    own = husky_spec()
    (ahead, aside, _), _, (behind, _, _), _ = wheel_places().tolist()
    car = twist_car(
        own,
        DriveKind.DIFFERENTIAL,
        TwistFollowerConfig(),
        hold_force_n=round(0.9 * 9.81 * own.mass_kg, 0),
        rear_axle_m=behind,
        wheelbase_m=ahead - behind,
        track_m=2 * aside,
        wheel_radius_m=WHEEL_RADIUS_M,
        body_boxes=body_boxes(),
        tray_wall_m=TRAY.wall_m,
    )
    # One behind the other: arms on either side of a dock reach them, and tools have room beside what lies there.
    return replace(car, tray_places=((0.0, 0.0), (0.22, 0.0), (-0.22, 0.0)))


def _urdf(wheels: WheelShape) -> str:
    """Write its description; it rolls on spheres, whatever is asked for."""
    del wheels
    return husky_urdf()


ENTRY = CarEntry(spec=_spec, urdf=_urdf, sources=husky_spec().sources)
