"""Order: the messages of a master as checked data: nodes, edges and actions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from fleet.vda5050.faults import MessageError
from maps.reading.shown import shown

Body = Mapping[str, Any]


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
        _node(_object(node, f"order.nodes[{k}]"), f"order.nodes[{k}]")
        for k, node in enumerate(_list(body, "nodes", "order"))
    )
    edges = tuple(
        _edge(_object(edge, f"order.edges[{k}]"), f"order.edges[{k}]")
        for k, edge in enumerate(_list(body, "edges", "order"))
    )
    order = OrderMessage(
        id=_text(body, "orderId", "order"),
        update=_whole(body, "orderUpdateId", "order"),
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
        id=_text(body, "nodeId", where),
        sequence=_whole(body, "sequenceId", where),
        released=_yes(body, "released", where),
        position=None if position is None else _position(_object(position, f"{where}.nodePosition"), where),
        actions=_actions(body, where),
    )


def _position(body: Body, where: str) -> Position:
    where = f"{where}.nodePosition"
    deviation = body.get("allowedDeviationXY")
    if deviation is not None:
        ellipse = _object(deviation, f"{where}.allowedDeviationXY")
        # The smaller half axis is inside the ellipse, whichever way it is turned.
        deviation = min(_number(ellipse, name, f"{where}.allowedDeviationXY") for name in ("a", "b"))
    return Position(
        x=_number(body, "x", where),
        y=_number(body, "y", where),
        theta=None if "theta" not in body else _number(body, "theta", where),
        map_id=_text(body, "mapId", where),
        # Zero says the same as no value in 2.x.
        deviation_m=deviation or None,
        deviation_rad=_number(body, "allowedDeviationTheta", where) if "allowedDeviationTheta" in body else None,
    )


def _edge(body: Body, where: str) -> Edge:
    return Edge(
        id=_text(body, "edgeId", where),
        sequence=_whole(body, "sequenceId", where),
        released=_yes(body, "released", where),
        actions=_actions(body, where),
        fields=body,
    )


def _actions(body: Body, where: str, default_blocking: str | None = None) -> tuple[Action, ...]:
    found = []
    for k, one in enumerate(_list(body, "actions", where)):
        place = f"{where}.actions[{k}]"
        action = _object(one, place)
        blocking = action.get("blockingType", default_blocking)
        if blocking not in list(Blocking):
            raise MessageError(f"{place}.blockingType is {shown(blocking)}; valid: {', '.join(Blocking)}")
        found.append(
            Action(
                id=_text(action, "actionId", place),
                type=_text(action, "actionType", place),
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
        pair = _object(one, place)
        if "value" not in pair:
            raise MessageError(f"{place}.value is missing; valid: any value")
        found[_text(pair, "key", place)] = pair["value"]
    return found


def _field(body: Body, name: str, where: str, valid: str) -> Any:
    if name not in body:
        raise MessageError(f"{where}.{name} is missing; valid: {valid}")
    return body[name]


def _text(body: Body, name: str, where: str) -> str:
    value = _field(body, name, where, "a text")
    if not isinstance(value, str):
        raise MessageError(f"{where}.{name} is {shown(value)}; valid: a text")
    return value


def _whole(body: Body, name: str, where: str) -> int:
    value = _field(body, name, where, "an integer >= 0")
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise MessageError(f"{where}.{name} is {shown(value)}; valid: an integer >= 0")
    return value


def _number(body: Body, name: str, where: str) -> float:
    value = _field(body, name, where, "a number")
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise MessageError(f"{where}.{name} is {shown(value)}; valid: a number")
    return float(value)


def _yes(body: Body, name: str, where: str) -> bool:
    value = _field(body, name, where, "true or false")
    if not isinstance(value, bool):
        raise MessageError(f"{where}.{name} is {shown(value)}; valid: true or false")
    return value


def _list(body: Body, name: str, where: str) -> Sequence[Any]:
    value = _field(body, name, where, "a list")
    if not isinstance(value, list):
        raise MessageError(f"{where}.{name} is {shown(value)}; valid: a list")
    return value


def _object(value: Any, where: str) -> Body:
    if not isinstance(value, dict):
        raise MessageError(f"{where} is {shown(value)}; valid: an object")
    return value
