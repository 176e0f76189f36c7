"""Errors of the evaluation."""

from fleet.errors import FleetError


class EvaluationError(FleetError):
    """A scenario, a split or a file of results is not what it has to be."""


class PolicyError(FleetError):
    """A policy cannot be had, cannot play a scenario, or has failed in it."""


class DatasetError(FleetError):
    """A data set cannot be written, or is not one that can be read."""
