"""Addresses of Ray clusters that are none, that nobody answers at, or that something else answers at; no Ray at all."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from fleet.errors import ConfigError
from fleet.study import ray_cluster as module
from fleet.study.design import StudyError
from fleet.study.ray_cluster import ray_cluster


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray counts as installed, though it is not loaded."""
    monkeypatch.setattr(module, "find_spec", lambda name: object())


@contextmanager
def server(answer: bytes) -> Iterator[int]:
    """Give the port of something that reads a little, answers and hangs up."""

    def serve(listening: socket.socket) -> None:
        connection, _ = listening.accept()
        with connection:
            connection.recv(1000)
            connection.sendall(answer)

    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=serve, args=(listening,))
        thread.start()
        yield listening.getsockname()[1]
        thread.join()


@pytest.mark.parametrize(
    "address", ["x", "host", "host:", ":1", "host:0", "host:65536", "http://host:1", "a b:1", "::1"]
)
def test_an_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(ConfigError, match=r"--ray-address is .*; valid: local, auto, HOST:PORT or ray://HOST:PORT"):
        ray_cluster(address, None).__enter__()


def test_an_address_of_the_environment_is_refused_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAY_ADDRESS", "http://host:8265")
    with pytest.raises(ConfigError, match="RAY_ADDRESS is 'http://host:8265'"):
        ray_cluster(None, None).__enter__()


def test_without_ray_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    with pytest.raises(StudyError, match=r"needs Ray, which is not installed; valid: pip install '\.\[ray\]'"):
        ray_cluster("local", None).__enter__()


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("protocol", ["", "ray://"])
def test_an_address_that_does_not_answer(protocol: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
    with pytest.raises(StudyError, match=rf"Ray at {protocol}127\.0\.0\.1:{port}: does not answer"):
        ray_cluster(f"{protocol}127.0.0.1:{port}", None).__enter__()


@pytest.mark.usefixtures("installed")
def test_a_host_that_is_not_known() -> None:
    with pytest.raises(StudyError, match=r"Ray at nowhere\.invalid:6379: does not answer"):
        ray_cluster("nowhere.invalid:6379", None).__enter__()


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("answer", [b"", b"HTTP/1.0 400 Bad Request\r\n\r\n"])
def test_something_else_answers(answer: bytes) -> None:
    with server(answer) as port, pytest.raises(StudyError, match="what answers there is no Ray"):
        ray_cluster(f"127.0.0.1:{port}", None).__enter__()
