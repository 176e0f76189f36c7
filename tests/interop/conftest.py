"""Foreign partners: where they are, and a test that needs one that is not there is skipped with the reason."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.interop.table import DEBIAN_PYTHON, FOLDER, PARTNERS, REPOSITORY, ROS2

SCRIPTS = Path(__file__).parent / "partners"
BRIDGE = REPOSITORY / "bridge"
PATIENCE_S = 600.0
"""Wall time after which a program that still runs but says nothing hangs [s]: a machine that is busy is slow."""


class Process:
    """A program of a partner, and what it says, line by line.

    Args:
        words: Command and arguments.
        environment: What it gets beside the environment of the test.
    """

    def __init__(self, words: list[str], environment: dict[str, str]) -> None:
        self._process = subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=os.environ | environment
        )
        self._lines: queue.Queue[str] = queue.Queue()
        self.said: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout:
            for line in self._process.stdout:
                self._lines.put(line.rstrip("\n"))

    def line(self, begin: str, runs: Callable[[], bool] | None = None, *, most_s: float = PATIENCE_S) -> str:
        """Wait for a line that begins so; returns the rest of it.

        Args:
            begin: What it begins with.
            runs: Whether what it talks to still runs, which then bounds the wait; None = `most_s` does.
            most_s: Wall time after which to give up [s].
        """
        until = time.monotonic() + most_s
        while runs() if runs is not None else time.monotonic() < until:
            try:
                self.said.append(self._lines.get(timeout=0.5))
            except queue.Empty:
                if self._process.poll() is not None and self._lines.empty():
                    break
                continue
            if self.said[-1].startswith(begin):
                return self.said[-1].removeprefix(begin).strip()
        raise AssertionError(f"no line {begin!r} from {self._process.args}: {self.said[-20:]}")

    def result(self) -> Any:
        """What it found out, its line `result {...}`."""
        return json.loads(self.line("result"))

    def end(self, wait_s: float = 0.0) -> int | None:
        """End it; returns its exit status if it ended by itself within some seconds."""
        try:
            return self._process.wait(wait_s)
        except subprocess.TimeoutExpired:
            self._process.terminate()
            try:
                self._process.wait(10.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
            return None


class Partners:
    """Starts programs of one partner, and ends them with the test.

    Args:
        program: What runs them.
        environment: What they get beside the environment of the test.
    """

    def __init__(self, program: list[str], environment: dict[str, str]) -> None:
        self._program = program
        self._environment = environment
        self._stack = ExitStack()

    def start(self, script: Path | str, *words: object) -> Process:
        """Start a script: one of `partners/` by its name."""
        path = SCRIPTS / script if isinstance(script, str) else script
        process = Process([*self._program, str(path), *map(str, words)], self._environment)
        self._stack.callback(process.end)
        return process

    def close(self) -> None:
        """End all of them."""
        self._stack.close()


def require_partner(name: str) -> None:
    """Skip the test if a partner is not there."""
    if lack := PARTNERS[name].lack():
        pytest.skip(f"{lack}; `make test-interop` sets it up")


@pytest.fixture
def ros2() -> Iterator[Partners]:
    """Yield what runs scripts under ROS 2."""
    require_partner("ROS 2")
    # Other runs on this machine have another domain.
    domain = str(1 + os.getpid() % 100)
    here = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": domain}
    partners = Partners([str(ROS2 / "bin" / "python")], here)
    yield partners
    partners.close()


@pytest.fixture
def ros1() -> Iterator[Partners]:
    """Yield what runs scripts under ROS 1, beside a master."""
    require_partner("ROS 1")
    port = 20000 + os.getpid() % 10000
    here = {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1", "PYTHONPATH": ""}
    partners = Partners([DEBIAN_PYTHON], here)
    partners.start("ros1_master.py", port).line("ready")
    yield partners
    partners.close()


@pytest.fixture
def node() -> Iterator[Partners]:
    """Yield what runs scripts under Node.js, with roslib."""
    require_partner("roslib")
    partners = Partners(["node"], {"ROSLIB": str(FOLDER / "roslib" / "node_modules" / "roslib")})
    yield partners
    partners.close()
