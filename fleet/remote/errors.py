"""Errors of what comes from outside of a run."""

from fleet.errors import FleetError


class RemoteError(FleetError):
    """What somebody outside of the run asks for cannot be; the run goes on without it."""
