"""Errors of sensors."""

from fleet.errors import FleetError


class SensorError(FleetError):
    """A sensor is described in a way that cannot be, or asked of a world that has none."""
