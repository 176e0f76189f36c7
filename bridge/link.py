"""Link: the bridge of a run of `fleet` from the other side: a socket, and messages as plain Python.

For programs whose Python is not the simulator's: it needs nothing but the standard library of Python 3.8. The frames
are told in `docs/guide/ros.md`.
"""

from __future__ import annotations

import contextlib
import json
import select
import socket
import struct
import time
from typing import Any, NamedTuple

LENGTHS = struct.Struct(">II")
FORMAT = 1
"""Of the frames that are understood here."""


class LinkError(Exception):
    """There is no run at the other end, or none that is understood."""


class Frame(NamedTuple):
    """One message."""

    header: dict[str, Any]
    arrays: dict[str, list[list[float]]]
    """Numbers by name: rows, or one row for an array with one axis."""
    content: bytes
    """What is no numbers."""

    @property
    def op(self) -> str:
        """What it is."""
        return self.header["op"]


class Link:
    """A connection to a run.

    Args:
        address: ``HOST:PORT``, as given to ``--bridge``.
        patience_s: How long to wait for somebody to listen there [s].
    """

    def __init__(self, address: str, patience_s: float = 30.0) -> None:
        host, _, port = address.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
            raise LinkError(f"address is {address!r}; valid: HOST:PORT, such as 127.0.0.1:9870")
        until = time.monotonic() + patience_s
        while True:
            try:
                self._socket = socket.create_connection((host.strip("[]"), int(port)), timeout=5.0)
                break
            except OSError as error:
                if time.monotonic() >= until:
                    raise LinkError(
                        f"{address}: {error.strerror or error}; valid: the address of a run with --bridge"
                    ) from error
                time.sleep(0.2)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._unread = bytearray()
        self.hello = self._first()

    def fileno(self) -> int:
        """For `select`."""
        return self._socket.fileno()

    def frames(self, wait_s: float) -> list[Frame]:
        """What has come, at most after so long [s]; the newest of many states is all that is of interest to most."""
        try:
            if not select.select([self._socket], [], [], wait_s)[0]:
                return []
            chunk = self._socket.recv(1 << 18)
        except (OSError, ValueError):  # a run that was killed; a socket that was closed here
            chunk = b""
        if not chunk:
            raise LinkError("the run has ended")
        self._unread += chunk
        found = []
        while len(self._unread) >= LENGTHS.size:
            length, n_head = LENGTHS.unpack_from(self._unread)
            if len(self._unread) < 4 + length:
                break
            body = bytes(self._unread[LENGTHS.size : 4 + length])
            del self._unread[: 4 + length]
            found.append(_decoded(body, n_head))
            if found[-1].op == "hello":
                self.hello = found[-1]  # the run has begun again
        return found

    def say(self, op: str, **entries: Any) -> None:
        """Send a command; entries that are None are left out."""
        header = {"op": op, **{name: value for name, value in entries.items() if value is not None}}
        head = json.dumps(header).encode()
        with contextlib.suppress(OSError):  # whoever reads learns of a run that has gone
            self._socket.sendall(LENGTHS.pack(4 + len(head), len(head)) + head)

    def close(self) -> None:
        """Leave the run; what this client had in its hands goes back to the fleet."""
        self._socket.close()

    def _first(self) -> Frame:
        until = time.monotonic() + 30.0
        while time.monotonic() < until:
            for frame in self.frames(1.0):
                if frame.op != "hello":
                    continue
                if frame.header["format"] != FORMAT:
                    raise LinkError(f"the run speaks format {frame.header['format']}; valid: {FORMAT}")
                return frame
        raise LinkError("nothing has come for 30 s; valid: the address of a run with --bridge")


def _decoded(body: bytes, n_head: int) -> Frame:
    header = json.loads(body[:n_head].decode())
    arrays: dict[str, list[list[float]]] = {}
    at = n_head
    for name, shape in header.get("arrays", ()):
        rows, cols = _rows(shape)
        numbers = struct.unpack_from(f"<{rows * cols}d", body, at)
        at += 8 * rows * cols
        arrays[name] = [list(numbers[k * cols : (k + 1) * cols]) for k in range(rows)]
    return Frame(header, arrays, body[at:])


def _rows(shape: list[int]) -> tuple[int, int]:
    if len(shape) == 1:
        return 1, shape[0]
    return shape[0], shape[1]
