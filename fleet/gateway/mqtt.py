"""Mqtt: connections of vehicles and masters to an MQTT broker, with threads of their own; no run waits for them."""

from __future__ import annotations

import ssl
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from fleet.gateway.errors import GatewayError, RefusedError
from fleet.gateway.transport import BrokerLink, matches
from fleet.vda5050.envelope import Post

PORTS = {"mqtt": 1883, "mqtts": 8883}
"""Schemes of addresses and their usual ports."""
PATIENCE_S = 10.0
"""How long a first connection may take; later ones are tried again and again [s]."""
MOST_KEPT = 1000
"""Messages that are kept for a vehicle whose run does not take them; the oldest are forgotten."""
_UNAVAILABLE = 0x88
"""What a broker says that is up but not yet there for us (section 3.2.2.2 of https://docs.oasis-open.org/mqtt/mqtt/v5.0)."""


@dataclass(frozen=True, kw_only=True)
class BrokerAddress:
    """Where a broker is, and how it knows us.

    Raises:
        GatewayError: The address is none of MQTT, or a file is missing or holds something else.
    """

    url: str
    """Such as mqtt://127.0.0.1:1883, or mqtts:// for TLS."""
    user: str = ""
    password: str = ""
    ca: Path | None = None
    """Certificates of those that may vouch for the broker; None = the system's, with mqtts."""
    certificate: Path | None = None
    """Our own certificate."""
    key: Path | None = None
    """Its key."""
    keep_alive_s: int = 15
    """The broker reads out the will of a car that it has not heard of for one and a half of this [s]."""

    def __post_init__(self) -> None:
        valid = "mqtt://HOST:PORT or mqtts://HOST:PORT"
        try:
            parts = urlsplit(self.url)
            nowhere = parts.port == 0  # raises if it is no number
        except ValueError as error:
            raise GatewayError(f"--vda5050 is {self.url!r} ({error}); valid: {valid}") from error
        if parts.scheme not in PORTS or not parts.hostname or nowhere or parts.path.strip("/") or parts.query:
            raise GatewayError(f"--vda5050 is {self.url!r}; valid: {valid}")
        if parts.username or parts.password:
            raise GatewayError("--vda5050 has a user in it; valid: --user and --password-file")
        for name in ("ca", "certificate", "key"):
            path = getattr(self, name)
            if path is not None and not path.is_file():
                raise GatewayError(f"--{name} is {str(path)!r}; valid: a file that is there")
            if path is not None and parts.scheme != "mqtts":
                raise GatewayError(
                    f"--{name} is {str(path)!r} for {self.url}, which has no TLS; valid: mqtts://HOST:PORT"
                )
        self.context()

    @property
    def host(self) -> str:
        """Its host."""
        return str(urlsplit(self.url).hostname)

    @property
    def port(self) -> int:
        """Its port."""
        parts = urlsplit(self.url)
        return parts.port or PORTS[parts.scheme]

    @property
    def tls(self) -> bool:
        """Whether the connection is encrypted."""
        return urlsplit(self.url).scheme == "mqtts"

    def context(self) -> ssl.SSLContext | None:
        """What encrypts a connection; None = nothing does.

        Raises:
            GatewayError: A file is no certificate, or the key is another one.
        """
        if not self.tls:
            return None
        try:
            made = ssl.create_default_context(cafile=None if self.ca is None else str(self.ca))
        except (OSError, ValueError) as error:
            raise GatewayError(f"--ca is {str(self.ca)!r} ({_why(error)}); valid: certificates in PEM") from error
        if self.certificate is not None:
            try:
                # An empty passphrase: else OpenSSL asks for one in the terminal.
                made.load_cert_chain(str(self.certificate), None if self.key is None else str(self.key), password="")
            except (OSError, ValueError) as error:
                said = f"--certificate is {str(self.certificate)!r}, --key {str(self.key)!r} ({_why(error)})"
                raise GatewayError(f"{said}; valid: a certificate in PEM, and its key without a passphrase") from error
        return made


