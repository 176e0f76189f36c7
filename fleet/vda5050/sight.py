"""Sight: what a vehicle measures of itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

_MOST_RAD = 3.1415
"""Greatest angle of so many digits that is at most pi: schemas of 2.0 refuse 3.1416."""


@dataclass(frozen=True, kw_only=True)
class CarriedLoad:
    """What lies on a vehicle."""

    id: str
    type: str
    weight_kg: float

    def body(self) -> dict[str, Any]:
        """As the state message has it."""
        return {"loadId": self.id, "loadType": self.type, "weight": self.weight_kg}


@dataclass(frozen=True, kw_only=True)
class Sight:
    """What a vehicle measures of itself at one moment."""

    x: float
    y: float
    theta: float
    """Where it is [m, rad]; theta from -pi to pi."""
    map_id: str
    speed_mps: float
    """Along its own axis."""
    turn_radps: float
    driving: bool
    charge_percent: float
    charging: bool
    loads: tuple[CarriedLoad, ...] = ()
    way: Callable[[], Sequence[tuple[float, float]]] = tuple
    """Gives points of the way that it is about to drive [m], at least two, or none; asked for a state only."""

    def position(self) -> dict[str, Any]:
        """As state and visualization have it."""
        return {
            "x": round(self.x, 4),
            "y": round(self.y, 4),
            "theta": min(_MOST_RAD, max(-_MOST_RAD, round(self.theta, 4))),
            "mapId": self.map_id,
            "localized": True,
        }

    def velocity(self) -> dict[str, Any]:
        """As state and visualization have it."""
        return {"vx": round(self.speed_mps, 4), "vy": 0.0, "omega": round(self.turn_radps, 4)}

    def planned_path(self) -> dict[str, Any]:
        """The field `plannedPath`: a polyline, which is a spline of degree 1; empty without a way."""
        path = self.way()
        n = len(path)
        if n < 2:
            return {}
        # A clamped uniform knot vector of n + 2 values.
        knots = [0.0, *(k / (n - 1) for k in range(n)), 1.0]
        points = [{"x": round(x, 3), "y": round(y, 3)} for x, y in path]
        return {"plannedPath": {"trajectory": {"degree": 1, "knotVector": knots, "controlPoints": points}}}
