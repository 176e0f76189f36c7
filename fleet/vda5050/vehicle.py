"""Vehicle: the state machine of a vehicle: orders, instant actions and what it notices go in, messages come out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from fleet.vda5050.acceptance import HeldOrder, OperatingMode, OrderOutcome, VehicleSurroundings, Verdict, judge
from fleet.vda5050.faults import ErrorLevel, ErrorType, MessageError, VehicleFault, fault_of
from fleet.vda5050.fields import Body
from fleet.vda5050.order import Action, Blocking, Edge, Node, OrderMessage, instant_actions_of, order_of
from fleet.vda5050.sight import Sight
from maps.reading.shown import shown

ORDER_FAULTS = frozenset(ErrorType) - {ErrorType.INVALID_INSTANT_ACTION}
"""Types that are reported until an order is accepted; what vehicles report of themselves stays longer."""
INSTANT_ACTIONS = (
    "startPause",
    "stopPause",
    "cancelOrder",
    "stateRequest",
    "factsheetRequest",
    "clearInstantActions",
)
"""What every vehicle does at once when it is asked."""
MOST_INSTANT = 50
"""Instant actions that a state tells of at most; of the ended ones the oldest are forgotten."""


class ActionStatus(StrEnum):
    """How far an action is, table 12."""

    WAITING = "WAITING"
    INITIALIZING = "INITIALIZING"
    RUNNING = "RUNNING"
    FINISHED = "FINISHED"
    FAILED = "FAILED"

    @property
    def has_ended(self) -> bool:
        """Whether nothing more comes of it."""
        return self in (ActionStatus.FINISHED, ActionStatus.FAILED)


class ConnectionState(StrEnum):
    """What the topic `connection` says."""

    ONLINE = "ONLINE"
    OFFLINE = "OFFLINE"
    BROKEN = "CONNECTION_BROKEN"


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How often messages are sent, in simulated time."""

    most_s: float = 30.0
    """Longest time between two states; the standard allows 30 [s]."""
    least_s: float = 0.02
    """Shortest time between two states [s]."""
    visualization_s: float = 1.0
    """Time between two visualizations [s]; inf = none."""


@dataclass(frozen=True, kw_only=True)
class Outgoing:
    """A message in the words of 3.0.0, without its header."""

    topic: str
    body: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class ActionState:
    """An action and how far it is."""

    action: Action
    status: ActionStatus
    result: str = ""

    def body(self) -> dict[str, Any]:
        """As the state message has it."""
        body = {"actionId": self.action.id, "actionType": self.action.type, "actionStatus": self.status.value}
        if self.action.descriptor:
            body["actionDescriptor"] = self.action.descriptor
        if self.result:
            body["actionResult"] = self.result
        return body


