"""GrowingOrder: the order of one vehicle as its master keeps it: it grows by nodes, and is sent again until known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

RESEND_S = 2.0
"""Time after which what was not answered is sent again: quality of service 0 may lose it [s]."""
DEVIATION_M = 0.3
"""How far from a node a vehicle may pass it: less than half a cell [m]."""


@dataclass(frozen=True, kw_only=True)
class Waypoint:
    """A node that a vehicle is to pass."""

    name: str
    x: float
    y: float
    map_id: str

    def body(self, number: int) -> dict[str, Any]:
        """As an order has it."""
        deviation = {"a": DEVIATION_M, "b": DEVIATION_M, "theta": 0.0}
        position = {"x": self.x, "y": self.y, "mapId": self.map_id, "allowedDeviationXY": deviation}
        return {
            "nodeId": self.name,
            "sequenceId": 2 * number,
            "released": True,
            "nodePosition": position,
            "actions": [],
        }


class GrowingOrder:
    """One order whose base is what was granted; there is no horizon, as plans change.

    An update is sent when the one before it is known to the vehicle, with all nodes that have been granted since; so
    there is at most one update for each node. A vehicle that has forgotten its order, as after a restart, gets a new
    one from where it passed last.

    Args:
        order_id: What its orders are called; a number follows.
        start: Where the vehicle stands.
    """

    def __init__(self, order_id: str, start: Waypoint) -> None:
        self.n_passed = 0
        """Waypoints passed so far, without the start."""
        self.n_updates = 0
        """Orders and updates so far, without repetitions."""
        self.refusal = ""
        """What the vehicle said last of an order of ours that it did not take; empty = nothing."""
        self._id = order_id
        self._n_orders = 1
        self._points = [start]
        self._first = 0
        """Number, among all waypoints, of the first node of the present order."""
        self._n_sent = 0
        """Nodes of the present order that have been sent."""
        self._update = -1
        self._known = True
        self._was_known = False
        self._body: dict[str, Any] = {}
        self._sent_s = 0.0

    @property
    def order_id(self) -> str:
        """The present order."""
        return f"{self._id}-{self._n_orders}"

    def extend(self, point: Waypoint) -> None:
        """Release one more node."""
        self._points.append(point)

    def heard(self, state: Mapping[str, Any]) -> None:
        """Take in a state message, newer than the last, in the words of 3.0.0."""
        if state["orderId"] != self.order_id:
            self._note_refusal(state)
            if self._was_known:
                self._begin_anew()
            return
        if state["orderUpdateId"] >= self._update:
            self._known = self._was_known = True
            self.refusal = ""
        else:
            self._note_refusal(state)
        passed = self._first + int(state["lastNodeSequenceId"]) // 2
        self.n_passed = max(self.n_passed, min(passed, len(self._points) - 1))

    def message(self, now_s: float) -> dict[str, Any] | None:
        """The order message that is to be sent now, without its header; None = none.

        Args:
            now_s: Time of any clock that does not run backwards [s].
        """
        nodes = self._points[self._first :]
        if self._known and len(nodes) > max(self._n_sent, 1):
            begin = max(self._n_sent - 1, 0)
            self._update += 1
            self._body = self._order(nodes, begin)
            self._n_sent, self._known = len(nodes), False
            self.n_updates += 1
        elif self._known or now_s - self._sent_s < RESEND_S:
            return None
        self._sent_s = now_s
        return self._body

    def _order(self, nodes: list[Waypoint], begin: int) -> dict[str, Any]:
        numbers = range(begin, len(nodes))
        return {
            "orderId": self.order_id,
            "orderUpdateId": self._update,
            "nodes": [nodes[number].body(number) for number in numbers],
            "edges": [
                {
                    "edgeId": f"{nodes[number].name} --- {nodes[number + 1].name}",
                    "sequenceId": 2 * number + 1,
                    "released": True,
                    "actions": [],
                }
                for number in numbers[:-1]
            ],
        }

    def _note_refusal(self, state: Mapping[str, Any]) -> None:
        for error in state["errors"]:
            values = [one.get("referenceValue") for one in error.get("errorReferences", ())]
            if self.order_id in values:
                self.refusal = f"{error['errorType']}: {error.get('errorDescription', '')}"

    def _begin_anew(self) -> None:
        self._n_orders += 1
        self._first = self.n_passed
        self._n_sent, self._update = 0, -1
        self._known, self._was_known = True, False
