"""Errors of the fleet layer."""


class FleetError(Exception):
    """A run cannot go on; the message says what, where, the value and what is valid."""


class ConfigError(FleetError):
    """A setting is outside its valid range."""