class MqttClient:
    """One connection to a broker, with a thread of its own.

    Args:
        address: The broker.
        name: Name of the client.
        will: What the broker sends when it is gone without a word; None = nothing.
        came: Called in the client's thread with topic and payload of what has come.

    Raises:
        GatewayError: The broker cannot be reached.
        RefusedError: It does not let us in, or is not who it should be.
    """

    def __init__(
        self, address: BrokerAddress, name: str, will: Post | None, came: Callable[[str, bytes], None] | None = None
    ) -> None:
        self.n_sessions = 0
        """Connections made so far."""
        self._topics: list[str] = []
        self._came = came
        self._answered, self._subscribed = threading.Event(), threading.Event()
        self._trouble, self._refused = "", False
        self._client = made = mqtt.Client(CallbackAPIVersion.VERSION2, client_id=name, clean_session=True)
        if will is not None:
            made.will_set(will.topic, will.payload, will.qos, will.retain)
        if address.user:
            made.username_pw_set(address.user, address.password or None)
        made.on_connect = self._connected
        made.on_message = self._heard
        made.on_subscribe = lambda *_: self._subscribed.set()
        made.reconnect_delay_set(min_delay=1, max_delay=15)
        made.on_disconnect = self._ended
        broker = f"the broker at {address.url}"
        try:
            if (context := address.context()) is not None:
                made.tls_set_context(context)
            made.connect(address.host, address.port, address.keep_alive_s)
        except ssl.SSLCertVerificationError as error:
            valid = "--ca with the certificates of those that vouch for it, and the name that stands in its own"
            raise RefusedError(f"{broker} is not trusted: {error.verify_message}; valid: {valid}") from error
        except (OSError, ValueError) as error:
            raise GatewayError(
                f"{broker} cannot be reached: {_why(error)}; valid: the address of a broker that runs"
            ) from error
        made.loop_start()
        trouble = self._trouble if self._answered.wait(PATIENCE_S) else "no answer"
        if trouble:
            made.loop_stop()
            if self._refused:
                raise RefusedError(f"{broker} refuses us: {trouble}; valid: --user and --password-file that it knows")
            valid = "mqtts:// where it has TLS, and --certificate where it wants ours"
            raise GatewayError(f"{broker} does not let us in: {trouble}; valid: {valid}")

    def listen(self, patterns: Sequence[str]) -> None:
        """Listen to topics, too; their levels may be `+`.

        Returns when the broker knows, so that nothing is missed. A broker that does not answer is told again with the
        next connection.
        """
        new = [pattern for pattern in patterns if pattern not in self._topics]
        if new:
            self._topics += new
            self._subscribed.clear()
            self._client.subscribe([(pattern, 0) for pattern in new])
            self._subscribed.wait(PATIENCE_S)

    def send(self, post: Post) -> None:
        """See `BrokerLink`; while there is no connection, posts are forgotten, as those of QoS 0 would be."""
        if self._client.is_connected():
            self._client.publish(post.topic, post.payload, post.qos, post.retain)

    def close(self, last: Post | None) -> None:
        """See `BrokerLink`."""
        if last is not None and self._client.is_connected():
            # Where the connection has just gone the broker says it for us: it has our will.
            with suppress(RuntimeError, ValueError):
                self._client.publish(last.topic, last.payload, last.qos, last.retain).wait_for_publish(1.0)
        self._client.disconnect()
        self._client.loop_stop()

    # --- called in the client's thread

    def _connected(self, client: mqtt.Client, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        del data, flags, properties
        if reason.is_failure:
            self._trouble, self._refused = str(reason), reason.value != _UNAVAILABLE
        else:
            if self._topics:
                client.subscribe([(pattern, 0) for pattern in self._topics])
            self.n_sessions += 1
        self._answered.set()

    def _ended(self, client: mqtt.Client, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        del client, data, flags, reason, properties
        if not self._answered.is_set():
            self._trouble = "it ended the connection"
            self._answered.set()

    def _heard(self, client: mqtt.Client, data: Any, message: mqtt.MQTTMessage) -> None:
        del client, data
        # amqtt 0.12 also brings retained messages of topics that were not asked for.
        if self._came is not None and any(matches(pattern, message.topic) for pattern in self._topics):
            self._came(message.topic, bytes(message.payload))


class MqttLink:
    """The connection of a master; see `fleet.gateway.transport.BrokerLink`.

    Args:
        address: The broker.
        name: Name of the client.
        topics: What it listens to.

    Raises:
        GatewayError: See `MqttClient`.
    """

    def __init__(self, address: BrokerAddress, name: str, topics: Sequence[str]) -> None:
        self._inbox = _Inbox()
        self._client = MqttClient(address, name, None, self._inbox.put)
        self._client.listen(topics)

    @property
    def n_sessions(self) -> int:
        """See `BrokerLink`."""
        return self._client.n_sessions

    def send(self, post: Post) -> None:
        """See `BrokerLink`."""
        self._client.send(post)

    def received(self) -> list[tuple[str, bytes]]:
        """See `BrokerLink`."""
        return self._inbox.taken()

    def close(self, last: Post | None) -> None:
        """See `BrokerLink`."""
        self._client.close(last)


class VehicleLink:
    """The connection of a vehicle; see `fleet.gateway.transport.BrokerLink`.

    A connection of its own has its last will and says whether it is online; all else goes over one that the vehicles of
    a process share, as a message costs a broker the more, the more connections and subscriptions it has.

    Args:
        own: Its own connection.
        will: Its last will.
        shared: What all share.
        topics: What it listens to.
    """

    def __init__(self, own: MqttClient, will: Post, shared: SharedConnection, topics: Sequence[str]) -> None:
        self._own, self._will, self._shared = own, will, shared
        self._topics, self._inbox = tuple(topics), _Inbox()
        shared.join(self._topics, self._inbox.put)

    @property
    def n_sessions(self) -> int:
        """See `BrokerLink`."""
        return self._own.n_sessions + self._shared.client.n_sessions

    def send(self, post: Post) -> None:
        """See `BrokerLink`."""
        client = self._own if post.topic == self._will.topic else self._shared.client
        client.send(post)

    def received(self) -> list[tuple[str, bytes]]:
        """See `BrokerLink`."""
        return self._inbox.taken()

    def close(self, last: Post | None) -> None:
        """See `BrokerLink`."""
        self._own.close(last)
        self._shared.leave(self._topics)


class SharedConnection:
    """A connection for what vehicles hear and say.

    Args:
        address: The broker.
        name: Name of the client.

    Raises:
        GatewayError: See `MqttClient`.
    """

    def __init__(self, address: BrokerAddress, name: str) -> None:
        self._came_to: dict[str, Callable[[str, bytes], None]] = {}
        self.client = MqttClient(address, name, None, self._came)

    @property
    def used(self) -> bool:
        """Whether a vehicle listens."""
        return bool(self._came_to)

    def join(self, topics: Sequence[str], came: Callable[[str, bytes], None]) -> None:
        """Hear for a vehicle, with one subscription to a topic for vehicles of all serial numbers."""
        self._came_to |= dict.fromkeys(topics, came)
        self.client.listen(["/".join([*topic.split("/")[:3], "+", *topic.split("/")[4:]]) for topic in topics])

    def leave(self, topics: Sequence[str]) -> None:
        """Hear no more for a vehicle; the last one ends the connection."""
        for topic in topics:
            self._came_to.pop(topic, None)
        if not self._came_to:
            self.client.close(None)

    def _came(self, topic: str, payload: bytes) -> None:
        came = self._came_to.get(topic)
        if came is not None:
            came(topic, payload)


class MqttTransport:
    """Connects vehicles to a broker; see `fleet.gateway.transport.Transport`.

    Args:
        address: The broker.
        prefix: Begins the names of all clients, which a broker must know apart.
    """

    def __init__(self, address: BrokerAddress, prefix: str) -> None:
        self._address = address
        self._prefix = prefix
        self._shared: SharedConnection | None = None

    def link(self, topics: Sequence[str], will: Post | None) -> BrokerLink:
        """See `Transport`."""
        if will is None:
            return MqttLink(self._address, f"{self._prefix}-master", topics)
        # A will is in the name of a vehicle, whose manufacturer and serial number stand in its topic.
        manufacturer, serial = will.topic.split("/")[2:4]
        own = MqttClient(self._address, f"{self._prefix}-{manufacturer}-{serial}", will)
        if self._shared is None or not self._shared.used:
            try:
                self._shared = SharedConnection(self._address, f"{self._prefix}-{manufacturer}")
            except GatewayError:
                own.close(None)
                raise
        return VehicleLink(own, will, self._shared, topics)


class _Inbox:
    """What has come and was not taken yet."""

    def __init__(self) -> None:
        self._messages: deque[tuple[str, bytes]] = deque(maxlen=MOST_KEPT)

    def put(self, topic: str, payload: bytes) -> None:
        """Keep a message."""
        self._messages.append((topic, payload))

    def taken(self) -> list[tuple[str, bytes]]:
        """Take out all of them."""
        found = []
        while self._messages:
            found.append(self._messages.popleft())
        return found


def _why(error: Exception) -> str:
    """What a system says of a failure, without the place in its own source."""
    words = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return words.partition(" (_ssl.c")[0]
