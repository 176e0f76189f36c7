"""Brokers: MQTT brokers that a run may talk to: the one of `serve --broker`, and mosquitto if this machine has it."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fleet.gateway.broker import EmbeddedBroker

BROKERS = ("amqtt", "mosquitto")
LISTEN_S = 20.0
"""How long a broker may take to listen [s]."""


def mosquitto() -> str | None:
    """The program, which Debian keeps where only root looks; None = it is not there."""
    return shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")


def free_port() -> int:
    """A port on the loopback interface on which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def broker(kind: str) -> Iterator[str]:
    """A broker on the loopback interface; yields its address.

    Args:
        kind: One of `BROKERS`, which is there.
    """
    port = free_port()
    if kind == "amqtt":
        with EmbeddedBroker(port) as ours:
            yield ours.url
        return
    program = mosquitto()
    if program is None:
        raise RuntimeError("mosquitto is not on this machine")
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "mosquitto.conf"
        settings.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n", encoding="utf-8")
        with subprocess.Popen([program, "-c", str(settings)], stderr=subprocess.DEVNULL) as process:
            try:
                _wait_for(port)
                yield f"mqtt://127.0.0.1:{port}"
            finally:
                process.terminate()


def _wait_for(port: int) -> None:
    until = time.monotonic() + LISTEN_S
    while time.monotonic() < until:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise RuntimeError(f"nobody listens on port {port} within {LISTEN_S:g} s")
