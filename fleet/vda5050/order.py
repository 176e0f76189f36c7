"""Order: the messages of a master as checked data: nodes, edges and actions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from fleet.vda5050.faults import MessageError
from fleet.vda5050.fields import Body, list_of, number_of, object_of, text_of, truth_of, whole_of
from maps.reading.shown import shown


class Blocking(StrEnum):
    """What an action leaves possible meanwhile, table 3."""

    NONE = "NONE"
    """Driving and other actions."""
    SOFT = "SOFT"
    """Other actions."""
    SINGLE = "SINGLE"
    """Driving."""
    HARD = "HARD"
    """Nothing."""

    @property
    def stops(self) -> bool:
        """Whether the vehicle stands meanwhile."""
        return self in (Blocking.SOFT, Blocking.HARD)

    @property
    def is_alone(self) -> bool:
        """Whether no other action runs meanwhile."""
        return self in (Blocking.SINGLE, Blocking.HARD)


@dataclass(frozen=True, kw_only=True)
class Action:
    """Something to be done beside driving."""

    id: str
    type: str
    blocking: Blocking
    parameters: Mapping[str, Any]
    descriptor: str = ""


@dataclass(frozen=True, kw_only=True)
class Position:
    """Where a node is."""

    x: float
    y: float
    theta: float | None
    """Which way the vehicle has to look there [rad]; None = any."""
    map_id: str
    deviation_m: float | None
    """How far from it counts as there [m]; None = the vehicle decides."""
    deviation_rad: float | None

    def body(self) -> dict[str, Any]:
        """As the state message has it."""
        theta = {} if self.theta is None else {"theta": self.theta}
        return {"x": self.x, "y": self.y, **theta, "mapId": self.map_id}


@dataclass(frozen=True, kw_only=True)
class OrderPart:
    """A node or an edge."""

    id: str
    sequence: int
    released: bool
    actions: tuple[Action, ...]


@dataclass(frozen=True, kw_only=True)
class Node(OrderPart):
    """Where to go, and what to do there."""

    position: Position | None

    @property
    def stops(self) -> bool:
        """Whether the vehicle stands there for an action."""
        return any(action.blocking.stops for action in self.actions)

    def body(self) -> dict[str, Any]:
        """As the state message has it."""
        body = {"nodeId": self.id, "sequenceId": self.sequence, "released": self.released}
        # The schema of 2.0.0 wants an angle in every position of a state.
        if self.position is not None and self.position.theta is not None:
            body["nodePosition"] = self.position.body()
        return body


@dataclass(frozen=True, kw_only=True)
class Edge(OrderPart):
    """The way from a node to the next."""

    fields: Mapping[str, Any]
    """All that the message says of it."""

    def body(self) -> dict[str, Any]:
        """As the state message has it."""
        return {"edgeId": self.id, "sequenceId": self.sequence, "released": self.released}


@dataclass(frozen=True, kw_only=True)
class OrderMessage:
    """An order, or an update of one."""

    id: str
    update: int
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]
    fields: Mapping[str, Any]
    """The whole message without its header."""

    @property
    def parts(self) -> list[OrderPart]:
        """Nodes and edges, in the order in which the vehicle comes to them."""
        return sorted([*self.nodes, *self.edges], key=lambda part: part.sequence)

    @property
    def actions(self) -> tuple[Action, ...]:
        """All actions, in the order in which the vehicle comes to them."""
        return tuple(action for part in self.parts for action in part.actions)

    @property
    def maps(self) -> frozenset[str]:
        """Maps that it names."""
        return frozenset(node.position.map_id for node in self.nodes if node.position is not None)


HEADER = ("headerId", "timestamp", "version", "manufacturer", "serialNumber")


def order_of(body: Body) -> OrderMessage:
    """An order from a message in the words of 3.0.0.

    Raises:
        MessageError: A field is missing or has a value that it cannot have, or nodes and edges do not alternate.
    """
    nodes = tuple(
        _node(object_of(node, f"order.nodes[{k}]"), f"order.nodes[{k}]")
        for k, node in enumerate(list_of(body, "nodes", "order"))
    )
    edges = tuple(
        _edge(object_of(edge, f"order.edges[{k}]"), f"order.edges[{k}]")
        for k, edge in enumerate(list_of(body, "edges", "order"))
    )
    order = OrderMessage(
        id=text_of(body, "orderId", "order"),
        update=whole_of(body, "orderUpdateId", "order"),
        nodes=nodes,
        edges=edges,
        fields={key: value for key, value in body.items() if key not in HEADER},
    )
    _check(order)
    return order


def instant_actions_of(body: Body) -> tuple[Action, ...]:
    """Instant actions from a message in the words of 3.0.0.

    Raises:
        MessageError: A field is missing or has a value that it cannot have.
    """
    return _actions(body, "instantActions", default_blocking="NONE")


def _check(order: OrderMessage) -> None:
    """Nodes and edges alternate, and what is released comes before what is not (section 6.1.1)."""
    nodes, edges = order.nodes, order.edges
    if not nodes:
        raise MessageError("order.nodes is empty; valid: at least one node")
    if len(edges) != len(nodes) - 1:
        raise MessageError(f"order.edges has {len(edges)} edges; valid: {len(nodes) - 1}, one less than nodes")
    first = nodes[0].sequence
    if first % 2:
        raise MessageError(f"order.nodes[0].sequenceId is {first}; valid: an even number")
    lists: tuple[tuple[str, Sequence[OrderPart], int], ...] = (("nodes", nodes, first), ("edges", edges, first + 1))
    for name, listed, begin in lists:
        for k, part in enumerate(listed):
            if part.sequence != begin + 2 * k:
                raise MessageError(f"order.{name}[{k}].sequenceId is {part.sequence}; valid: {begin + 2 * k}")
    if not nodes[0].released:
        raise MessageError("order.nodes[0].released is false; valid: true, the vehicle stands there")
    ended = False
    for part in order.parts:
        if part.released and ended:
            raise MessageError(f"order: {shown(part.id)} is released behind what is not; valid: a base, then a horizon")
        ended |= not part.released
    for k, edge in enumerate(edges):
        if edge.released and not nodes[k + 1].released:
            raise MessageError(f"order.edges[{k}].released is true; valid: false, as its end is not released")
    seen: set[str] = set()
    for action in order.actions:
        if action.id in seen:
            raise MessageError(f"order: actionId is {shown(action.id)} twice; valid: ids that are used once")
        seen.add(action.id)


def _node(body: Body, where: str) -> Node:
    position = body.get("nodePosition")
    return Node(
        id=text_of(body, "nodeId", where),
        sequence=whole_of(body, "sequenceId", where),
        released=truth_of(body, "released", where),
        position=None if position is None else _position(object_of(position, f"{where}.nodePosition"), where),
        actions=_actions(body, where),
    )


def _position(body: Body, where: str) -> Position:
    where = f"{where}.nodePosition"
    deviation = body.get("allowedDeviationXY")
    if deviation is not None:
        ellipse = object_of(deviation, f"{where}.allowedDeviationXY")
        # The smaller half axis is inside the ellipse, whichever way it is turned.
        deviation = min(number_of(ellipse, name, f"{where}.allowedDeviationXY") for name in ("a", "b"))
    return Position(
        x=number_of(body, "x", where),
        y=number_of(body, "y", where),
        theta=None if "theta" not in body else number_of(body, "theta", where),
        map_id=text_of(body, "mapId", where),
        # Zero says the same as no value in 2.x.
        deviation_m=deviation or None,
        deviation_rad=number_of(body, "allowedDeviationTheta", where) if "allowedDeviationTheta" in body else None,
    )


def _edge(body: Body, where: str) -> Edge:
    return Edge(
        id=text_of(body, "edgeId", where),
        sequence=whole_of(body, "sequenceId", where),
        released=truth_of(body, "released", where),
        actions=_actions(body, where),
        fields=body,
    )


def _actions(body: Body, where: str, default_blocking: str | None = None) -> tuple[Action, ...]:
    found = []
    for k, one in enumerate(list_of(body, "actions", where)):
        place = f"{where}.actions[{k}]"
        action = object_of(one, place)
        blocking = action.get("blockingType", default_blocking)
        if blocking not in list(Blocking):
            raise MessageError(f"{place}.blockingType is {shown(blocking)}; valid: {', '.join(Blocking)}")
        found.append(
            Action(
                id=text_of(action, "actionId", place),
                type=text_of(action, "actionType", place),
                blocking=Blocking(blocking),
                parameters=_parameters(action.get("actionParameters", []), place),
                descriptor=str(action.get("actionDescriptor", "")),
            )
        )
    return tuple(found)


def _parameters(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, list):
        raise MessageError(f"{where}.actionParameters is {shown(value)}; valid: a list of pairs of key and value")
    found = {}
    for k, one in enumerate(value):
        place = f"{where}.actionParameters[{k}]"
        pair = object_of(one, place)
        if "value" not in pair:
            raise MessageError(f"{place}.value is missing; valid: any value")
        found[text_of(pair, "key", place)] = pair["value"]
    return found
