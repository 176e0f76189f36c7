"""A1 as a car of fleets; what it is and where its numbers come from stands in `fleet.robots.twist.a1`."""

from __future__ import annotations

from dataclasses import replace

from fleet.robots.model import CarEntry, WheelShape
from fleet.robots.spec import CarSpec, DriveKind
from fleet.robots.twist.a1 import A1_FOLLOWER, TOE_RADIUS_M, TRAY, TROT, a1_spec, a1_urdf, body_boxes
from fleet.robots.twist.car import twist_car


def _spec() -> CarSpec:
    """Give sizes, limits and drive; its feet are told as wheels are, and it stands by them without a brake."""
    car = twist_car(
        a1_spec(),
        DriveKind.LEGGED,
        A1_FOLLOWER,
        hold_force_n=0.0,
        rear_axle_m=-TROT.foot_x_m,
        wheelbase_m=2 * TROT.foot_x_m,
        track_m=2 * TROT.foot_y_m,
        wheel_radius_m=TOE_RADIUS_M,
        body_boxes=body_boxes(),
        tray_wall_m=TRAY.wall_m,
    )
    # A cycle and a third, in which all feet come home.
    return replace(car, settle_s=round(4 / 3 / TROT.frequency_hz, 2))


def _urdf(wheels: WheelShape) -> str:
    """Write its description; it has no wheels, whatever is asked for."""
    del wheels
    return a1_urdf()


ENTRY = CarEntry(spec=_spec, urdf=_urdf, sources=a1_spec().sources)
