"""Errors of the gateway."""

from fleet.errors import FleetError


class GatewayError(FleetError):
    """A broker cannot be reached or refuses, or a setting of the connection is outside its valid range."""
