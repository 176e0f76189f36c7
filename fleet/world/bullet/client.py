"""Client: one connection to the physics engine, and silence for everything that engine prints from C."""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from fleet.config import Connect
from fleet.errors import FleetError


class PhysicsError(FleetError):
    """The physics engine refused a connection or a description."""


@contextmanager
def quiet() -> Iterator[None]:
    """Send file descriptors 1 and 2 to nowhere for the time of the block.

    Printing from C bypasses `sys.stdout`, and its buffer may be written much later: it is flushed at both ends, so that
    nothing of the block is left over and nothing from before it is lost. Other threads are silent meanwhile.
    """
    libc = ctypes.CDLL(None)
    _flush(libc)
    saved = [os.dup(fd) for fd in (1, 2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for fd in (1, 2):
            os.dup2(nowhere, fd)
        yield
    finally:
        _flush(libc)
        for fd, copy in zip((1, 2), saved, strict=True):
            os.dup2(copy, fd)
            os.close(copy)
        os.close(nowhere)


def _flush(libc: ctypes.CDLL) -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            with suppress(ValueError, OSError):
                stream.flush()
    libc.fflush(None)


with quiet():  # the import prints its build time
    import pybullet


class Client:
    """A connection; every function of the engine as an attribute, bound to this connection.

    Args:
        connect: DIRECT computes in this process, GUI also opens a window, SHARED_MEMORY uses a running server.
        shared_memory_key: Key of that server.

    Raises:
        PhysicsError: No display for the window, or no server under the key.
    """

    def __init__(self, connect: Connect = Connect.DIRECT, shared_memory_key: int = 12347) -> None:
        # Without a display the engine ends the whole process instead of reporting an error.
        if connect is Connect.GUI and sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
            raise PhysicsError("connect GUI: no display (DISPLAY is not set); valid: DIRECT, or run under xvfb-run")
        with quiet():
            if connect is Connect.SHARED_MEMORY:
                self.id = pybullet.connect(pybullet.SHARED_MEMORY, shared_memory_key)
            else:
                self.id = pybullet.connect(getattr(pybullet, connect.value))
        if self.id < 0:
            raise PhysicsError(f"connect {connect.value} with key {shared_memory_key}: no physics server answers")
        self.engine = pybullet

    def __getattr__(self, name: str) -> Any:
        """Return an engine function bound to this connection, or a constant of the engine."""
        value = getattr(pybullet, name)
        if not callable(value):
            return value
        bound = _bind(value, self.id)
        self.__dict__[name] = bound  # found without __getattr__ next time
        return bound

    def load_urdf(self, text: str, **options: Any) -> int:
        """Load a description from its text.

        Args:
            text: URDF; meshes are named by absolute path.
            options: Arguments of ``loadURDF``.

        Returns:
            The body's id.

        Raises:
            PhysicsError: The engine cannot load it.
        """
        with tempfile.TemporaryDirectory(prefix="fleet-") as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(text, encoding="utf-8")
            try:
                with quiet():
                    return self.loadURDF(str(path), **options)
            except pybullet.error as reason:
                raise PhysicsError(f"loading a robot description failed: {reason}") from reason

    def close(self) -> None:
        """End the connection; calling twice is harmless."""
        if self.id >= 0:
            with quiet(), suppress(pybullet.error):
                pybullet.disconnect(self.id)
            self.id = -1


def _bind(function: Any, client_id: int) -> Any:
    def call(*args: Any, **kwargs: Any) -> Any:
        return function(*args, physicsClientId=client_id, **kwargs)

    return call
