"""The client's side of the bridge, as the nodes of `bridge/` use it, and a run for it to see."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from fleet.bridge.server import BridgeServer
from fleet.config import RunConfig
from fleet.session import SessionConfig, run_session
from fleet.session.runner import MakeSimulation, Result
from fleet.simulation import Simulation

FOLDER = Path(__file__).resolve().parents[2] / "bridge"


def module(name: str) -> Any:
    """A file of `bridge/`, whose files find each other as scripts do."""
    import importlib

    sys.path.insert(0, str(FOLDER))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(FOLDER))


class BridgedRun:
    """A run in a thread, and a client of its bridge.

    Args:
        config: The run.
        session: How it is kept; it gets its bridge here.
        make: Makes the run.
    """

    def __init__(self, config: RunConfig, session: SessionConfig, make: MakeSimulation = Simulation) -> None:
        self._make = make
        self.server = BridgeServer("127.0.0.1:0")
        self.results: list[Result] = []
        self.faults: list[BaseException] = []
        self._config, self._session = config, replace(session, bridge=self.server)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self.link = module("link").Link(f"127.0.0.1:{self.server.port}")
        self.frames: list[Any] = []

    def _run(self) -> None:
        try:
            self.results.append(run_session(self._config, self._session, self._make))
            while self.server.wants_reset:
                self.results.append(run_session(self._config, self._session, self._make))
        except BaseException as fault:
            self.faults.append(fault)
        finally:
            self.server.close()

    def wait(self, found: Callable[[Any], Any], most_s: float = 60.0) -> Any:
        """What is found in a frame that comes; all of them are kept."""
        until = time.monotonic() + most_s
        while time.monotonic() < until:
            for frame in self.link.frames(0.1):
                self.frames.append(frame)
                if what := found(frame):
                    return what
        raise AssertionError(f"not found within {most_s} s: {self.faults}")

    def ask(self, op: str, **entries: Any) -> dict[str, Any]:
        """Say something and return the answer."""
        self.link.say(op, id="asked", **entries)
        answer: dict[str, Any] = self.wait(lambda frame: frame.op == "answer" and frame.header)
        return answer

    def end(self) -> Result:
        """Wait for the end of the run; returns its last result."""
        self._thread.join(120.0)
        if self.faults:
            raise self.faults[0]
        return self.results[-1]


@contextmanager
def bridged(config: RunConfig, session: SessionConfig, make: MakeSimulation = Simulation) -> Iterator[BridgedRun]:
    """A run with a client; both end with the block."""
    run = BridgedRun(config, session, make)
    try:
        yield run
    finally:
        run.link.say("end")
        run.link.close()
        run._thread.join(120.0)
