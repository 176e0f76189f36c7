"""Errors of robot models."""

from __future__ import annotations

from fleet.errors import FleetError


class ArmDescriptionError(FleetError):
    """A file does not describe the arm that it should."""
