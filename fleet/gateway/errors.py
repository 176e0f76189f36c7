"""Errors of the gateway."""

from fleet.errors import FleetError


class GatewayError(FleetError):
    """A broker cannot be reached or refuses, or a setting of the connection is outside its valid range."""


class RefusedError(GatewayError):
    """A broker does not let us in, or is not who it should be: to ask again is of no use."""
