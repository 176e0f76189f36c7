"""EmbeddedBroker: an MQTT broker of our own on the loopback interface, in a process of its own, for small set-ups."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import multiprocessing
import signal
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Self

from fleet.gateway.errors import GatewayError

START_S = 600.0
"""How long the broker may take to listen [s]: one that ends is told at once, so only a hang takes so long."""
END_S = 5.0
"""How long it may take to end [s]."""


class EmbeddedBroker:
    """Runs amqtt (https://github.com/Yakifo/amqtt) while it is entered.

    It lets anybody in who is on this machine, and nobody else.

    Args:
        port: Where it listens on 127.0.0.1.

    Raises:
        GatewayError: The port is taken, or amqtt is missing.
    """

    def __init__(self, port: int) -> None:
        self.url = f"mqtt://127.0.0.1:{port}"
        """Its address."""
        ours, theirs = multiprocessing.get_context("spawn").Pipe()
        self._pipe = ours
        self._process = multiprocessing.get_context("spawn").Process(
            target=_serve, args=(port, theirs), daemon=True, name="broker"
        )
        self._process.start()
        theirs.close()
        try:
            said = ours.recv() if ours.poll(START_S) else "no answer"
        except EOFError:
            said = "it ended"
        if said:
            self.close()
            raise GatewayError(f"no broker at {self.url}: {said}; valid: a free port, and the extra vda5050")

    def close(self) -> None:
        """End it; calling twice is harmless."""
        self._pipe.close()
        self._process.join(END_S)
        if self._process.is_alive():
            self._process.kill()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _serve(port: int, pipe: Connection) -> None:
    """Run the broker until the other end of the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run ends first, and then the broker
    logging.disable(logging.CRITICAL)
    try:
        asyncio.run(_until_closed(port, pipe))
    except (OSError, RuntimeError, ImportError) as error:
        with contextlib.suppress(OSError):  # nobody waits for it any more
            pipe.send(str(error))


async def _until_closed(port: int, pipe: Connection) -> None:
    from amqtt.broker import Broker
    from amqtt.errors import BrokerError

    broker = Broker(
        {
            "listeners": {"default": {"type": "tcp", "bind": f"127.0.0.1:{port}"}},
            "plugins": {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}},
        }
    )
    try:
        await broker.start()
    except BrokerError as error:
        raise RuntimeError(str(error)) from error
    pipe.send("")
    loop = asyncio.get_running_loop()
    closed = asyncio.Event()
    loop.add_reader(pipe.fileno(), closed.set)
    await closed.wait()
    await broker.shutdown()
