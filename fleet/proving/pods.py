"""Pods: a carrier drives under a pod, lifts it, carries it over two sides of a square, sets it down and drives away."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.proving.course import Course, Leg
from fleet.proving.vehicles import TICK_S, PhysicalTwist, TwistControl
from fleet.robots.angle import rotation
from fleet.robots.twist import POD_CARRIER, TWIST_PROMISES, TWIST_ROBOTS
from fleet.robots.twist.pod import LIFT_S, POD, pod_urdf
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.vehicles.floor import load_on_floor
from fleet.world.bullet.vehicles.lift import CENTRE_S, Lift

_QUARTER_RAD = math.pi / 2
APPROACH_M, SIDE_M, AWAY_M = 2.0, 10.0, 1.5
COURSE = Course.of(
    (
        Leg(kind="straight", size=APPROACH_M),
        Leg(kind="straight", size=SIDE_M),
        Leg(kind="turn", size=_QUARTER_RAD),
        Leg(kind="straight", size=SIDE_M),
        Leg(kind="straight", size=AWAY_M),
    )
)
"""To the pod, twenty metres with it, and away from it."""
_UNDER, _THERE, _AWAY = 0, 3, 4
"""Legs at whose ends it stops."""
_LIFTED_S = LIFT_S + 1.0
_AT_REST_S = 0.5
_MOST_S = 200.0
_FEET = np.array(POD.half_m) * [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]
"""Corners of a pod, x, y [m]."""


@dataclass(frozen=True, kw_only=True)
class PodReport:
    """Figures of one carriage."""

    arrived: bool
    """Whether the carrier stood at the end of its way."""
    off_m: float
    """Distance of the pod from where it was to be set down."""
    off_rad: float
    """Its yaw beside that, without sign."""
    lifted_m: float
    """Least height of the pod's legs above the floor on the way."""
    n_touches: int
    """Ticks in which the pod touched the carrier beside its plate, or the floor on the way."""
    lean_rad: float
    """Greatest roll or pitch of the pod."""


def carry(seed: int) -> PodReport:
    """Let a carrier carry a pod, with noisy sensors.

    Args:
        seed: Of the sensors' errors.
    """
    rng = np.random.default_rng(seed)
    spec = TWIST_ROBOTS[POD_CARRIER]()
    vehicle = PhysicalTwist(spec, 0.0, 1.0, rng)
    try:
        return _Carriage(vehicle, TwistControl(spec, rng, TWIST_PROMISES[spec.name].follower)).run()
    finally:
        vehicle.close()


class _Carriage:
    """One carriage, from the first tick to the last."""

    def __init__(self, vehicle: PhysicalTwist, control: TwistControl) -> None:
        self._vehicle, self._control = vehicle, control
        self._client, body = vehicle.seen()
        self._pod = load_on_floor(self._client, pod_urdf(), _pose_at(_UNDER))
        self._lift = Lift(self._client, body)
        self._paths = COURSE.paths()
        self._state = vehicle.advance(np.zeros(2))
        self._ticks = self._n_touches = 0
        self._carried = False
        self._lifted_m, self._lean_rad = math.inf, 0.0

    def run(self) -> PodReport:
        """Go through all of it."""
        arrived = self._drive(_UNDER)
        self._lift.raise_()
        self._stand(_LIFTED_S)
        hold = self._lift.hold(self._pod)
        for n_left in range(round(CENTRE_S / TICK_S), 0, -1):
            hold = self._lift.centre(hold, (n_left - 1) / n_left)
            self._stand(TICK_S)
        self._carried = True
        arrived &= self._drive(_THERE)
        self._carried = False
        hold.end(self._client)
        self._lift.lower()
        self._stand(_LIFTED_S)
        arrived &= self._drive(_AWAY)
        pose, _, _ = _lying(self._client, self._pod)
        goal = _pose_at(_THERE)
        return PodReport(
            arrived=arrived,
            off_m=float(np.hypot(*(pose[:2] - goal[:2]))),
            off_rad=abs(math.remainder(float(pose[2] - goal[2]), 2 * math.pi)),
            lifted_m=self._lifted_m,
            n_touches=self._n_touches,
            lean_rad=self._lean_rad,
        )

    def _drive(self, leg: int) -> bool:
        """Drive to the end of a leg; returns whether it got there."""
        stop_s, rested = float(COURSE.ends_s[leg]), 0
        while rested < _AT_REST_S / TICK_S and self._ticks < _MOST_S / TICK_S:
            self._tick(self._control.command(self._state, self._paths, stop_s, math.inf))
            there = self._control.standing() and self._paths.progress[0] >= stop_s - 0.02
            rested = rested + 1 if there else 0
        return rested > 0

    def _stand(self, time_s: float) -> None:
        for _ in range(round(time_s / TICK_S)):
            self._tick(self._control.command(self._state, self._paths, float(self._paths.progress[0]), 0.0))

    def _tick(self, command: FloatArray) -> None:
        self._state = self._vehicle.advance(command)
        self._ticks += 1
        _, height_m, lean_rad = _lying(self._client, self._pod)
        self._lean_rad = max(self._lean_rad, lean_rad)
        touches = self._lift.touches(self._pod)
        if self._carried:
            self._lifted_m = min(self._lifted_m, height_m)
            touches |= height_m <= 0.0
        self._n_touches += touches


def _pose_at(leg: int) -> FloatArray:
    """Pose x, y, yaw at the end of a leg, shape (3,)."""
    return COURSE.line[int(np.searchsorted(COURSE.line_s, COURSE.ends_s[leg]))]


def _lying(client: Client, pod: int) -> tuple[FloatArray, float, float]:
    """Pose x, y, yaw of a pod, the least height of its feet [m], and how it leans [rad]."""
    place, quat = client.getBasePositionAndOrientation(pod)
    turn = rotation(np.array(quat))
    frame = np.array(place) - turn @ np.array(client.getDynamicsInfo(pod, -1)[3])
    feet = frame[2] + turn[2, :2] @ _FEET.T
    lean = math.acos(min(1.0, float(turn[2, 2])))
    return np.array([frame[0], frame[1], math.atan2(turn[1, 0], turn[0, 0])]), float(feet.min()), lean
