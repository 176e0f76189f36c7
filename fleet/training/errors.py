"""Errors of training."""

from fleet.errors import FleetError


class TrainingError(FleetError):
    """A training run cannot begin or go on; says what, where and what is valid."""
