"""Settings: what every dataclass of settings checks about itself."""

from __future__ import annotations

import math
from typing import TypeAlias

from fleet.errors import ConfigError
from maps.reading.shown import shown
from planners.settings import misfits

SettingValue: TypeAlias = bool | int | float | str
"""What a planner or an allocator can be told by name."""


def require(ok: bool, what: str, value: object, valid: str) -> None:
    """Refuse a setting outside its valid range.

    Args:
        ok: The verdict.
        what: Name of the setting as a user types it.
        value: The refused value.
        valid: Description of the valid choices.

    Raises:
        ConfigError: `ok` is False.
    """
    if not ok:
        raise ConfigError(f"{what} is {shown(value)}; valid: {valid}")


def positive(what: str, value: float) -> None:
    """Refuse a setting that is not a finite number above zero."""
    require(math.isfinite(value) and value > 0, what, value, "a number > 0")


def not_negative(what: str, value: float) -> None:
    """Refuse a setting that is not a finite number, zero or above."""
    require(math.isfinite(value) and value >= 0, what, value, "a number >= 0")


class Settings:
    """Fields that hold what is declared: 2.5 robots, or a text, would only be noticed in the middle of a run."""

    def __post_init__(self) -> None:
        for name, value, valid in misfits(type(self), vars(self)):
            require(False, f"{type(self).__name__}.{name}", value, valid)
