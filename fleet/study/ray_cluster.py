"""Ray cluster: one that is there is joined and left as it was, one on this machine is started and ended."""

from __future__ import annotations

import logging
import os
import re
import secrets
import signal
import socket
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from typing import Any

from fleet.config import require
from fleet.study.design import StudyError

LOCAL, AUTO = "local", "auto"
FORM = f"{LOCAL}, {AUTO}, HOST:PORT or ray://HOST:PORT"
EXTRA = "pip install '.[ray]'"
ANSWER_S = 5.0
"""Wall time after which an address does not answer [s]."""
OBJECT_STORE_BYTES = 100_000_000
"""Of a cluster of this machine, in place of a third of the memory: rows and settings are small."""
_HOST_PORT = re.compile(r"(?:ray://)?([^\s:/]+|\[[0-9A-Fa-f:.]+\]):([0-9]{1,5})")
_SETTINGS = b"\x04"
_HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0" + _SETTINGS + b"\0" + b"\0\0\0\0"
"""As HTTP/2, which Ray speaks, begins: the server's first frame holds its settings, too (RFC 9113, 3.4)."""


@contextmanager
def ray_cluster(address: str | None, jobs: int | None) -> Iterator[None]:
    """Be connected to a Ray cluster.

    Args:
        address: `local` starts one on this machine, `auto` takes that which runs here, else where it is; None is what
            RAY_ADDRESS says, else `local`.
        jobs: CPUs of a cluster that is started; None for the cores there are.

    Raises:
        ConfigError: The address is none.
        StudyError: Ray is not installed, nobody answers, Ray or Python have another version there, or the cluster does
            not start.
    """
    what = "--ray-address" if address else "RAY_ADDRESS"
    address = address or os.environ.get("RAY_ADDRESS") or LOCAL
    place = _HOST_PORT.fullmatch(address)
    valid = address in (LOCAL, AUTO) or (place is not None and 1 <= int(place[2]) <= 65535)
    require(valid, what, address, FORM)
    if find_spec("ray") is None:
        raise StudyError(f"--backend ray needs Ray, which is not installed; valid: {EXTRA}")
    if place:
        _require_answer(address, place[1].strip("[]"), int(place[2]))
    settings: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    with ExitStack() as stack:
        if address == LOCAL:
            stack.enter_context(_environment(_own_environment()))
            settings |= {
                "num_cpus": jobs or len(os.sched_getaffinity(0)),
                "include_dashboard": False,
                "object_store_memory": OBJECT_STORE_BYTES,
                "_temp_dir": stack.enter_context(
                    tempfile.TemporaryDirectory(prefix="ray_", ignore_cleanup_errors=True)
                ),
            }
        import ray

        stack.callback(ray.shutdown)
        with _sigterm_kept():
            try:
                ray.init(address, **settings)
            except Exception as error:  # of many kinds, the plain one among them
                raise StudyError(f"Ray at {address}: {_reason(error)}; valid: {FORM}") from error
        yield


def _require_answer(address: str, host: str, port: int) -> None:
    """Ray itself waits for long for what does not answer, and for ever for what is no Ray."""
    try:
        with socket.create_connection((host, port), timeout=ANSWER_S) as connection:
            if os.environ.get("RAY_USE_TLS") == "1":
                return
            connection.sendall(_HELLO)
            answer = connection.recv(9)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise StudyError(f"Ray at {address}: does not answer ({reason}); valid: {FORM}") from error
    if answer[3:4] != _SETTINGS:
        raise StudyError(f"Ray at {address}: what answers there is no Ray; valid: {FORM}")


def _reason(error: Exception) -> str:
    """What Ray says, with the last line of what was behind it, which may hold a whole traceback."""
    behind = str(error.__cause__ or "").strip().rpartition("\n")[2]
    return f"{error} ({behind})" if behind else str(error).rstrip(".")


def _own_environment() -> dict[str, str]:
    """Of a cluster of this machine.

    Its workers use the environment that is there: under `uv run` each would build one of its own. Others keep out by a
    secret that dies with it, where Ray would leave one in the user's home.
    """
    own = {"RAY_ENABLE_UV_RUN_RUNTIME_ENV": "0"}
    if "RAY_AUTH_MODE" not in os.environ:
        own |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    return {name: value for name, value in own.items() if name not in os.environ}


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    os.environ.update(values)
    try:
        yield
    finally:
        for name in values:
            os.environ.pop(name, None)


@contextmanager
def _sigterm_kept() -> Iterator[None]:
    """Ray sets a handler of its own, with which an interrupted study would lose what it has."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, before)