class Vehicle:
    """What one vehicle has been told, and how far it is.

    Args:
        around: What it knows of itself and of its floor.
        factsheet: Body of its factsheet.
        timing: How often it sends.
        strict_updates: See `Dialect`.
    """

    def __init__(
        self, around: VehicleSurroundings, factsheet: dict[str, Any], timing: Timing, *, strict_updates: bool
    ) -> None:
        self.mode = OperatingMode.AUTOMATIC
        self.paused = False
        self.last_node, self.last_sequence = "", 0
        self._around = around
        self._factsheet = factsheet
        self._timing = timing
        self._strict_updates = strict_updates
        self._held = HeldOrder()
        self._nodes: list[Node] = []
        self._edges: list[Edge] = []
        self._actions: dict[str, ActionState] = {}
        self._queue: list[str] = []
        """Actions of the nodes that were passed that have not ended, in their order."""
        self._instant: dict[str, ActionState] = {}
        self._cancelling: str | None = None
        """The instant action that cancels the order, as long as it has not ended."""
        self._faults: list[VehicleFault] = []
        self._wanted = {"connection", "factsheet", "state"}
        self._told: tuple[object, ...] = ()
        self._told_s = self._shown_s = -math.inf
        self._n_states = 0

    # --- what it is told

    def order(self, body: Body) -> Verdict:
        """Take an order message, or refuse it; either way the next state tells.

        Args:
            body: In the words of 3.0.0.
        """
        try:
            order = order_of(body)
        except MessageError as error:
            return self.malformed(str(error), body)
        held = replace(self._held, idle=self.idle, actions=frozenset(self._actions))
        verdict = judge(order, held, self.mode, self._around, strict_updates=self._strict_updates)
        self._wanted.add("state")
        if verdict.fault is not None:
            self.report(verdict.fault)
        elif verdict.outcome is not OrderOutcome.REPEATED:
            self._faults = [fault for fault in self._faults if fault.type not in ORDER_FAULTS]
            self._take(order, anew=verdict.outcome is OrderOutcome.NEW)
        return verdict

    def malformed(self, words: str, body: Body | None = None) -> Verdict:
        """Note that an order message cannot be read."""
        known = {name: shown(body[name]).strip("'") for name in ("orderId", "orderUpdateId") if body and name in body}
        fault = fault_of(ErrorType.VALIDATION_FAILURE, words, **known)
        self.report(fault)
        return Verdict(outcome=OrderOutcome.REFUSED, fault=fault)

    def instant_actions(self, body: Body) -> None:
        """Do what a message of instant actions asks for; one that came before is left alone."""
        try:
            actions = instant_actions_of(body)
        except MessageError as error:
            self.report(fault_of(ErrorType.INVALID_INSTANT_ACTION, str(error)))
            return
        for action in actions:
            if action.id not in self._instant:
                self._do_at_once(action)
        self._forget_ended()
        self._wanted.add("state")

    def came_online(self) -> None:
        """A connection was made, or made again: masters may have missed what was said."""
        self._wanted |= {"connection", "factsheet", "state"}

    # --- what it notices

    def arrived(self) -> None:
        """The vehicle stands at, or passes, the next node."""
        node = self._nodes.pop(0)
        self._edges = [edge for edge in self._edges if edge.sequence > node.sequence]
        self.last_node, self.last_sequence = node.id, node.sequence
        self._queue += [action.id for action in node.actions if not self._actions[action.id].status.has_ended]
        self._wanted.add("state")

    def acted(self, action_id: str, status: ActionStatus, result: str = "") -> None:
        """An action of the order has begun, or ended."""
        state = self._actions[action_id]
        self._actions[action_id] = replace(state, status=status, result=result)
        self._wanted.add("state")
        if status.has_ended:
            self._queue = [other for other in self._queue if other != action_id]

    def stands(self) -> None:
        """The vehicle stands still with nothing granted: an order that is being cancelled may end."""
        cancels = self._cancelling
        if cancels is not None and all(state.status.has_ended for state in self._actions.values()):
            self._cancelling = None
            self._instant[cancels] = replace(self._instant[cancels], status=ActionStatus.FINISHED)
            self._wanted.add("state")

    def report(self, fault: VehicleFault) -> None:
        """Report a fault; a further one of its type takes its place."""
        self._faults = [other for other in self._faults if other.type != fault.type] + [fault]
        self._wanted.add("state")

    def withdraw(self, kind: str) -> None:
        """End the report of a type of fault, if there is one."""
        left = [fault for fault in self._faults if fault.type != kind]
        if len(left) < len(self._faults):
            self._faults = left
            self._wanted.add("state")

    def fail(self, fault: VehicleFault) -> None:
        """The vehicle is out of service: its order is cleared, and it takes no other (section 6.6.7)."""
        self.report(fault)
        self._clear("the vehicle is out of service")
        for action_id in [one for one, state in self._actions.items() if not state.status.has_ended]:
            self.acted(action_id, ActionStatus.FAILED, "the vehicle is out of service")
        self.mode = OperatingMode.SERVICE
        self.last_node = ""

    def recover(self, kind: str) -> None:
        """The vehicle is in service again."""
        self.withdraw(kind)
        self.mode = OperatingMode.AUTOMATIC

    # --- what it is to do

    @property
    def idle(self) -> bool:
        """Whether it may take a new order (section 6.6.8)."""
        ended = all(state.status.has_ended for state in self._actions.values())
        return not self._nodes and not self._edges and ended and self._cancelling is None

    @property
    def route(self) -> Sequence[Node]:
        """Nodes that it may drive to now, in their order; the last is where it stops. Empty = it stays."""
        if self.paused or self._cancelling is not None or any(self._blocking(one).stops for one in self._queue):
            return ()
        route = []
        for node in self._nodes:
            if not node.released:
                break
            route.append(node)
            if node.stops:
                break
        return route

    @property
    def due(self) -> tuple[Action, ...]:
        """Actions that may begin now, by their blocking types (section 6.2.2)."""
        found: list[Action] = []
        for k, action_id in enumerate(self._queue):
            state = self._actions[action_id]
            waits = state.status is ActionStatus.WAITING
            if state.action.blocking.is_alone:
                if waits and k == 0 and not self.paused:
                    found.append(state.action)
                break
            if waits and not self.paused:
                found.append(state.action)
        return tuple(found)

    @property
    def is_cancelling(self) -> bool:
        """Whether its order is being cancelled."""
        return self._cancelling is not None

    @property
    def order_id(self) -> str:
        """The order that it has, or had last."""
        return self._held.order_id

    def action(self, action_id: str) -> ActionState:
        """An action of the order, and how far it is."""
        return self._actions[action_id]

    # --- what it says

    def messages(self, sight: Sight, now_s: float) -> list[Outgoing]:
        """What is to be sent now: whatever was asked for, and a state if something has changed or time is up.

        Args:
            sight: What it measures.
            now_s: Simulated time [s].
        """
        found = []
        if "connection" in self._wanted:
            found.append(connection(ConnectionState.ONLINE))
        if "factsheet" in self._wanted:
            found.append(Outgoing(topic="factsheet", body=self._factsheet))
        self._wanted &= {"state"}
        since_s = now_s - self._told_s
        noticed = (sight.driving, sight.charging, sight.loads)
        changed = bool(self._wanted) or noticed != self._told
        if since_s >= (self._timing.least_s if changed else self._timing.most_s):
            self._wanted.clear()
            self._told, self._told_s = noticed, now_s
            self._n_states += 1
            found.append(Outgoing(topic="state", body=self._state(sight)))
        if now_s - self._shown_s >= self._timing.visualization_s:
            self._shown_s = now_s
            body = {
                "referenceStateHeaderId": max(0, self._n_states - 1),
                "mobileRobotPosition": sight.position(),
                "velocity": sight.velocity(),
            }
            found.append(Outgoing(topic="visualization", body=body))
        return found

    def _state(self, sight: Sight) -> dict[str, Any]:
        base = [node for node in self._nodes if node.released]
        return {
            "maps": [{"mapId": one, "mapVersion": "1", "mapStatus": "ENABLED"} for one in sorted(self._around.maps)],
            "orderId": self._held.order_id,
            "orderUpdateId": self._held.update,
            "lastNodeId": self.last_node,
            "lastNodeSequenceId": self.last_sequence,
            "nodeStates": [node.body() for node in self._nodes],
            "edgeStates": [edge.body() for edge in self._edges],
            "driving": sight.driving,
            "paused": self.paused,
            "newBaseRequest": len(base) <= 1 and len(self._nodes) > len(base),
            "loads": [load.body() for load in sight.loads],
            "actionStates": [state.body() for state in self._actions.values()],
            "instantActionStates": [state.body() for state in self._instant.values()],
            "powerSupply": {"stateOfCharge": round(sight.charge_percent, 1), "charging": sight.charging},
            "operatingMode": self.mode.value,
            "errors": [fault.body() for fault in self._faults],
            "safetyState": {"activeEmergencyStop": "NONE", "fieldViolation": False},
            "mobileRobotPosition": sight.position(),
            "velocity": sight.velocity(),
            **sight.planned_path(),
        }

    # --- inside

    def _take(self, order: OrderMessage, *, anew: bool) -> None:
        if anew:
            self._actions = {}
            self._queue = []
            self._nodes, self._edges = list(order.nodes), list(order.edges)
        else:
            # What was not released may come otherwise; the base and what it does stay.
            base = [node for node in self._nodes if node.released]
            kept = {action.id for node in base for action in node.actions}
            dropped = {action.id for node in self._nodes for action in node.actions} - kept
            self._actions = {one: state for one, state in self._actions.items() if one not in dropped}
            self._nodes = [*base, *order.nodes[1:]]
            self._edges = [edge for edge in self._edges if edge.released] + list(order.edges)
        for action in order.actions:
            self._actions.setdefault(action.id, ActionState(action=action, status=ActionStatus.WAITING))
        last = [node for node in order.nodes if node.released][-1]
        self._held = HeldOrder(order_id=order.id, update=order.update, fields=order.fields, decision_point=last)
        if anew:
            self.arrived()  # it stands there already

    def _blocking(self, action_id: str) -> Blocking:
        return self._actions[action_id].action.blocking

    def _clear(self, why: str) -> None:
        """Drop the order (section 6.6.7): what has not begun fails, what runs goes on."""
        for action_id, state in self._actions.items():
            if state.status is ActionStatus.WAITING:
                self._actions[action_id] = replace(state, status=ActionStatus.FAILED, result=why)
        self._queue = [one for one in self._queue if not self._actions[one].status.has_ended]
        self._nodes, self._edges = [], []
        self._held = replace(self._held, cancelled=True)

    def _do_at_once(self, action: Action) -> None:
        """Begin an instant action, and end it if nothing has to be waited for."""
        status, result = ActionStatus.FINISHED, ""
        if action.type == "cancelOrder":
            status, result = self._cancel(action)
        elif action.type == "startPause":
            self.paused = True
        elif action.type == "stopPause":
            self.paused = False
        elif action.type == "clearInstantActions":
            self._instant = {one: state for one, state in self._instant.items() if not state.status.has_ended}
        elif action.type == "factsheetRequest":
            self._wanted.add("factsheet")
        elif action.type != "stateRequest":
            status, result = (
                ActionStatus.FAILED,
                f"actionType is {shown(action.type)}; valid: {', '.join(INSTANT_ACTIONS)}",
            )
            self.report(fault_of(ErrorType.INVALID_INSTANT_ACTION, result, actionId=action.id))
        if status is not ActionStatus.FAILED:
            self.withdraw(ErrorType.INVALID_INSTANT_ACTION.value)
        self._instant[action.id] = ActionState(action=action, status=status, result=result)

    def _cancel(self, action: Action) -> tuple[ActionStatus, str]:
        asked = action.parameters.get("orderId", self._held.order_id)
        if self.idle or asked != self._held.order_id or self._cancelling is not None:
            words = f"no order {asked!r} is active" if asked else "no order is active"
            self.report(fault_of(ErrorType.NO_ORDER_TO_CANCEL, words, actionId=action.id))
            return ActionStatus.FAILED, words
        self._clear("the order was cancelled")
        self._cancelling = action.id
        return ActionStatus.RUNNING, ""

    def _forget_ended(self) -> None:
        ended = [one for one, state in self._instant.items() if state.status.has_ended]
        for one in ended[: max(0, len(self._instant) - MOST_INSTANT)]:
            del self._instant[one]


def connection(state: ConnectionState) -> Outgoing:
    """What the topic `connection` says."""
    return Outgoing(topic="connection", body={"connectionState": state.value})


OUT_OF_SERVICE = "mobileRobotOutOfService"
"""Type of the fault of a vehicle that somebody has to look after; the standard leaves such types to vendors."""


def out_of_service(why: str) -> VehicleFault:
    """The fault of a vehicle that takes no more orders."""
    return VehicleFault(type=OUT_OF_SERVICE, description=why, level=ErrorLevel.FATAL)
