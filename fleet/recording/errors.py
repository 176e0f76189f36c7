"""Errors of recordings and run files."""

from fleet.errors import FleetError


class OutputError(FleetError):
    """The output directory cannot be used; names the path and the reason."""


class RecordingError(FleetError):
    """A recording could not be written, read or shown."""
