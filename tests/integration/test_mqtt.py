"""Cars on a real broker: connections come and go, wills are read out, and the example of the guide finds its master."""

import contextlib
import os
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("paho", reason="MQTT needs the extra vda5050")
pytest.importorskip("amqtt", reason="the embedded broker needs the extra vda5050")

from benchmarks.interop.brokers import free_port
from fleet.cli.main import main
from fleet.gateway.broker import EmbeddedBroker
from fleet.gateway.errors import GatewayError, RefusedError
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


class Doorman:
    """Answers whoever connects with the same bytes and ends the connection; counts them."""

    def __init__(self, answer: bytes, tls: ssl.SSLContext | None = None) -> None:
        self.n_came = 0
        self._answer, self._tls = answer, tls
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._socket.getsockname()[1])
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self) -> None:
        self._socket.close()

    def _serve(self) -> None:
        while True:
            try:
                came, _ = self._socket.accept()
            except OSError:
                return
            self.n_came += 1
            with contextlib.suppress(OSError), came, self._line(came) as line:
                line.recv(1000)
                line.sendall(self._answer)
                line.recv(1000 if self._answer else 0)

    def _line(self, came: socket.socket) -> socket.socket:
        return came if self._tls is None else self._tls.wrap_socket(came, server_side=True)


def refusal(code: int) -> bytes:
    """A CONNACK of MQTT 3.1.1."""
    return bytes((0x20, 2, 0, code))


@pytest.mark.parametrize(("code", "words"), [(5, "Not authorized"), (4, "Bad user name or password")])
def test_a_password_that_is_wrong_is_told_at_once_and_not_tried_again(
    code: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    door, file = Doorman(refusal(code)), tmp_path / "password"
    file.write_text("wrong\n")
    options = ["--vda5050", f"mqtt://127.0.0.1:{door.port}", "--user", "me", "--password-file", str(file)]
    with pytest.raises(SystemExit) as ended:
        main(["drive", *options, "--vehicle", "a/1", "--patience", "20", "--out", str(tmp_path / "new")])
    door.close()
    said = capsys.readouterr().err
    assert (ended.value.code, said.count("\n")) == (2, 1)
    assert f"refuses us: {words}; valid: --user and --password-file that it knows" in said
    assert door.n_came == 1
    assert not (tmp_path / "new").exists()


def test_a_broker_that_is_not_ready_or_hangs_up_is_told_apart_from_one_that_refuses() -> None:
    for answer, words in ((refusal(3), "Server unavailable"), (b"", "it ended the connection")):
        door = Doorman(answer)
        with pytest.raises(GatewayError, match=f"does not let us in: {words}; valid: mqtts://") as error:
            MqttTransport(BrokerAddress(url=f"mqtt://127.0.0.1:{door.port}"), "car").link(["x"], WILL)
        assert not isinstance(error.value, RefusedError)
        door.close()


# paho leaves the socket of a handshake that failed to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_files_of_tls_that_do_not_fit_are_named_and_a_broker_that_nobody_vouches_for_is_left(tmp_path: Path) -> None:
    pytest.importorskip("cryptography", reason="certificates for this test are made by cryptography")
    from tests.integration.certificates import write_certificate

    (tmp_path / "empty.pem").write_text("")
    ours, theirs = write_certificate(tmp_path, "ours"), write_certificate(tmp_path, "theirs")
    locked = write_certificate(tmp_path, "locked", passphrase=b"secret")
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(*theirs)
    door = Doorman(refusal(0), tls)
    url = f"mqtts://127.0.0.1:{door.port}"
    with pytest.raises(GatewayError, match=r"--ca is '.*empty.pem' \(.*\); valid: certificates in PEM"):
        BrokerAddress(url=url, ca=tmp_path / "empty.pem")
    for certificate, key in ((ours[0], theirs[1]), (ours[0], tmp_path / "empty.pem"), locked):
        with pytest.raises(GatewayError, match=r"--certificate is '.*', --key '.*' \(.*\); valid: .* passphrase"):
            BrokerAddress(url=url, certificate=certificate, key=key)
    with pytest.raises(RefusedError, match="is not trusted: self-signed certificate; valid: --ca"):
        MqttTransport(BrokerAddress(url=url, ca=ours[0]), "car").link(["x"], WILL)
    client = MqttTransport(BrokerAddress(url=url, ca=theirs[0]), "car").link([], None)
    client.close(None)
    door.close()


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
