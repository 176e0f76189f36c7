"""Acceptance: whether a vehicle takes an order, as one function with a reason for every branch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

from fleet.vda5050.faults import ErrorType, VehicleFault, fault_of
from fleet.vda5050.order import Action, Edge, Node, OrderMessage
from maps.reading.shown import shown


class OperatingMode(StrEnum):
    """Who is in control of the vehicle, section 6.6.6; those that a vehicle of ours has."""

    AUTOMATIC = "AUTOMATIC"
    SERVICE = "SERVICE"
    """It takes no orders until somebody has looked after it."""


class OrderOutcome(StrEnum):
    """What becomes of an order message."""

    NEW = "new"
    UPDATE = "update"
    REPEATED = "repeated"
    """It is known already; it is left alone and nothing is reported."""
    REFUSED = "refused"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What becomes of an order message, and why."""

    outcome: OrderOutcome
    fault: VehicleFault | None = None
    """What is reported; None = nothing."""

    @property
    def reason(self) -> str:
        """The error type of what is refused, else the outcome."""
        return self.outcome.value if self.fault is None else self.fault.type


@dataclass(frozen=True, kw_only=True)
class HeldOrder:
    """What a vehicle knows of the order that it has, or had last."""

    order_id: str = ""
    """Empty = it never had one."""
    update: int = 0
    fields: Mapping[str, Any] = field(default_factory=dict)
    """The last message that was accepted, without its header."""
    decision_point: Node | None = None
    """Last node of the base."""
    actions: frozenset[str] = frozenset()
    """Ids of all its actions, ended ones included."""
    cancelled: bool = False
    idle: bool = True


class VehicleSurroundings(Protocol):
    """What a vehicle knows of itself and of its floor."""

    @property
    def maps(self) -> frozenset[str]:
        """Maps that it has."""

    def in_range(self, node: Node) -> str:
        """Why the vehicle does not stand in a node's range of deviation; empty if it does."""

    def unreachable(self, nodes: Sequence[Node], *, standing: bool) -> str:
        """Why some node cannot be reached from the one before it, with its name; empty if all can.

        Args:
            nodes: In the order in which they would be visited.
            standing: Whether the vehicle begins where it stands, whatever the first node says.
        """

    def cannot_do(self, action: Action, node: Node) -> str:
        """Why the vehicle cannot do an action at a node; empty if it can."""

    def cannot_use(self, edge: Edge) -> str:
        """The field of an edge that the vehicle cannot follow, with its value and what is valid; empty if none."""


def judge(
    order: OrderMessage, held: HeldOrder, mode: OperatingMode, around: VehicleSurroundings, *, strict_updates: bool
) -> Verdict:
    """Decide on an order message that is well formed; malformed ones are a `VALIDATION_FAILURE` before this.

    Args:
        order: The order, or an update.
        held: What the vehicle has.
        mode: Who is in control of it.
        around: What it knows of its floor.
        strict_updates: Whether new orders begin with update 0 and repeated updates have to be equal, as in 3.0.0.

    Returns:
        What becomes of it.

    Source: sections 6.1.2 (figure 8) and 6.1.4 of 3.0.0; 6.6.2 and 6.6.4 of 2.1.0.
    """
    update = order.id == held.order_id
    if update:
        verdict = _by_number(order, held, strict_updates=strict_updates)
    else:
        verdict = _by_what_is_held(order, held, strict_updates=strict_updates)
    verdict = verdict or _by_means(order, mode, around) or _by_actions(order, held, around, update=update)
    verdict = verdict or _by_place(order, around, update=update, standing=held.idle)
    return verdict or Verdict(outcome=OrderOutcome.UPDATE if update else OrderOutcome.NEW)


def _by_what_is_held(order: OrderMessage, held: HeldOrder, *, strict_updates: bool) -> Verdict | None:
    """A new order is taken by an idle vehicle only."""
    if not held.idle:
        return _refused(ErrorType.OTHER_ORDER_ACTIVE, f"order {shown(held.order_id)} is not done yet", order)
    if order.update != 0 and strict_updates:
        words = f"orderUpdateId is {order.update} and the order is not known; valid: 0"
        return _refused(ErrorType.INVALID_ORDER, words, order)
    return None


