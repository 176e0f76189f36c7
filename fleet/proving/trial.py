"""Trial: one vehicle drives a course alone, and what came of it in figures."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fleet.proving.course import Course
from fleet.proving.vehicles import TICK_S, ProvenVehicle, VehicleBody, VehicleControl
from fleet.robots.twist.inertial import FALLEN_RAD

_MOST_S = 400.0
"""A vehicle that is not there after this time does not come any more [s]."""
_AT_REST_S = 1.0
"""A vehicle stands for this time at its dock before it is measured [s]."""
_STEADY_S = 4.0
_SETTLED_S = 1.5


@dataclass(frozen=True, kw_only=True)
class TrialReport:
    """Figures of one drive."""

    arrived: bool
    fell: bool
    time_s: float
    """From the start to the dock."""
    arrivals_s: tuple[float, ...]
    """At the end of each leg."""
    straight_m: float
    """Greatest distance from the course on straights."""
    curve_m: float
    """In curves."""
    turn_m: float
    """In turns on the spot."""
    dock_m: float
    """Distance from the end of the course, at rest."""
    dock_rad: float
    """Yaw beside that of the end."""
    lean_rad: float
    """Greatest roll or pitch."""
    excess: float
    """By what share of a limit commands were beyond it at most."""


def drive(
    body: VehicleBody,
    control: VehicleControl,
    course: Course,
    *,
    speed_cap_mps: float = math.inf,
    pushed: tuple[float, float, float] | None = None,
) -> TrialReport:
    """Let a vehicle drive a course from a stand to a stand.

    Args:
        body: The vehicle, at the origin; it is closed at the end.
        control: What steers it.
        course: The way.
        speed_cap_mps: Greatest speed.
        pushed: Time of a push [s] and the change of speed along x and y [m/s].
    """
    paths = course.paths()
    end_s = float(course.ends_s[-1])
    arrivals = np.full(len(course.legs), np.nan)
    off = {"straight": 0.0, "curve": 0.0, "turn": 0.0}
    lean = excess = 0.0
    arrived = fell = False
    rested = 0
    before = np.zeros(2)
    try:
        state = body.advance(before)
        tick = 0
        while not fell and rested < _AT_REST_S / TICK_S and tick * TICK_S < _MOST_S:
            if pushed is not None and tick == round(pushed[0] / TICK_S):
                body.push(*pushed[1:])
            command = control.command(state, paths, end_s, speed_cap_mps)
            excess = max(excess, control.excess(command, before))
            before = command
            state = body.advance(command)
            tick += 1
            progress = float(paths.progress[0])
            arrivals[np.isnan(arrivals) & (progress >= course.ends_s - 0.02)] = tick * TICK_S
            leg = course.legs[course.leg_at(progress)]
            off[leg.kind] = max(off[leg.kind], course.off(state.pose[:2], progress))
            lean = max(lean, float(np.abs(state.lean).max()))
            fell = lean > FALLEN_RAD
            still = control.standing() and progress >= end_s - 0.02
            rested = rested + 1 if still else 0
        arrived = rested > 0 and not fell
    finally:
        body.close()
    end = course.line[-1]
    turned = math.remainder(float(state.pose[2] - end[2]), 2.0 * math.pi)
    time_s = tick * TICK_S - (_AT_REST_S if arrived else 0.0)
    return TrialReport(
        arrived=arrived,
        fell=fell,
        time_s=time_s,
        arrivals_s=tuple(arrivals.tolist()),
        straight_m=off["straight"],
        curve_m=off["curve"],
        turn_m=off["turn"],
        dock_m=float(np.hypot(*(state.pose[:2] - end[:2]))),
        dock_rad=abs(turned),
        lean_rad=lean,
        excess=excess,
    )


def yaw_rate_error(vehicle: ProvenVehicle, *, load_kg: float = 0.0) -> float:
    """Greatest share by which the mean yaw rate of a vehicle in physics differs from a command that is held."""
    worst = 0.0
    for speed, rate in vehicle.steady:
        body = vehicle.physics(load_kg, 1.0, np.random.default_rng(0))
        try:
            yaws = []
            for tick in range(round(_STEADY_S / TICK_S)):
                share = min(1.0, tick * TICK_S)
                yaws.append(float(body.advance(share * np.array([speed, rate])).pose[2]))
        finally:
            body.close()
        turned = np.unwrap(yaws)[round(_SETTLED_S / TICK_S) :]
        got = (turned[-1] - turned[0]) / ((len(turned) - 1) * TICK_S)
        worst = max(worst, abs(float(got) / rate - 1.0))
    return worst
