"""Errors of the planning layer."""


class PlanningError(ValueError):
    """A planning problem is malformed; the message says what, where, the value and what is valid."""
