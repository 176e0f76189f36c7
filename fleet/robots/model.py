"""Entries of the table `CARS`: where the specification of a car comes from, and its description."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from fleet.robots.spec import CarSpec

WheelShape = Literal["sphere", "cylinder"]


@dataclass(frozen=True, kw_only=True)
class CarEntry:
    """A car that worlds can load."""

    spec: Callable[[], CarSpec]
    urdf: Callable[[WheelShape], str]
    """URDF text for one collision shape of the wheels; links and joints are named as `CarSpec` says."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Where numbers of its specification come from, by the names of their fields."""
