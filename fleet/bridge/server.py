"""BridgeServer: a socket on which programs outside of a run listen and speak; whoever is slow misses something."""

from __future__ import annotations

import selectors
import socket
from collections import deque
from types import TracebackType
from typing import NamedTuple, Self

from fleet.bridge.wire import MOST_BYTES, BadFrame, encoded, taken
from fleet.errors import FleetError

SLOW_BYTES = 1 << 19
"""A client that has so much left to read misses what will be said again [bytes]."""
LOST_BYTES = 1 << 24
"""A client that has so much left to read is sent away [bytes]."""
_READ_BYTES = 1 << 16


class BridgeError(FleetError):
    """The socket cannot be opened."""


class BridgeClient:
    """A program at the other end.

    Args:
        link: Its socket.
    """

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._link.setblocking(False)
        self._link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._unread = bytearray()
        self._unsent: deque[memoryview] = deque()
        self._n_unsent = 0
        self.open = True
        """Whether anybody is there."""
        self.welcomed = False
        """Whether it was told what this run is."""

    @property
    def link(self) -> socket.socket:
        """Its socket."""
        return self._link

    def tell(self, frame: bytes, *, again: bool = False) -> None:
        """Send a frame as far as it goes, without waiting.

        Args:
            frame: From `encoded`.
            again: Whether something newer will be said soon: a client that is slow misses such frames.
        """
        if not self.open or (again and self._n_unsent > SLOW_BYTES):
            return
        self._unsent.append(memoryview(frame))
        self._n_unsent += len(frame)
        self.flush()
        if self._n_unsent > LOST_BYTES:
            self.open = False

    def flush(self) -> None:
        """Send what is left, as far as it goes."""
        try:
            while self._unsent:
                n = self._link.send(self._unsent[0])
                self._n_unsent -= n
                if n < len(self._unsent[0]):
                    self._unsent[0] = self._unsent[0][n:]
                else:
                    self._unsent.popleft()
        except BlockingIOError:
            return
        except OSError:
            self.open = False

    def heard(self) -> list[dict[str, object]]:
        """What it has said since the last call; one that speaks nonsense is told so, and sent away."""
        try:
            # More than a frame is left for the next time: the run waits for nobody who talks without a pause.
            while len(self._unread) <= MOST_BYTES:
                chunk = self._link.recv(_READ_BYTES)
                if not chunk:
                    self.open = False
                    break
                self._unread += chunk
        except BlockingIOError:
            pass
        except OSError:
            self.open = False
        headers: list[dict[str, object]] = []
        try:
            for header in taken(self._unread):
                headers.append(header)
        except BadFrame as error:
            self.tell(encoded({"op": "answer", "ok": False, "error": str(error)}))
            self.open = False
        return headers

    def close(self) -> None:
        """End the connection."""
        self.open = False
        self._link.close()


class Said(NamedTuple):
    """What a client has said."""

    client: BridgeClient
    header: dict[str, object]


class BridgeServer:
    """Listens on an address; use as a context manager. It outlives runs that begin again.

    Args:
        address: `HOST:PORT`; a port of 0 = any that is free.

    Raises:
        BridgeError: It is no address, or cannot be listened on.
    """

    def __init__(self, address: str) -> None:
        host, colon, port = address.rpartition(":")
        if not (colon and host and port.isdecimal() and int(port) < 1 << 16):
            raise BridgeError(f"--bridge is {address!r}; valid: HOST:PORT, such as 127.0.0.1:9870")
        try:
            self._listener = socket.create_server((host.strip("[]"), int(port)), family=_family(host))
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise BridgeError(f"--bridge is {address!r}: {reason}; valid: a free port of this machine") from error
        self._listener.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self.clients: list[BridgeClient] = []
        """Those that are there."""
        self.left: list[BridgeClient] = []
        """Those that have gone; whoever cares takes them out."""
        self.wants_reset = False
        """Whether a client has asked for the run to begin again."""

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._listener.getsockname()[1])

    def poll(self, wait_s: float = 0.0) -> list[Said]:
        """Take in who comes, what is said and who goes.

        Args:
            wait_s: How long to wait for something [s].
        """
        said: list[Said] = []
        for key, _ in self._selector.select(wait_s):
            if key.fileobj is self._listener:
                self._welcome()
            else:
                said += [Said(key.data, header) for header in key.data.heard()]
        for client in self.clients:
            client.flush()
        for client in [client for client in self.clients if not client.open]:
            self._selector.unregister(client.link)
            client.close()
            self.clients.remove(client)
            self.left.append(client)
        return said

    def tell(self, frame: bytes, *, again: bool = False) -> None:
        """Send a frame to all, see `BridgeClient.tell`."""
        for client in self.clients:
            client.tell(frame, again=again)

    def close(self) -> None:
        """End all connections."""
        for client in self.clients:
            client.close()
        self._selector.close()
        self._listener.close()

    def _welcome(self) -> None:
        try:
            link, _ = self._listener.accept()
        except OSError:
            return  # gone again
        client = BridgeClient(link)
        self.clients.append(client)
        self._selector.register(link, selectors.EVENT_READ, client)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET
