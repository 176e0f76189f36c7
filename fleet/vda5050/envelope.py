"""Envelope: topics and headers: who speaks, in which dialect, and when."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from fleet.vda5050.codec import Codec
from fleet.vda5050.faults import ForeignMessageError, MessageError
from fleet.vda5050.vehicle import Outgoing
from maps.reading.shown import shown

RETAINED = frozenset({"connection", "factsheet"})
"""Topics whose last message the broker keeps for those that come later."""
SENT_SURELY = frozenset({"connection"})
"""Topics with quality of service 1; the others have 0."""
_NAME = re.compile(r"[A-Za-z0-9_.:-]+")


@dataclass(frozen=True, kw_only=True)
class Identity:
    """Who a vehicle is on the wire.

    Raises:
        MessageError: A name has signs that topics cannot have.
    """

    interface: str
    manufacturer: str
    serial: str

    def __post_init__(self) -> None:
        for name in ("interface", "manufacturer", "serial"):
            value = getattr(self, name)
            if not _NAME.fullmatch(value):
                raise MessageError(f"{name} is {shown(value)}; valid: letters, digits and _ . : -")

    def topic(self, level: str, name: str) -> str:
        """A topic of the vehicle, section 4.2."""
        return f"{self.interface}/{level}/{self.manufacturer}/{self.serial}/{name}"


@dataclass(frozen=True, kw_only=True)
class Post:
    """A message as it goes to the broker."""

    topic: str
    payload: bytes
    qos: int
    retain: bool


class Envelope:
    """Puts headers on the messages of one vehicle, and takes them off those that it gets.

    The clock of the headers is a start instant and the simulated time, and never runs backwards: openTCS drops a
    message that is older than the one before.

    Args:
        identity: Who the vehicle is.
        codec: Its dialect.
        start: The instant of simulated time zero.
    """

    def __init__(self, identity: Identity, codec: Codec, start: datetime) -> None:
        self.identity = identity
        self._codec = codec
        self._start = start
        self._last_s = 0.0
        self._sent: dict[str, int] = {}

    def topic(self, name: str) -> str:
        """A topic of the vehicle."""
        return self.identity.topic(self._codec.dialect.level, name)

    def post(self, message: Outgoing, now_s: float) -> Post:
        """A message with its header.

        Args:
            message: The message.
            now_s: Simulated time [s].
        """
        self._last_s = max(self._last_s, now_s)
        number = self._sent.get(message.topic, 0)
        self._sent[message.topic] = number + 1
        stamp = (self._start + timedelta(seconds=self._last_s)).isoformat(timespec="milliseconds")
        header = {
            "headerId": number,
            "timestamp": stamp.replace("+00:00", "Z"),
            "version": self._codec.dialect.version,
            "manufacturer": self.identity.manufacturer,
            "serialNumber": self.identity.serial,
        }
        body = self._codec.encode(message.topic, {**header, **message.body})
        return Post(
            topic=self.topic(message.topic),
            payload=json.dumps(body, separators=(",", ":")).encode(),
            qos=int(message.topic in SENT_SURELY),
            retain=message.topic in RETAINED,
        )

    def open(self, name: str, payload: bytes) -> dict[str, Any]:
        """A message to the vehicle in the words of 3.0.0.

        Args:
            name: Last level of its topic.
            payload: As it came.

        Raises:
            MessageError: It is no message.
            ForeignMessageError: It is of another version, or for another vehicle.
        """
        body = self._codec.decode(name, payload)
        for key, own in (("manufacturer", self.identity.manufacturer), ("serialNumber", self.identity.serial)):
            if body.get(key) != own:
                raise ForeignMessageError(f"{name}: {key} is {shown(body.get(key))}; valid: {own!r}")
        return body
