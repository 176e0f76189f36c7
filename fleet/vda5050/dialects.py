"""Dialects: what each version of VDA 5050 calls on the wire what 3.0.0 calls otherwise, as tables.

Every public 2.0 differs: the schemas of the tag 2.0.0 say `actionName` in instant actions where all later ones say
`actionType`, and vda-5050-lib calls the list of them `instantActions`. A further dialect is one entry of `DIALECTS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fleet.vda5050.faults import ErrorType

Names = Mapping[str, str]
"""What 3.0.0 calls it, and what the dialect calls it."""


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """A version of the standard, as somebody speaks it."""

    name: str
    version: str
    """As headers have it."""
    level: str
    """As topics have it."""
    fields: Mapping[str, Names] = field(default_factory=dict)
    """Names of fields, by topic."""
    also_read: Mapping[str, Names] = field(default_factory=dict)
    """Other names that are understood, by topic: what it is called on the wire, and what 3.0.0 calls it."""
    unknown: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """Fields of 3.0.0 that the dialect has not, by topic; they are left out."""
    values: Mapping[str, Names] = field(default_factory=dict)
    """Values that are called otherwise, by the 3.0.0 name of the field."""
    nearest: Mapping[str, Names] = field(default_factory=dict)
    """Values that the dialect has not, and what is said instead, by the 3.0.0 name of the field."""
    errors: Names = field(default_factory=dict)
    """Names of error types."""
    ellipses: bool = True
    """Whether a deviation is an ellipse; else a radius."""
    edge_ends: bool = False
    """Whether edges name the nodes at their ends."""
    instant_states: bool = True
    """Whether instant actions have a list of their own in the state; else they are among the others."""
    strict_updates: bool = True
    """Whether a new order begins with update 0, and an update that comes again has to be the same."""

    def speaks(self, version: str) -> bool:
        """Whether a message of a version can be read: major and minor number count."""
        return version.split(".")[:2] == self.version.split(".")[:2]


_ORDER: Names = {
    "nodeDescriptor": "nodeDescription",
    "edgeDescriptor": "edgeDescription",
    "actionDescriptor": "actionDescription",
    "maximumSpeed": "maxSpeed",
    "maximumMobileRobotHeight": "maxHeight",
    "minimumLoadHandlingDeviceHeight": "minHeight",
    "corridorReferencePoint": "corridorRefPoint",
}
_STATE: Names = {
    "nodeDescriptor": "nodeDescription",
    "edgeDescriptor": "edgeDescription",
    "actionDescriptor": "actionDescription",
    "mapDescriptor": "mapDescription",
    "infoDescriptor": "infoDescription",
    "mobileRobotPosition": "agvPosition",
    "localized": "positionInitialized",
    "powerSupply": "batteryState",
    "stateOfCharge": "batteryCharge",
    "range": "reach",
    "actionResult": "resultDescription",
    "activeEmergencyStop": "eStop",
}
_VISUALIZATION: Names = {"mobileRobotPosition": "agvPosition", "localized": "positionInitialized"}
_FACTSHEET: Names = {
    "mobileRobotKinematics": "agvKinematic",
    "mobileRobotClass": "agvClass",
    "maximumLoadMass": "maxLoadMass",
    "minimumSpeed": "speedMin",
    "maximumSpeed": "speedMax",
    "maximumAcceleration": "accelerationMax",
    "maximumDeceleration": "decelerationMax",
    "minimumHeight": "heightMin",
    "maximumHeight": "heightMax",
    "maximumStringLengths": "maxStringLens",
    "maximumMessageLength": "msgLen",
    "maximumTopicSerialLength": "topicSerialLen",
    "maximumTopicElementLength": "topicElemLen",
    "maximumIdLength": "idLen",
    "maximumLoadIdLength": "loadIdLen",
    "maximumArrayLengths": "maxArrayLens",
    "minimumOrderInterval": "minOrderInterval",
    "minimumStateInterval": "minStateInterval",
    "mobileRobotActions": "agvActions",
    "actionResult": "resultDescription",
    "mobileRobotGeometry": "agvGeometry",
    "envelope2dId": "set",
    "vertices": "polygonPoints",
    "maximumWeight": "maxWeight",
    "mobileRobotConfiguration": "vehicleConfig",
}
_FIELDS = {
    "order": _ORDER,
    "instantActions": {"actionDescriptor": "actionDescription"},
    "state": _STATE,
    "visualization": _VISUALIZATION,
    "factsheet": _FACTSHEET,
}
_PATHS = frozenset({"plannedPath", "intermediatePath"})
_UNKNOWN = {
    "order": frozenset(
        {"orderDescription", "reachOrientationBeforeEntering", "releaseRequired", "releaseLossBehavior", "retriable"}
    ),
    "instantActions": frozenset({"retriable"}),
    "state": _PATHS
    | {
        "zoneSets",
        "zoneRequests",
        "edgeRequests",
        "zoneActionStates",
        "errorDescriptionTranslations",
        "errorHintTranslations",
        "batteryCurrent",
    },
    "visualization": _PATHS | {"referenceStateHeaderId"},
    "factsheet": frozenset(
        {
            "supportedZones",
            "minimumAngularSpeed",
            "maximumAngularSpeed",
            "pauseAllowed",
            "cancelAllowed",
            "zoneSet.zones",
            "state.instantActionStates",
            "state.zoneActionStates",
            "batteryCharging",
            "blockingTypes",  # no value is valid by the schema of 2.1.0: a list that is one of three texts
        }
    ),
}
_VALUES = {
    "connectionState": {"CONNECTION_BROKEN": "CONNECTIONBROKEN"},
    "operatingMode": {"TEACH_IN": "TEACHIN"},
    "corridorReferencePoint": {"KINEMATIC_CENTER": "KINEMATICCENTER"},
    "mobileRobotKinematics": {"DIFFERENTIAL": "DIFF", "OMNIDIRECTIONAL": "OMNI", "THREE_WHEEL": "THREEWHEEL"},
    "navigationTypes": {"FREELY_NAVIGATING": "AUTONOMOUS"},
}
_NEAREST = {
    "connectionState": {"HIBERNATING": "OFFLINE"},
    "operatingMode": {"STARTUP": "MANUAL", "INTERVENED": "MANUAL"},
    "errorLevel": {"URGENT": "WARNING", "CRITICAL": "WARNING"},
    "actionStatus": {"PAUSED": "RUNNING", "RETRIABLE": "RUNNING"},
    "blockingType": {"SINGLE": "HARD"},
}
_ERRORS = {
    ErrorType.VALIDATION_FAILURE: "validationError",
    ErrorType.UNSUPPORTED_PARAMETER: "orderError",
    ErrorType.INVALID_ORDER_ACTION: "orderError",
    ErrorType.MOBILE_ROBOT_NOT_AVAILABLE: "orderError",
    ErrorType.UNKNOWN_MAP_ID: "orderError",
    ErrorType.INSUFFICIENT_MEMORY: "orderError",
    ErrorType.INVALID_ORDER: "orderUpdateError",
    ErrorType.OTHER_ORDER_ACTIVE: "orderUpdateError",
    ErrorType.OUTDATED_ORDER_UPDATE: "orderUpdateError",
    ErrorType.SAME_ORDER_UPDATE_ID: "orderUpdateError",
    ErrorType.ORDER_UPDATE_FOLLOWING_CANCEL: "orderUpdateError",
    ErrorType.NO_ROUTE_TO_TARGET: "noRouteError",
    ErrorType.START_NODE_OUT_OF_RANGE: "noRouteError",
    ErrorType.NODE_UNREACHABLE: "noRouteError",
    ErrorType.NO_ORDER_TO_CANCEL: "noOrderToCancel",
    ErrorType.INVALID_INSTANT_ACTION: "instantActionError",
}
"""The five predefined ones of 2.x, and vda-5050-lib's word for instant actions, for which 2.x has none."""