def _by_number(order: OrderMessage, held: HeldOrder, *, strict_updates: bool) -> Verdict | None:
    """An update has a higher number, and begins where the base ends."""
    if order.update < held.update:
        words = f"orderUpdateId is {order.update}; valid: more than {held.update}"
        return _refused(ErrorType.OUTDATED_ORDER_UPDATE, words, order)
    if order.update == held.update:
        if strict_updates and order.fields != held.fields:
            words = f"update {order.update} is known with another content; valid: the same again, or a higher number"
            return _refused(ErrorType.SAME_ORDER_UPDATE_ID, words, order)
        return Verdict(outcome=OrderOutcome.REPEATED)
    if held.cancelled:
        words = f"order {shown(order.id)} was cancelled; valid: an order with another orderId"
        return _refused(ErrorType.ORDER_UPDATE_FOLLOWING_CANCEL, words, order)
    first, last = order.nodes[0], held.decision_point
    if last is not None and (first.id, first.sequence) != (last.id, last.sequence):
        words = (
            f"the update begins with node {shown(first.id)}, sequenceId {first.sequence}; "
            f"valid: {shown(last.id)}, {last.sequence}, where the base ends"
        )
        return _refused(ErrorType.INVALID_ORDER, words, order)
    return None


def _by_means(order: OrderMessage, mode: OperatingMode, around: VehicleSurroundings) -> Verdict | None:
    """The vehicle is in service, has the maps, and can use all fields."""
    if mode is not OperatingMode.AUTOMATIC:
        return _refused(ErrorType.MOBILE_ROBOT_NOT_AVAILABLE, f"the operating mode is {mode.value}", order)
    unknown = sorted(order.maps - around.maps)
    if unknown:
        words = f"mapId is {shown(unknown[0])}; valid: {', '.join(sorted(around.maps))}"
        return _refused(ErrorType.UNKNOWN_MAP_ID, words, order)
    for edge in order.edges:
        if useless := around.cannot_use(edge):
            words = f"edge {shown(edge.id)}: {useless}"
            return _refused(ErrorType.UNSUPPORTED_PARAMETER, words, order, edgeId=edge.id)
    return None


def _by_actions(order: OrderMessage, held: HeldOrder, around: VehicleSurroundings, *, update: bool) -> Verdict | None:
    """The vehicle can do all actions; those of the first node of an update, which it may have passed, are known."""
    for edge in order.edges:
        for action in edge.actions:
            words = f"{shown(action.type)} is asked for on edge {shown(edge.id)}; valid: actions on nodes"
            return _refused(ErrorType.INVALID_ORDER_ACTION, words, order, actionId=action.id)
    first, *rest = order.nodes
    for action in first.actions if update else ():
        if action.id not in held.actions:
            words = f"{shown(action.type)} is new on node {shown(first.id)}, where the base ends; valid: on later nodes"
            return _refused(ErrorType.INVALID_ORDER, words, order, actionId=action.id)
    for node in rest if update else order.nodes:
        for action in node.actions:
            if unable := around.cannot_do(action, node):
                return _refused(ErrorType.INVALID_ORDER_ACTION, unable, order, actionId=action.id)
    return None


def _by_place(order: OrderMessage, around: VehicleSurroundings, *, update: bool, standing: bool) -> Verdict | None:
    """The vehicle stands where a new order begins, and can go from node to node."""
    if not update and (why := around.in_range(order.nodes[0])):
        return _refused(ErrorType.START_NODE_OUT_OF_RANGE, why, order, nodeId=order.nodes[0].id)
    if why := around.unreachable(order.nodes, standing=not update or standing):
        return _refused(ErrorType.NO_ROUTE_TO_TARGET, why, order)
    return None


def _refused(kind: ErrorType, words: str, order: OrderMessage, **references: object) -> Verdict:
    fault = fault_of(kind, words, orderId=order.id, orderUpdateId=order.update, **references)
    return Verdict(outcome=OrderOutcome.REFUSED, fault=fault)
