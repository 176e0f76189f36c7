"""Errors of the fleet layer."""


class FleetError(Exception):
    """A run cannot go on; the message says what, where, the value and what is valid."""


class ConfigError(FleetError):
    """A setting is outside its valid range."""


class BrokenRunError(FleetError):
    """A run cannot go on though nothing is wrong with its input."""
