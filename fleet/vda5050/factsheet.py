"""Factsheet: what a master has to know of a vehicle before it sends orders, section 6.10."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fleet.vda5050.vehicle import INSTANT_ACTIONS, Timing

MOST_ID = 256
"""Longest id that is read."""
ACTION_PARAMETERS = {"pick": ("stationName", "loadId", "loadType", "weight"), "drop": ("stationName", "loadId")}
"""Actions on nodes, and the parameters of each that are heeded; all of them are optional."""

OPTIONAL_OF_NODES = (
    "nodePosition",
    "nodePosition.theta",
    "nodePosition.allowedDeviationXY",
    "nodePosition.allowedDeviationTheta",
)
"""Optional fields of nodes that are heeded; a master may leave out, or refuse, what is not listed (section 6.10)."""


@dataclass(frozen=True, kw_only=True)
class Build:
    """Size and limits of a vehicle."""

    series: str
    payload_kg: float
    speed_mps: float
    accel_mps2: float
    brake_mps2: float
    length_m: float
    width_m: float
    height_m: float
    steers: bool
    """Whether its front wheels steer it; else it turns on the spot."""
    front_m: float
    """From the reference point to the front [m]."""
    pick_s: float
    """Usual time of a pick, and of a drop [s]."""


def factsheet_of(build: Build, timing: Timing) -> dict[str, Any]:
    """The body of a factsheet in the words of 3.0.0."""
    rear_m, side_m = build.front_m - build.length_m, build.width_m / 2
    corners = ((build.front_m, side_m), (rear_m, side_m), (rear_m, -side_m), (build.front_m, -side_m))
    return {
        "typeSpecification": {
            "seriesName": build.series,
            # Steered by its front wheels: of the kinds that the standard names, three wheels drive like it.
            "mobileRobotKinematics": "THREE_WHEEL" if build.steers else "DIFFERENTIAL",
            "mobileRobotClass": "CARRIER",
            "maximumLoadMass": build.payload_kg,
            "localizationTypes": ["NATURAL"],
            "navigationTypes": ["VIRTUAL_LINE_GUIDED"],
        },
        "physicalParameters": {
            "minimumSpeed": 0.0,
            "maximumSpeed": build.speed_mps,
            "maximumAcceleration": build.accel_mps2,
            "maximumDeceleration": build.brake_mps2,
            "minimumHeight": build.height_m,
            "maximumHeight": build.height_m,
            "width": build.width_m,
            "length": build.length_m,
        },
        "protocolLimits": {
            "maximumStringLengths": {"maximumIdLength": MOST_ID, "idNumericalOnly": False},
            "maximumArrayLengths": {},
            "timing": {
                "minimumOrderInterval": timing.least_s,
                "minimumStateInterval": timing.least_s,
                "defaultStateInterval": timing.most_s,
            },
        },
        "protocolFeatures": {
            "optionalParameters": [
                {"parameter": f"order.nodes.{name}", "support": "SUPPORTED"} for name in OPTIONAL_OF_NODES
            ],
            "mobileRobotActions": [_node_action(kind) for kind in ACTION_PARAMETERS]
            + [_instant_action(kind) for kind in INSTANT_ACTIONS],
        },
        "mobileRobotGeometry": {
            "envelopes2d": [{"envelope2dId": "body", "vertices": [{"x": x, "y": y} for x, y in corners]}]
        },
        "loadSpecification": {
            "loadSets": [
                {
                    "setName": "parcel",
                    "loadType": "parcel",
                    "maximumWeight": build.payload_kg,
                    "pickTime": build.pick_s,
                    "dropTime": build.pick_s,
                }
            ]
        },
    }


def _node_action(kind: str) -> dict[str, Any]:
    parameters = [
        {"key": key, "valueDataType": "NUMBER" if key == "weight" else "STRING", "isOptional": True}
        for key in ACTION_PARAMETERS[kind]
    ]
    return {
        "actionType": kind,
        "actionDescription": f"the arm of the station does the {kind}",
        "actionScopes": ["NODE"],
        "actionParameters": parameters,
        "blockingTypes": ["SOFT", "HARD"],
        "pauseAllowed": False,
        "cancelAllowed": False,
    }


def _instant_action(kind: str) -> dict[str, Any]:
    return {
        "actionType": kind,
        "actionScopes": ["INSTANT"],
        "blockingTypes": ["NONE"],
        "pauseAllowed": False,
        "cancelAllowed": False,
    }
