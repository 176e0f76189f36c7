"""Status: how a search ended."""

from enum import StrEnum


class Status(StrEnum):
    """How a search ended; "no solution" is a status, not an exception."""

    OPTIMAL = "optimal"
    FEASIBLE = "feasible"
    TIMEOUT = "timeout"
    INFEASIBLE = "infeasible"
