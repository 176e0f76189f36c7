"""Palette: colours of the recording, as 0xRRGGBBAA integers."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

_GOLDEN = 0.6180339887498949
"""Fraction of the hue circle between consecutive ids: neighbours differ most (golden angle)."""

_CAR_STATES = {
    "driving loaded": 0x22C3E6FF,
    "driving empty": 0x3B82F6FF,
    "traffic": 0xF59E0BFF,
    "queue": 0x8B5CF6FF,
    "plan late": 0xFACC15FF,
    "served": 0x10B981FF,
    "visiting": 0xA3E635FF,
    "charging": 0x14B8A6FF,
    "fault": 0xEF4444FF,
    "idle": 0x6B7280FF,
}
"""The time accounts of cars; who waits has the colour of what it waits for, see `CAUSE_COLOURS`."""
_ARM_STATES = {
    "idle": 0x6B7280FF,
    "awaiting": 0xB98A45FF,
    "fault": 0xEF4444FF,
    "planning": 0xFACC15FF,
    "moving": 0x10B981FF,
    "holding": 0x22C3E6FF,
    "done": 0x166534FF,
    "missed": 0xF97316FF,
    "dropped": 0xEF4444FF,
}
_TASK_STATES = {
    "ordered": 0x4B5563FF,
    "backlog": 0x9CA3AFFF,
    "ready": 0xFACC15FF,
    "assigned": 0x3B82F6FF,
    "loading": 0x8B5CF6FF,
    "carried": 0x22C3E6FF,
    "unloading": 0xEC4899FF,
    "delivered": 0x22C55EFF,
    "collected": 0x166534FF,
    "visiting": 0xA3E635FF,
    "done": 0x166534FF,
    "failed": 0xEF4444FF,
    "cancelled": 0xA8A29EFF,
}
STATES_OF = {"cars": tuple(_CAR_STATES), "arms": tuple(_ARM_STATES), "tasks": tuple(_TASK_STATES)}
"""States that cars, arms and tasks are known to have."""
STATE_COLOURS = {
    **_CAR_STATES,
    **_ARM_STATES,
    **_TASK_STATES,
    "under way": 0x3B82F6FF,
    "failed, cancelled": 0xEF4444FF,
}
"""Colours of states and of groups of them; an unknown state gets a colour of its own from its name."""

BOX_COLOURS = {"wall": 0x64748BFF, "shelf": 0xA9835760, "pedestal": 0xB8C0CCFF, "stand": 0xB8C0CCFF}
BOX_DEFAULT = 0x808080FF
FLOOR = 0x2A2F38FF
LANE = 0x7B879AFF
PARKING = 0x3A4656FF
DOCK = 0x57534EFF
LABEL = 0x5B9BD5FF
"""Legible on the dark and on the light names of a viewer."""
RULER = 0x8A93A3FF


RAY, HIT = 0xFB718540, 0xFB7185FF
"""Rays of lidars, and what they hit."""
TREE = 0x34D399A0
"""What an arm's planner has looked at."""
WAIT = 0xF59E0BFF
"""Arrows from whoever waits to whom it waits for."""
CYCLE = 0xEF4444FF
"""Whoever waits in a circle."""
CAUSE_COLOURS = {
    "traffic": 0xF59E0BFF,
    "station": 0x8B5CF6FF,
    "blocked": 0xEF4444FF,
    "plan_late": 0xFACC15FF,
    "charging": 0x14B8A6FF,
}
"""Colours of the causes of standing still."""


def identity_colour(identity: int, *, value: float = 1.0, alpha: int = 255) -> int:
    """A colour that stays with an id for the whole run."""
    red, green, blue = colorsys.hsv_to_rgb((0.55 + identity * _GOLDEN) % 1.0, 0.55, value)
    return (int(red * 255) << 24) | (int(green * 255) << 16) | (int(blue * 255) << 8) | alpha


def identity_colours(identities: Iterable[int], *, value: float = 1.0, alpha: int = 255) -> npt.NDArray[np.uint32]:
    """Colours of several ids, shape (k,)."""
    return np.array([identity_colour(int(i), value=value, alpha=alpha) for i in identities], np.uint32)


def state_colour(state: str) -> int:
    """Colour of a state; the same name always gets the same colour."""
    known = STATE_COLOURS.get(state)
    return known if known is not None else identity_colour(sum(state.encode()), value=0.8)


def packed(rgba: tuple[float, float, float, float]) -> int:
    """Pack components in [0, 1] into one integer."""
    red, green, blue, alpha = (round(255 * min(1.0, max(0.0, c))) for c in rgba)
    return (red << 24) | (green << 16) | (blue << 8) | alpha


def cause_colour(cause: str) -> int:
    """Colour of a cause of standing still; the same name always gets the same colour."""
    known = CAUSE_COLOURS.get(cause)
    return known if known is not None else state_colour(cause)
