"""NodeMap: which lane-graph states a node stands for, and what a car can do there."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from fleet.missions.ways import Ways
from fleet.robots.spec import CarSpec
from fleet.run.view import RunView
from fleet.stations.service_time import Direction
from fleet.stations.station import Station
from fleet.tasks.order import MAX_MASS_KG, MIN_MASS_KG
from fleet.vda5050.order import Action, Edge, Node, Position
from maps.layouts.from_site import state_names
from maps.reading.shown import shown
from planners.mapf.distance_table import UNREACHABLE

DEVIATION_M = 0.5
"""How far from a node a car counts as standing on it if the master does not say: half a cell [m]."""
DEVIATION_RAD = math.pi / 4
"""How much it may look another way: half the angle between two headings [rad]."""
ACTIONS = {"pick": Direction.TO_CAR, "drop": Direction.FROM_CAR}
_AT_NODES = "valid: a place on a lane, or a nodeId such as r3_c4_east or pick_1"


class NodeMap:
    """Where nodes are on the lane graph.

    A node stands for the ways to stand in the cell that it lies in: with its angle the one that looks that way, at a
    dock with an action the one that the arm serves. Without a position its id says where it is, as `site export` names
    nodes, or by the name of a station or bay.

    Args:
        run: The run.
        map_id: Name of the map.
    """

    def __init__(self, run: RunView, map_id: str) -> None:
        self.run = run
        self.ways = Ways(run.traffic, run.site.grid.cell_m)
        self.map_id = map_id
        self._stations_at: dict[int, list[Station]] = {}  # whose arms serve a car in a state: two may share a dock
        for station in run.stations:
            self._stations_at.setdefault(station.dock_state, []).append(station)
        self._found: dict[tuple[str, Position | None, bool], tuple[int, ...]] = {}
        self.look()
        graph = run.graph
        self._by_name: dict[str, tuple[int, ...]] = {}
        for state, name in enumerate(state_names(run.site, graph)):
            self._by_name[name] = (state,)
        for name, cell in run.site.bays().items():
            self._by_name[name] = tuple(graph.states_of_cell(cell).tolist())
        self._by_name |= {station.name: (station.dock_state,) for station in run.stations}

    def look(self) -> None:
        """Take in where the cars are."""
        run = self.run
        self.poses = run.world.car_poses()
        self.speeds = run.world.car_speeds()
        self.steering = run.world.car_steering()
        self.granted = run.executor.granted_states()

    def states(self, node: Node) -> tuple[int, ...]:
        """Ways to stand at a node; none if it is nowhere on the lanes, or nowhere near enough."""
        at_dock = any(action.type in ACTIONS for action in node.actions)
        key = node.id, node.position, at_dock
        if key not in self._found:
            found = self._by_name.get(node.id, ()) if node.position is None else self._near(node.position)
            if at_dock:
                found = tuple(state for state in found if state in self._stations_at)
            self._found[key] = found
        return self._found[key]

    def stations(self, action: Action, states: Iterable[int]) -> list[Station]:
        """The stations that do an action for a car in one of some states; that which it names alone, if it is there."""
        able = [
            station
            for state in states
            for station in self._stations_at.get(state, ())
            if station.direction is ACTIONS.get(action.type)
        ]
        return [station for station in able if station.name == action.parameters.get("stationName")] or able

    def far(self, position: Position, pose: Sequence[float]) -> bool:
        """Whether a pose is beyond the deviation that a position allows."""
        most_m = DEVIATION_M if position.deviation_m is None else position.deviation_m
        if math.hypot(pose[0] - position.x, pose[1] - position.y) > most_m + 1e-6:
            return True
        if position.theta is None:
            return False
        most_rad = DEVIATION_RAD if position.deviation_rad is None else position.deviation_rad
        return abs(math.remainder(pose[2] - position.theta, math.tau)) > most_rad + 1e-6

    def reachable(self, start: Sequence[int], node: Node) -> list[int]:
        """Ways to stand at a node that some state leads to."""
        tables = self.run.traffic.tables
        return [
            state
            for state in self.states(node)
            if state in start or int(tables.to(state)[np.asarray(start)].min(initial=UNREACHABLE)) < UNREACHABLE
        ]

    def _near(self, position: Position) -> tuple[int, ...]:
        # However much a master allows, a car goes to where the node is.
        poses = self.run.graph.state_pose
        near = np.flatnonzero(np.hypot(poses[:, 0] - position.x, poses[:, 1] - position.y) <= DEVIATION_M + 1e-6)
        return tuple(state for state in near.tolist() if not self.far(position, poses[state].tolist()))


class CarSurroundings:
    """What one car knows; see `fleet.vda5050.acceptance.VehicleSurroundings`.

    Args:
        node_map: Where nodes are.
        car: Its number.
    """

    def __init__(self, node_map: NodeMap, car: int) -> None:
        self._nodes = node_map
        self._car = car
        self._spec: CarSpec = node_map.run.scene.cars[car]

    @property
    def maps(self) -> frozenset[str]:
        """Maps that it has."""
        return frozenset({self._nodes.map_id})

    def in_range(self, node: Node) -> str:
        """Why the car does not stand in a node's range of deviation; empty if it does."""
        node_map = self._nodes
        x, y, yaw = node_map.poses[self._car].tolist()
        if node.position is not None:
            if not node_map.far(node.position, (x, y, yaw)):
                return ""
        elif int(node_map.granted[self._car]) in node_map.states(node):
            return ""
        return f"node {shown(node.id)} is not where the car stands, at ({x:.2f}, {y:.2f}, {yaw:.2f})"

    def unreachable(self, nodes: Sequence[Node], *, standing: bool) -> str:
        """Why some node cannot be reached from the one before it; empty if all can."""
        node_map = self._nodes
        granted = int(node_map.granted[self._car])
        start = [granted] if standing else list(node_map.states(nodes[0])) or [granted]
        before = nodes[0]
        for node in nodes[1:]:
            if not node_map.states(node):
                where = "has no position" if node.position is None else f"lies at {_at(node.position)}"
                return f"node {shown(node.id)} {where}; {_AT_NODES}"
            start = node_map.reachable(start, node)
            if not start:
                return f"node {shown(node.id)} has no way to it from {shown(before.id)}"
            before = node
        return ""

    def cannot_do(self, action: Action, node: Node) -> str:
        """Why the car cannot do an action at a node; empty if it can."""
        if action.type not in ACTIONS:
            return f"actionType is {shown(action.type)}; valid: {', '.join(ACTIONS)}"
        if not action.blocking.stops:
            return f"blockingType of {action.type} is {action.blocking.value}; valid: HARD, SOFT"
        stations = [station.name for station in self._nodes.stations(action, self._nodes.states(node))]
        if not stations:
            kind: Literal["pick", "drop"] = "pick" if action.type == "pick" else "drop"
            names = ", ".join(self._nodes.run.site.station_names(kind))
            return f"node {shown(node.id)} is at no {kind} station; valid: {names}"
        named = action.parameters.get("stationName", stations[0])
        if named not in stations:
            return f"stationName is {shown(named)} at node {shown(node.id)}; valid: {', '.join(stations)}"
        weight = action.parameters.get("weight", MIN_MASS_KG)
        most_kg = min(MAX_MASS_KG, self._spec.max_payload_kg)
        is_number = isinstance(weight, int | float) and not isinstance(weight, bool)
        if not is_number or not MIN_MASS_KG <= weight <= most_kg:
            return f"weight is {shown(weight)}; valid: a number from {MIN_MASS_KG} to {most_kg:g}"
        return ""

    def cannot_use(self, edge: Edge) -> str:
        """The field of an edge that the car cannot follow; empty if none."""
        fields, spec = edge.fields, self._spec
        if "trajectory" in fields:
            return "trajectory is given; valid: none, the lanes of the site have their own"
        for name, own, unit in (
            ("maximumSpeed", spec.max_speed_mps, "m/s"),
            ("maximumMobileRobotHeight", spec.height_m, "m"),
        ):
            limit = fields.get(name, math.inf)
            if not isinstance(limit, int | float) or limit < own:
                return f"{name} is {shown(limit)}; valid: at least {own:g} {unit}"
        if "orientation" in fields:
            ahead = fields.get("orientationType") == "TANGENTIAL" and fields["orientation"] == 0
            if not ahead:
                return f"orientation is {shown(fields['orientation'])}; valid: 0 with orientationType TANGENTIAL"
        corridor = fields.get("corridor")
        if isinstance(corridor, dict) and corridor.get("releaseRequired"):
            return "corridor.releaseRequired is true; valid: false, the car stays on its lane"
        return ""


def _at(position: Position) -> str:
    theta = "" if position.theta is None else f", {position.theta:.2f}"
    return f"({position.x:.2f}, {position.y:.2f}{theta})"
