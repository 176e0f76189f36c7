"""Client: one connection to the physics engine, and silence for everything that engine prints from C."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from fleet.config import Connect
from fleet.errors import FleetError

# A server that is silent for so long has ended; loading a mesh takes less than a second [s].
_SERVER_TIMEOUT_S = 30.0
# The window's thread prints while it draws its first two frames.
_N_FIRST_FRAMES = 6
_WINDOW = "--width=1280 --height=800"
_REHEARSAL = "import pybullet as p, sys; i = p.connect(p.GUI); i < 0 or p.disconnect(i); sys.exit(i < 0)"
_REHEARSAL_S = 60.0


# The engine keeps the distance from which contacts are dropped once for all connections of a process: what was set last
# in this process, which is "", and in the servers it is connected to [m].
_contact_breaking_m: dict[str, float] = {}


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
        PhysicsError: No window can be opened, or no server answers under the key; later also when the server has gone.
    """

    def __init__(self, connect: Connect = Connect.DIRECT, shared_memory_key: int = 12347) -> None:
        self.connect = connect
        self._server = f"connect SHARED_MEMORY: the physics server with key {shared_memory_key}"
        if connect is Connect.GUI:
            _rehearse()
        key = (shared_memory_key,) if connect is Connect.SHARED_MEMORY else ()
        options = {"options": _WINDOW} if connect is Connect.GUI else {}
        with quiet():
            try:
                self.id = pybullet.connect(getattr(pybullet, connect.value), *key, **options)
            except pybullet.error as reason:  # a second window in this process
                raise PhysicsError(f"connect {connect.value}: {reason}") from reason
            if self.id >= 0 and connect is Connect.GUI:
                for _ in range(_N_FIRST_FRAMES):
                    pybullet.removeAllUserDebugItems(physicsClientId=self.id)  # waits for a frame
        if self.id < 0:
            raise PhysicsError(
                f"{self._server} does not answer; valid: the key of a running server, such as "
                "python -m pybullet_utils.runServer starts with key 12347, or connect DIRECT"
            )
        self.engine = pybullet
        self._place = self._server if connect is Connect.SHARED_MEMORY else ""
        if connect is Connect.SHARED_MEMORY:
            _contact_breaking_m.pop(self._place, None)
            self.setTimeOut(_SERVER_TIMEOUT_S)

    def __getattr__(self, name: str) -> Any:
        """Return an engine function bound to this connection, or a constant of the engine.

        Raises:
            PhysicsError: The connection is closed: another one may have its number by now.
        """
        value = getattr(pybullet, name)
        if callable(value):
            if self.__dict__.get("id", 0) < 0:
                raise PhysicsError(f"{name}: the connection to the physics engine is closed")
            value = partial(value, physicsClientId=self.id)
            if self.connect is Connect.SHARED_MEMORY:
                value = partial(self._ask_server, value)
        self.__dict__[name] = value  # found without __getattr__ next time
        return value

    def keep_contacts(self, distance_m: float) -> None:
        """Set the distance from which contacts are dropped [m]; costs nothing while it stays the same.

        All connections of a process share it, so a world sets it before every step: else worlds that were made later,
        or clients that check paths, would decide how things slide in this one.
        """
        if _contact_breaking_m.get(self._place) != distance_m:
            self.setPhysicsEngineParameter(contactBreakingThreshold=distance_m)
            _contact_breaking_m[self._place] = distance_m

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

    def base_poses(self, bodies: Iterable[int]) -> list[float]:
        """Measure x, y, z, qx, qy, qz, qw of the bases of some bodies, one after the other."""
        measure, client = pybullet.getBasePositionAndOrientation, self.id
        if self.connect is Connect.SHARED_MEMORY:
            measure = partial(self._ask_server, measure)
        poses: list[float] = []
        for body in bodies:
            # By position: half the time of a call is spent on names of arguments.
            position, quat = measure(body, client)
            poses += position
            poses += quat
        return poses

    def close(self) -> None:
        """End the connection; calling twice is harmless."""
        if self.id >= 0:
            with quiet(), suppress(pybullet.error):
                pybullet.disconnect(self.id)
            self.id = -1
            for name in [name for name in self.__dict__ if callable(getattr(pybullet, name, None))]:
                del self.__dict__[name]

    def _ask_server(self, function: Any, *args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except pybullet.error as reason:
            if pybullet.isConnected(physicsClientId=self.id):
                raise
            raise PhysicsError(f"{self._server} has gone") from reason


def _rehearse() -> None:
    """Open and close a window in a process of its own: without a usable display the engine ends its whole process.

    Raises:
        PhysicsError: No window can be opened.
    """
    valid = "valid: a display with OpenGL (xvfb-run gives a virtual one), or connect DIRECT"
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise PhysicsError(f"connect GUI: no display (DISPLAY is not set); {valid}")
    try:
        child = subprocess.run(
            [sys.executable, "-c", _REHEARSAL],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=_REHEARSAL_S,
            check=False,
        )
    except subprocess.TimeoutExpired as reason:
        raise PhysicsError(f"connect GUI: the window did not open within {_REHEARSAL_S:.0f} s; {valid}") from reason
    if child.returncode != 0:
        said = [line.strip() for line in child.stdout.splitlines() if line.strip()]
        why = said[-1] if said else f"the engine ended with status {child.returncode}"
        display = os.environ.get("DISPLAY", "")
        raise PhysicsError(f"connect GUI: no window on display {display!r}: {why}; {valid}")
