"""ForeignVehicles: vehicles of others, as a master of ours hears and orders them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, NamedTuple

from fleet.gateway.errors import GatewayError
from fleet.gateway.transport import BrokerLink, Transport
from fleet.vda5050.codec import Body, Codec
from fleet.vda5050.dialects import Dialect
from fleet.vda5050.envelope import Envelope, Identity, Post
from fleet.vda5050.faults import MessageError
from fleet.vda5050.fields import instant_of, number_of, object_of, whole_of
from fleet.vda5050.growing_order import GrowingOrder
from fleet.vda5050.vehicle import Outgoing
from maps.reading.shown import shown

HEARD = ("state", "connection")
"""Topics that a master listens to."""


class _Stamp(NamedTuple):
    """What tells how old a state is."""

    number: int
    at: datetime
    said: str


_NEVER = _Stamp(-1, datetime.min.replace(tzinfo=UTC), "")
"""Older than all."""


@dataclass(frozen=True, kw_only=True)
class VehicleNote:
    """Something out of the ordinary that a vehicle did."""

    car: int
    """Number of the car that stands for it."""
    what: str
    of: str
    cause: str


class ForeignVehicles:
    """The connection of a master to its vehicles.

    Args:
        identities: Who they are; their places are the numbers of the cars of the run.
        dialect: What they speak.
        transport: Connects the master.
        start: The instant of simulated time zero, for headers.
    """

    def __init__(self, identities: Sequence[Identity], dialect: Dialect, transport: Transport, start: datetime) -> None:
        self.books: list[GrowingOrder | None] = [None] * len(identities)
        """Orders of each vehicle; None = there is none yet."""
        self.states: list[Body | None] = [None] * len(identities)
        """The newest state of each vehicle, in the words of 3.0.0; None = it has said nothing yet."""
        self.is_online = [False] * len(identities)
        self.n_malformed = 0
        """Messages that could not be read."""
        self._notes: list[VehicleNote] = []
        self._last_note: dict[int, VehicleNote] = {}
        self._newest = [_NEVER] * len(identities)
        self._identities = list(identities)
        self._codec = Codec(dialect)
        self._envelopes = [Envelope(identity, self._codec, start) for identity in self._identities]
        self._n_asked = 0
        self._car_of = {one.topic(dialect.level, name): car for car, one in enumerate(identities) for name in HEARD}
        self._link: BrokerLink = transport.link(list(self._car_of), None)

    def hear(self) -> None:
        """Take in what has come; what is older than the last state of its vehicle is left alone."""
        for topic, payload in self._link.received():
            car, name = self._car_of[topic], topic.rsplit("/", 1)[-1]
            try:
                body = self._codec.decode(name, payload)
                if name == "connection":
                    self._note_connection(car, str(body["connectionState"]))
                else:
                    self._note_state(car, body)
            except (MessageError, ArithmeticError, KeyError, TypeError, ValueError, AttributeError) as error:
                self.n_malformed += 1
                words = str(error) if isinstance(error, MessageError) else f"{name}: {type(error).__name__}: {error}"
                self._note(VehicleNote(car=car, what="message_refused", of=name, cause=words))

    def taken_notes(self) -> list[VehicleNote]:
        """What was out of the ordinary since the last call; what a vehicle says twice running is told once."""
        found, self._notes = self._notes, []
        return found

    def ask(self, now_s: float) -> None:
        """Ask the vehicles that have not spoken yet to say where they stand; else they may take 30 s.

        Args:
            now_s: Simulated time [s].
        """
        for car, state in enumerate(self.states):
            if state is None:
                self._n_asked += 1
                asked = {"actionType": "stateRequest", "actionId": f"state-{self._n_asked}", "blockingType": "NONE"}
                body: Body = {"actions": [asked | {"actionParameters": []}]}
                self._link.send(self._post(car, "instantActions", body, now_s))

    def speak(self, now_s: float) -> None:
        """Send the orders that are due.

        Args:
            now_s: Simulated time [s].
        """
        for car, book in enumerate(self.books):
            if book is not None and (message := book.message(now_s)) is not None:
                self._link.send(self._post(car, "order", message, now_s))

    def close(self) -> None:
        """End the connection; what was ordered is still driven."""
        self._link.close(None)

    def pose(self, car: int) -> tuple[float, float, float]:
        """Where a vehicle says that it stands [m, rad].

        Raises:
            GatewayError: It has not said so.
        """
        state = self.states[car]
        position: dict[str, Any] = {} if state is None else state.get("mobileRobotPosition") or {}
        if not {"x", "y", "theta"} <= position.keys():
            name = self._identities[car]
            raise GatewayError(
                f"vehicle {name.manufacturer}/{name.serial} has not said where it stands; valid: one that is online"
            )
        return float(position["x"]), float(position["y"]), float(position["theta"])

    def troubles(self) -> list[str]:
        """A line for each vehicle that is gone, and for each error that one reports."""
        found = []
        for name, state, is_online in zip(self._identities, self.states, self.is_online, strict=True):
            who = f"vehicle {name.manufacturer}/{name.serial}"
            if not is_online:
                found.append(f"{who} is not online")
            found += [f"{who} reports {kind}: {words}" for kind, words in _errors(state or {}).items()]
        return found

    def _note(self, note: VehicleNote) -> None:
        if self._last_note.get(note.car) != note:
            self._last_note[note.car] = note
            self._notes.append(note)

    def _note_connection(self, car: int, state: str) -> None:
        self.is_online[car] = state == "ONLINE"
        if self.is_online[car]:
            self._newest[car] = _NEVER  # it may have started anew, and counts from the beginning
        self._note(VehicleNote(car=car, what="connection", of=state, cause="it said so, or the broker in its name"))

    def _note_state(self, car: int, body: Body) -> None:
        stamp = _Stamp(
            whole_of(body, "headerId", "state"), instant_of(body, "timestamp", "state"), str(body["timestamp"])
        )
        _check_position(body)
        before = self._newest[car]
        if stamp.number <= before.number and stamp.at < before.at:
            return
        if stamp.at < before.at:
            words = f"timestamp is {shown(stamp.said)} after {shown(before.said)}"
            words += "; headerId tells that the state is newer"
            self._note(VehicleNote(car=car, what="clock_went_back", of="state", cause=words))
        self._newest[car] = stamp
        self.is_online[car] = True
        before_errors, errors = _errors(self.states[car] or {}), _errors(body)
        for kind in sorted(errors.keys() - before_errors.keys()):
            self._note(VehicleNote(car=car, what="vehicle_error", of=kind, cause=errors[kind]))
        book = self.books[car]
        if book is not None:
            book.heard(body)
        self.states[car] = body

    def _post(self, car: int, name: str, message: Body, now_s: float) -> Post:
        return self._envelopes[car].post(Outgoing(topic=name, body=message), now_s)


def _check_position(state: Body) -> None:
    """Refuse a state whose position, if it has one, is none."""
    if "mobileRobotPosition" in state:
        where = "state.mobileRobotPosition"
        position = object_of(state["mobileRobotPosition"], where)
        for name in ("x", "y", "theta"):
            if name in position:
                number_of(position, name, where)


def _errors(state: Body) -> dict[str, str]:
    """Types of the errors that a vehicle reports, and what it says of the last one of each."""
    return {
        str(error["errorType"]): shown(error.get("errorDescription", "")).strip("'")
        for error in state.get("errors", ())
    }
