"""Faults: what a vehicle reports of messages that it cannot take, and of itself."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from fleet.errors import FleetError


class ErrorType(StrEnum):
    """Predefined error types of 3.0.0: table 9, and those that only the text of section 6.1 names."""

    UNSUPPORTED_PARAMETER = "UNSUPPORTED_PARAMETER"
    NO_ORDER_TO_CANCEL = "NO_ORDER_TO_CANCEL"
    VALIDATION_FAILURE = "VALIDATION_FAILURE"
    INVALID_ORDER = "INVALID_ORDER"
    INVALID_ORDER_ACTION = "INVALID_ORDER_ACTION"
    INVALID_INSTANT_ACTION = "INVALID_INSTANT_ACTION"
    OUTDATED_ORDER_UPDATE = "OUTDATED_ORDER_UPDATE"
    SAME_ORDER_UPDATE_ID = "SAME_ORDER_UPDATE_ID"
    ORDER_UPDATE_FOLLOWING_CANCEL = "ORDER_UPDATE_FOLLOWING_CANCEL"
    OUTSIDE_OF_CORRIDOR = "OUTSIDE_OF_CORRIDOR"
    INSUFFICIENT_MEMORY = "INSUFFICIENT_MEMORY"
    DUPLICATE_MAP = "DUPLICATE_MAP"
    BLOCKED_ZONE_VIOLATION = "BLOCKED_ZONE_VIOLATION"
    DUPLICATE_ZONE_SET = "DUPLICATE_ZONE_SET"
    RELEASE_LOST = "RELEASE_LOST"
    ZONE_ACTION_CONFLICT = "ZONE_ACTION_CONFLICT"
    NODE_UNREACHABLE = "NODE_UNREACHABLE"
    LOCALIZATION_ERROR = "LOCALIZATION_ERROR"
    NO_ROUTE_TO_TARGET = "NO_ROUTE_TO_TARGET"
    OTHER_ORDER_ACTIVE = "OTHER_ORDER_ACTIVE"
    START_NODE_OUT_OF_RANGE = "START_NODE_OUT_OF_RANGE"
    MOBILE_ROBOT_NOT_AVAILABLE = "MOBILE_ROBOT_NOT_AVAILABLE"
    UNKNOWN_MAP_ID = "UNKNOWN_MAP_ID"


class ErrorLevel(StrEnum):
    """How bad it is, section 6.6.5.1."""

    WARNING = "WARNING"
    """The vehicle goes on with its order."""
    URGENT = "URGENT"
    """It goes on, and somebody has to look soon."""
    CRITICAL = "CRITICAL"
    """It cannot go on with its order, but may take others."""
    FATAL = "FATAL"
    """It stands until somebody helps."""


LEVEL_OF = {
    ErrorType.UNSUPPORTED_PARAMETER: ErrorLevel.CRITICAL,
    ErrorType.NODE_UNREACHABLE: ErrorLevel.CRITICAL,
    ErrorType.LOCALIZATION_ERROR: ErrorLevel.FATAL,
}
"""Levels of the types that a vehicle of ours reports; the others are warnings."""


@dataclass(frozen=True, kw_only=True)
class VehicleFault:
    """An entry of `errors` in a state message."""

    type: str
    description: str
    level: ErrorLevel = ErrorLevel.WARNING
    references: tuple[tuple[str, str], ...] = ()
    """Pairs of a name and a value that lead to the cause."""

    def body(self) -> dict[str, Any]:
        """As the state message has it."""
        return {
            "errorType": self.type,
            "errorLevel": self.level.value,
            "errorDescription": self.description,
            "errorReferences": [{"referenceKey": key, "referenceValue": value} for key, value in self.references],
        }


def fault_of(kind: ErrorType, description: str, **references: object) -> VehicleFault:
    """A fault of a predefined type, with the level that belongs to it."""
    pairs = tuple((key, str(value)) for key, value in references.items())
    return VehicleFault(
        type=kind.value,
        description=description,
        level=LEVEL_OF.get(kind, ErrorLevel.WARNING),
        references=pairs,
    )


class MessageError(FleetError):
    """A message is no message of the topic, or of another version; says which field, its value and what is valid."""


class ForeignMessageError(MessageError):
    """A message is for somebody else, or of a version that was not agreed on."""
