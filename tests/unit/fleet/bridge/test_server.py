"""BridgeServer: it never waits, drops what a slow client can miss, and sends away who speaks nonsense."""

import socket
import struct
import time

import pytest

from fleet.bridge.server import LOST_BYTES, SLOW_BYTES, BridgeError, BridgeServer
from fleet.bridge.wire import encoded


def visitor(server: BridgeServer) -> socket.socket:
    there = socket.create_connection(("127.0.0.1", server.port), timeout=5.0)
    while not server.clients:
        server.poll(0.1)
    return there


def said(text: bytes) -> bytes:
    return struct.pack(">II", 4 + len(text), len(text)) + text


@pytest.mark.parametrize("address", ["", "9870", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:70000", "no.such.host.:1"])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(BridgeError, match="--bridge is"):
        BridgeServer(address)


def test_a_port_that_is_taken_is_refused() -> None:
    with BridgeServer("127.0.0.1:0") as server, pytest.raises(BridgeError, match="valid: a free port"):
        BridgeServer(f"127.0.0.1:{server.port}")


def test_commands_come_in_and_whoever_goes_is_told_of() -> None:
    with BridgeServer("127.0.0.1:0") as server:
        there = visitor(server)
        (client,) = server.clients
        there.sendall(said(b'{"op": "pause", "on": true}'))
        assert [one.header["op"] for one in server.poll(1.0)] == ["pause"]
        there.close()
        server.poll(1.0)
        assert (server.clients, server.left) == ([], [client])


def test_a_client_that_does_not_read_costs_no_time_and_misses_what_is_said_again() -> None:
    with BridgeServer("127.0.0.1:0") as server:
        there = visitor(server)
        (client,) = server.clients
        frame = encoded({"op": "state"}, content=bytes(1 << 16))
        begin = time.perf_counter()
        for _ in range(1000):
            server.tell(frame, again=True)
            server.poll()
        assert time.perf_counter() - begin < 2.0
        assert client.open
        assert client._n_unsent <= SLOW_BYTES + len(frame)
        for _ in range(LOST_BYTES // len(frame) + 100):
            client.tell(frame)
        assert not client.open
        there.close()


def test_who_speaks_nonsense_is_told_so_and_sent_away() -> None:
    with BridgeServer("127.0.0.1:0") as server:
        there = visitor(server)
        there.sendall(said(b'{"op": "pause"}') + b"GET / HTTP/1.1\r\n\r\n")
        assert [one.header["op"] for one in server.poll(1.0)] == ["pause"]
        assert server.clients == []
        assert b'"ok":false' in there.recv(1000)
        assert there.recv(1000) == b""
        there.close()
