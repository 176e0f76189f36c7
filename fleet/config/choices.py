"""Choices: settings that take one of a few words."""

from __future__ import annotations

from enum import StrEnum
from typing import Literal, get_args


class Fidelity(StrEnum):
    """How robots are moved."""

    PHYSICS = "physics"
    MIXED = "mixed"
    """Physics where arms work, kinematic elsewhere."""
    KINEMATIC = "kinematic"
    GRID = "grid"
    """Cars step from cell to cell; arms move as they do without physics."""
    ABSTRACT = "abstract"
    """The same cars in timesteps of a second, and arms that are nothing but the time that they take."""

    @property
    def has_contact(self) -> bool:
        """Whether arms and parcels have bodies, mass and contact."""
        return self in (Fidelity.PHYSICS, Fidelity.MIXED)


WholeFidelity = Literal[Fidelity.PHYSICS, Fidelity.MIXED, Fidelity.KINEMATIC, Fidelity.GRID]
"""Those of whole runs, in which robots have places, causes and events."""
WHOLE: tuple[Fidelity, ...] = get_args(WholeFidelity)


class Grip(StrEnum):
    """How an arm holds a parcel."""

    SUCTION = "suction"
    FRICTION = "friction"


class Perception(StrEnum):
    """How it is known where a parcel lies that an arm is to pick."""

    TRUTH = "truth"
    """From the world itself."""
    CAMERA = "camera"
    """From an image of the station's camera."""


class Connect(StrEnum):
    """How the physics engine is reached."""

    DIRECT = "DIRECT"
    GUI = "GUI"
    SHARED_MEMORY = "SHARED_MEMORY"


class StreamKind(StrEnum):
    """How generated orders arrive, and how they spread over the stations."""

    POISSON = "poisson"
    """One by one at a mean rate, all stations alike."""
    WAVES = "waves"
    """Many at once, then none for a while, at the same mean rate."""
    SKEWED = "skewed"
    """As `poisson`; few stations get most orders."""
    SKEWED_WAVES = "skewed_waves"
