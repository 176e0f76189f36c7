"""Entries of the tables `CARS` and `ARMS`: where the specification of a robot comes from, and a car's description."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from fleet.robots.spec import ArmSpec, CarSpec
from fleet.robots.tools import Tool

WheelShape = Literal["sphere", "cylinder"]


@dataclass(frozen=True, kw_only=True)
class CarEntry:
    """A car that worlds can load."""

    spec: Callable[[], CarSpec]
    urdf: Callable[[WheelShape], str]
    """URDF text for one collision shape of the wheels; links and joints are named as `CarSpec` says."""


@dataclass(frozen=True, kw_only=True)
class ArmEntry:
    """An arm that worlds can load with any tool."""

    spec: Callable[[Tool], ArmSpec]