def _second(name: str, version: str, **changed: Mapping[str, Mapping[str, str]]) -> Dialect:
    """A dialect of the second version.

    Args:
        name: Its name.
        version: As headers have it.
        changed: Names of fields by topic, under `fields`, and other names that are read, under `also_read`.
    """
    first = version.startswith("2.0")
    fields = {topic: {**names, **changed.get("fields", {}).get(topic, {})} for topic, names in _FIELDS.items()}
    unknown = dict(_UNKNOWN)
    if first:
        unknown["order"] = _UNKNOWN["order"] | {"corridor", "orientationType"}
        unknown["state"] = _UNKNOWN["state"] | {"maps", "errorHint"}
    return Dialect(
        name=name,
        version=version,
        level="v2",
        fields=fields,
        also_read=changed.get("also_read", {}),
        unknown=unknown,
        values=_VALUES,
        nearest=_NEAREST,
        errors={kind.value: word for kind, word in _ERRORS.items()},
        ellipses=False,
        edge_ends=True,
        instant_states=False,
        strict_updates=False,
    )


_XY = {"allowedDeviationXY": "allowedDeviationXy"}
_XY_TOO = {"allowedDeviationXY": "allowedDeviationXY"}

DIALECTS: Mapping[str, Dialect] = {
    dialect.name: dialect
    for dialect in (
        # Written as the schemas of the tag say; read also as the text and openTCS have it.
        _second(
            "2.0.0",
            "2.0.0",
            fields={"order": _XY, "instantActions": {"actionType": "actionName"}},
            also_read={"order": _XY_TOO, "instantActions": {"actionType": "actionType"}},
        ),
        # As vda-5050-lib 1.4.0 speaks it, https://github.com/coatyio/vda-5050-lib.js.
        _second(
            "2.0.0-coaty",
            "2.0.0",
            fields={"order": _XY, "instantActions": {"actions": "instantActions"}},
            also_read={"order": _XY_TOO, "instantActions": {"actions": "actions"}},
        ),
        _second("2.1.0", "2.1.0"),
        Dialect(name="3.0.0", version="3.0.0", level="v3"),
    )
}
"""The dialects by name."""
