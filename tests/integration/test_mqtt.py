"""Cars on a real broker: connections come and go, wills are read out, and the example of the guide finds its master."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("paho", reason="MQTT needs the extra vda5050")
pytest.importorskip("amqtt", reason="the embedded broker needs the extra vda5050")

from benchmarks.interop.brokers import free_port
from fleet.gateway.broker import EmbeddedBroker
from fleet.gateway.errors import GatewayError
from fleet.gateway.mqtt import BrokerAddress, MqttTransport
from fleet.gateway.transport import BrokerLink
from fleet.vda5050.envelope import Post

KEEP_ALIVE_S = 2
WILL = Post(topic="uagv/v2/fleet/car_0/connection", payload=b"CONNECTIONBROKEN", qos=1, retain=True)
CAR = """
import sys, time
from tests.integration.test_mqtt import KEEP_ALIVE_S, WILL
from fleet.gateway.mqtt import BrokerAddress, MqttTransport
address = BrokerAddress(url=sys.argv[1], keep_alive_s=KEEP_ALIVE_S)
link = MqttTransport(address, "car").link(["uagv/v2/fleet/car_0/order"], WILL)
print("online", flush=True)
time.sleep(600)
"""


@pytest.fixture(scope="module")
def broker() -> Iterator[EmbeddedBroker]:
    with EmbeddedBroker(free_port()) as made:
        yield made


def master(url: str, topic: str = "uagv/v2/fleet/car_0/connection") -> BrokerLink:
    return MqttTransport(BrokerAddress(url=url), f"master {time.monotonic_ns()}").link([topic], None)


def wait(done: Callable[[], object], most_s: float = 20.0) -> float:
    """Wait until something is so; returns how long that took."""
    begin = time.monotonic()
    while not done():
        assert time.monotonic() - begin < most_s
        time.sleep(0.02)
    return time.monotonic() - begin


def test_a_killed_process_has_its_will_read_out_within_one_and_a_half_keep_alives(broker: EmbeddedBroker) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", CAR, broker.url], stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2]
    ) as car:
        assert car.stdout is not None
        assert car.stdout.readline() == "online\n"
        listener = master(broker.url)
        os.kill(car.pid, signal.SIGKILL)
        heard: list[tuple[str, bytes]] = []
        took_s = wait(lambda: heard.extend(listener.received()) or heard)
        assert heard == [(WILL.topic, WILL.payload)]
        assert took_s <= 1.5 * KEEP_ALIVE_S + 1.0  # and a second for a busy machine
        listener.close(None)


def test_a_car_that_leaves_in_order_has_no_will_read_out_and_the_retained_message_is_its_last(
    broker: EmbeddedBroker,
) -> None:
    offline = Post(topic="uagv/v2/fleet/car_7/connection", payload=b"OFFLINE", qos=1, retain=True)
    will = Post(topic=offline.topic, payload=b"CONNECTIONBROKEN", qos=1, retain=True)
    link = MqttTransport(BrokerAddress(url=broker.url), "car").link(["uagv/v2/fleet/car_7/order"], will)
    link.close(offline)
    late = master(broker.url, offline.topic)
    heard: list[tuple[str, bytes]] = []
    wait(lambda: heard.extend(late.received()) or heard)
    assert heard == [(offline.topic, b"OFFLINE")]
    late.close(None)


def test_a_broker_that_vanishes_is_found_again_and_nobody_waits_for_it() -> None:
    port = free_port()
    first = EmbeddedBroker(port)
    link = MqttTransport(BrokerAddress(url=first.url), "car").link(["uagv/v2/fleet/car_0/order"], WILL)
    assert link.n_sessions == 2  # its own, and what vehicles share
    first.close()
    begin = time.monotonic()
    for _ in range(1000):
        link.send(WILL)
    assert time.monotonic() - begin < 1.0
    with EmbeddedBroker(port) as second:
        wait(lambda: link.n_sessions == 4, 40.0)
        speaker = master(second.url)
        speaker.send(Post(topic="uagv/v2/fleet/car_0/order", payload=b"{}", qos=0, retain=False))
        heard: list[tuple[str, bytes]] = []
        wait(lambda: heard.extend(link.received()) or heard)
        assert heard == [("uagv/v2/fleet/car_0/order", b"{}")]
        speaker.close(None)
        link.close(WILL)


def test_vehicles_of_a_process_hear_what_is_for_them_and_one_may_leave(broker: EmbeddedBroker) -> None:
    """They share a connection, and each keeps a last will of its own."""
    transport = MqttTransport(BrokerAddress(url=broker.url), "two")
    topics = [f"uagv/v2/two/car_{k}/order" for k in range(2)]
    wills = [
        Post(topic=f"uagv/v2/two/car_{k}/connection", payload=b"CONNECTIONBROKEN", qos=1, retain=True) for k in range(2)
    ]
    first, second = (transport.link([topic], will) for topic, will in zip(topics, wills, strict=True))
    speaker = master(broker.url, "uagv/v2/two/+/state")
    heard: list[tuple[str, bytes]] = []

    def say(topic: str) -> None:
        speaker.send(Post(topic=topic, payload=topic.encode(), qos=0, retain=False))

    say(topics[0])
    say("uagv/v2/two/car_9/order")
    say(topics[1])
    wait(lambda: heard.extend(second.received()) or heard)
    assert heard == [(topics[1], topics[1].encode())]
    assert first.received() == [(topics[0], topics[0].encode())]
    first.close(None)
    say(topics[1])
    wait(lambda: len(heard.extend(second.received()) or heard) == 2)
    second.send(Post(topic="uagv/v2/two/car_1/state", payload=b"here", qos=0, retain=False))
    wait(lambda: speaker.received() == [("uagv/v2/two/car_1/state", b"here")])
    second.close(None)
    again = transport.link(topics[:1], wills[0])
    say(topics[0])
    wait(again.received)
    again.close(None)
    speaker.close(None)


def test_a_port_that_is_taken_is_named(broker: EmbeddedBroker) -> None:
    with pytest.raises(GatewayError, match=r"no broker at mqtt://127\.0\.0\.1:\d+: .*address already in use"):
        EmbeddedBroker(int(broker.url.rsplit(":", 1)[1]))


def test_a_broker_that_is_not_there_is_named() -> None:
    url = f"mqtt://127.0.0.1:{free_port()}"
    with pytest.raises(GatewayError, match=f"the broker at {url} cannot be reached"):
        MqttTransport(BrokerAddress(url=url), "car").link(["x"], WILL)
