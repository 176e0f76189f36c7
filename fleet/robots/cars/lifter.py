"""Lifter as a car of fleets, which carries pods and no parcels; see `fleet.robots.twist.lifter`."""

from __future__ import annotations

from dataclasses import replace

from fleet.robots.differential import TwistFollowerConfig
from fleet.robots.model import CarEntry, WheelShape
from fleet.robots.spec import CarSpec, DriveKind
from fleet.robots.twist.car import twist_car
from fleet.robots.twist.lifter import TRACK_M, WHEEL_RADIUS_M, WHEELBASE_M, body_boxes, lifter_spec, lifter_urdf
from fleet.robots.twist.pod import POD


def _spec() -> CarSpec:
    """Give sizes, limits and drive; a standing one is held by its wheels with 0.9 of its weight."""
    own = lifter_spec()
    car = twist_car(
        own,
        DriveKind.DIFFERENTIAL,
        TwistFollowerConfig(),
        hold_force_n=round(0.9 * 9.81 * own.mass_kg, 0),
        rear_axle_m=-WHEELBASE_M / 2,
        wheelbase_m=WHEELBASE_M,
        track_m=TRACK_M,
        wheel_radius_m=WHEEL_RADIUS_M,
        body_boxes=body_boxes(),
        tray_wall_m=0.0,
    )
    return replace(car, max_payload_kg=0.0, lifts=POD)


def _urdf(wheels: WheelShape) -> str:
    """Write its description; it rolls on spheres, whatever is asked for."""
    del wheels
    return lifter_urdf()


ENTRY = CarEntry(spec=_spec, urdf=_urdf, sources=lifter_spec().sources)
