"""The engine in its own window and in another process: chosen by configuration alone, with the same result."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fleet.config import ArmConfig, Connect, RunConfig
from fleet.simulation import Simulation
from fleet.terminal.compilation import NOTICE
from fleet.world.bullet.engine import client as client_module
from fleet.world.bullet.engine.client import PhysicsError

pytestmark = pytest.mark.bullet

CONFIG = RunConfig(site="cell", robots=1, tasks=1, arms=ArmConfig(workers_n=0))
SERVER = """
import sys, pybullet
server = pybullet.connect(pybullet.SHARED_MEMORY_SERVER, key=int(sys.argv[1]))
sys.stderr.write("ready\\n" if server >= 0 else "refused\\n")
sys.stdin.read()
pybullet.disconnect(server)
"""
# Some of what the engine prints while it opens and closes a window.
ENGINE_WORDS = ("GL_", "GLX", "X11", "ven =", "thread", "semaphore", "argv", "build time", "b3", "ersion", "Mesa")


def hash_after(config: RunConfig, n_ticks: int) -> str:
    """Run a while and return the state's hash."""
    with Simulation(config) as simulation:
        for _ in range(n_ticks):
            simulation.tick()
        return simulation.state_hash()


@pytest.fixture
def display() -> Iterator[str]:
    """Return the name of a virtual display."""
    program = shutil.which("Xvfb")
    if program is None:
        pytest.skip("needs Xvfb, a virtual display (Debian: apt-get install xvfb libgl1-mesa-dri)")
    read, write = os.pipe()
    command = [program, "-displayfd", str(write), "-screen", "0", "640x480x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=(write,), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as answer:
        number = answer.readline().strip()
    if not number:
        server.wait()
        pytest.skip("Xvfb found no free display")
    yield f":{number}"
    server.terminate()
    server.wait()


@pytest.fixture
def demo(tmp_path: Path) -> Callable[[str | None], subprocess.CompletedProcess[str]]:
    """Return a function that runs a second in a window on a display."""

    def run(display: str | None) -> subprocess.CompletedProcess[str]:
        environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
        if display is not None:
            environment["DISPLAY"] = display
        options = ["--gui", "--site", "cell", "--robots", "1", "--tasks", "1", "--duration", "1", "--out"]
        return subprocess.run(
            [sys.executable, "-m", "fleet.demo", *options, str(tmp_path / "run")],
            env=environment,
            capture_output=True,
            text=True,
            timeout=200,
            check=False,
        )

    return run


@pytest.fixture
def server() -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Return a process with a physics server, and the server's key."""
    key = 100_000 + 2 * os.getpid()  # a server also takes the next key
    process = subprocess.Popen(
        [sys.executable, "-c", SERVER, str(key)],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    for line in process.stderr:  # among what the engine prints
        if line.strip() in ("ready", "refused"):
            assert line.strip() == "ready"
            break
    yield process, key
    process.communicate()


def test_window_shows_the_same_run_and_prints_nothing(
    display: str, demo: Callable[[str | None], subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    done = demo(display)
    assert (done.returncode, done.stderr.replace(f"{NOTICE}\n", "")) == (0, "")
    assert [word for word in ENGINE_WORDS if word in done.stdout] == []
    result = json.loads((tmp_path / "run" / "result.json").read_text(encoding="utf-8"))
    assert result["state_hash"] == hash_after(dataclasses.replace(CONFIG, duration_s=1.0), 60)


@pytest.mark.parametrize("name", [None, ":9931"])
def test_window_without_a_display_is_refused(
    name: str | None, demo: Callable[[str | None], subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    done = demo(name)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "connect GUI: no " in done.stderr
    assert "valid: a display with OpenGL" in done.stderr
    assert not (tmp_path / "run").exists()


def test_server_gives_the_same_run_twice(server: tuple[subprocess.Popen[str], int]) -> None:
    remote = dataclasses.replace(CONFIG, connect=Connect.SHARED_MEMORY, shared_memory_key=server[1])
    here = hash_after(CONFIG, 30)
    assert hash_after(remote, 30) == here
    assert hash_after(remote, 30) == here


def test_missing_server_is_named() -> None:
    remote = dataclasses.replace(CONFIG, connect=Connect.SHARED_MEMORY, shared_memory_key=99_999)
    with pytest.raises(PhysicsError, match=r"server with key 99999 does not answer; valid: the key of a running"):
        Simulation(remote)


def test_server_that_ends_is_named(server: tuple[subprocess.Popen[str], int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_module, "_SERVER_TIMEOUT_S", 1.0)
    process, key = server
    with Simulation(dataclasses.replace(CONFIG, connect=Connect.SHARED_MEMORY, shared_memory_key=key)) as simulation:
        simulation.tick()
        process.communicate()
        with pytest.raises(PhysicsError, match=f"server with key {key} has gone"):
            simulation.tick()
