"""Versions of environments: to make one that has been replaced is refused, and the message names the new one."""

from __future__ import annotations

from typing import Any, NoReturn

from fleet.errors import ConfigError


class VersionError(ConfigError):
    """A version of an environment that is no longer there."""


class Replaced:
    """Stands where the maker of an environment was.

    Args:
        old: Name of the version, `traffic_v0`.
        new: Name of the one that took its place.
        because: What is different.
    """

    def __init__(self, old: str, new: str, because: str) -> None:
        self._message = f"{old} has been replaced, {because}; valid: {new}"

    def __call__(self, **settings: Any) -> NoReturn:
        """Refuse.

        Raises:
            VersionError: Always.
        """
        raise VersionError(self._message)
