"""Mqtt: connections of vehicles to an MQTT broker, each with a thread of its own; the run never waits for it."""

from __future__ import annotations

import ssl
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from fleet.gateway.errors import GatewayError
from fleet.gateway.transport import matches
from fleet.vda5050.envelope import Post

PORTS = {"mqtt": 1883, "mqtts": 8883}
"""Schemes of addresses and their usual ports."""
PATIENCE_S = 10.0
"""How long a first connection may take; later ones are tried again and again [s]."""
MOST_KEPT = 1000
"""Messages that are kept for a run that does not take them; the oldest are forgotten."""


@dataclass(frozen=True, kw_only=True)
class BrokerAddress:
    """Where a broker is, and how it knows us.

    Raises:
        GatewayError: The address is none of MQTT, or a file is missing.
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
            _ = parts.port  # raises if it is no number
        except ValueError as error:
            raise GatewayError(f"--vda5050 is {self.url!r} ({error}); valid: {valid}") from error
        if parts.scheme not in PORTS or not parts.hostname or parts.path.strip("/") or parts.query:
            raise GatewayError(f"--vda5050 is {self.url!r}; valid: {valid}")
        if parts.username or parts.password:
            raise GatewayError("--vda5050 has a user in it; valid: --user and --password-file")
        for name in ("ca", "certificate", "key"):
            path = getattr(self, name)
            if path is not None and not path.is_file():
                raise GatewayError(f"--{name} is {str(path)!r}; valid: a file that is there")

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


class MqttLink:
    """The connection of one vehicle; see `fleet.gateway.transport.BrokerLink`.

    Args:
        address: The broker.
        client: Name of the client.
        topics: What it listens to.
        will: What the broker sends when it is gone without a word; None = nothing.

    Raises:
        GatewayError: The broker cannot be reached, or refuses.
    """

    def __init__(self, address: BrokerAddress, client: str, topics: Sequence[str], will: Post | None) -> None:
        self.n_sessions = 0
        self._inbox: deque[tuple[str, bytes]] = deque(maxlen=MOST_KEPT)
        self._topics = [(topic, 0) for topic in topics]
        self._answered = threading.Event()
        self._refusal = ""
        self._client = made = mqtt.Client(CallbackAPIVersion.VERSION2, client_id=client, clean_session=True)
        if will is not None:
            made.will_set(will.topic, will.payload, will.qos, will.retain)
        if address.user:
            made.username_pw_set(address.user, address.password or None)
        made.on_connect = self._connected
        made.on_message = self._came
        made.reconnect_delay_set(min_delay=1, max_delay=15)
        where = f"the broker at {address.url} cannot be reached"
        try:
            if address.tls:
                made.tls_set(
                    ca_certs=None if address.ca is None else str(address.ca),
                    certfile=None if address.certificate is None else str(address.certificate),
                    keyfile=None if address.key is None else str(address.key),
                )
            made.connect(address.host, address.port, address.keep_alive_s)
        except (OSError, ssl.SSLError, ValueError) as error:
            raise GatewayError(f"{where}: {error}; valid: the address of a broker that runs") from error
        made.loop_start()
        if not self._answered.wait(PATIENCE_S) or self._refusal:
            made.loop_stop()
            raise GatewayError(f"{where}: {self._refusal or 'no answer'}; valid: a broker that lets us in")

    def send(self, post: Post) -> None:
        """See `BrokerLink`; while there is no connection, posts are forgotten, as those of QoS 0 would be."""
        if self._client.is_connected():
            self._client.publish(post.topic, post.payload, post.qos, post.retain)

    def received(self) -> list[tuple[str, bytes]]:
        """See `BrokerLink`."""
        found = []
        while self._inbox:
            found.append(self._inbox.popleft())
        return found

    def close(self, last: Post | None) -> None:
        """See `BrokerLink`."""
        if last is not None and self._client.is_connected():
            self._client.publish(last.topic, last.payload, last.qos, last.retain).wait_for_publish(1.0)
        self._client.disconnect()
        self._client.loop_stop()

    # --- called in the client's thread

    def _connected(self, client: mqtt.Client, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        del data, flags, properties
        if reason.is_failure:
            self._refusal = str(reason)
        else:
            client.subscribe(self._topics)
            self.n_sessions += 1
        self._answered.set()

    def _came(self, client: mqtt.Client, data: Any, message: mqtt.MQTTMessage) -> None:
        del client, data
        # amqtt 0.12 also brings retained messages of topics that were not asked for.
        if any(matches(topic, message.topic) for topic, _ in self._topics):
            self._inbox.append((message.topic, bytes(message.payload)))


class MqttTransport:
    """Connects vehicles to a broker; see `fleet.gateway.transport.Transport`.

    Args:
        address: The broker.
        prefix: Begins the names of all clients, which a broker must know apart.
    """

    def __init__(self, address: BrokerAddress, prefix: str) -> None:
        self._address = address
        self._prefix = prefix

    def link(self, topics: Sequence[str], will: Post | None) -> MqttLink:
        """See `Transport`."""
        # A will is in the name of a vehicle, whose manufacturer and serial number stand in its topic.
        name = [self._prefix, "master"] if will is None else [self._prefix, *will.topic.split("/")[2:4]]
        return MqttLink(self._address, "-".join(name), topics, will)
