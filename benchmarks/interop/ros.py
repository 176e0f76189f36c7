"""ROS: what a foreign rclpy process gets of a run in physics, how late, and what the bridge costs the run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.arrays import FloatArray
from fleet.bridge.bridge import Bridge
from fleet.bridge.server import BridgeServer
from fleet.config import Fidelity, RunConfig
from fleet.session import SessionConfig, run_session
from fleet.simulation import Actions, Simulation
from fleet.terminal.pacing import Pace

REPOSITORY = Path(__file__).resolve().parents[2]
PYTHON = REPOSITORY / ".venv-ros" / "bin" / "python"
LISTENER = REPOSITORY / "tests" / "interop" / "partners" / "ros2_listen.py"
CARS, ARMS = 8, 4
CONFIG = RunConfig(site="small", robots=CARS, tasks=2 * CARS, fidelity=Fidelity.PHYSICS)
_TICKS, _QUICK_TICKS = 3600, 600
_DOMAIN = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": "83"}
_READER = """
import socket, sys
link = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
while link.recv(1 << 18): pass
"""


def measure_ros(trial: Trial) -> Iterable[Row]:
    """Let a run go at the speed of the clock, and count what arrives; then see what the bridge costs."""
    n_ticks = _QUICK_TICKS if trial.quick else _TICKS
    if PYTHON.is_file():
        share, late_ms, node_s = _arrivals(n_ticks)
        yield Row(name="R1 least share of a topic that arrives", value=share, unit="", target=">= 0.99")
        yield Row(name="R1 late, median", value=float(np.median(late_ms)), unit="ms", kind=Kind.TIME)
        yield Row(
            name="R1 late, 95 % of messages",
            value=float(np.percentile(late_ms, 95)),
            unit="ms",
            kind=Kind.TIME,
            target="<= 5",
        )
        yield Row(
            name="R1 computing of the node per message, with its start",
            value=1e6 * node_s / len(late_ms),
            unit="us",
            kind=Kind.TIME,
        )
    else:
        trial.notes.append("R1: what arrives is left out, ROS 2 is not in .venv-ros (make test-interop)")
    yield Row(
        name="R1 computing of the bridge, by that of a tick", value=_share(n_ticks // 2), unit="", target="<= 0.1"
    )


class _Timed(Simulation):
    """Notes when each tick ended."""

    def __init__(self, config: RunConfig, **words: Any) -> None:
        self.ended_s: dict[int, float] = {}
        super().__init__(config, **words)

    def tick(self, actions: Actions | None = None) -> None:
        """See `Simulation`."""
        super().tick(actions)
        self.ended_s[round(self.sim_s * 1e9)] = time.time()


def _arrivals(n_ticks: int) -> tuple[float, FloatArray, float]:
    """What arrives.

    Returns:
        Share of the ticks that arrived on the topic with the fewest, how late messages were [ms], shape (k,), and the
        computing of the node that sent them [s].
    """
    made: list[_Timed] = []

    def make(config: RunConfig, **words: Any) -> _Timed:
        made.append(_Timed(config, **words))
        return made[-1]

    with tempfile.TemporaryDirectory() as folder, BridgeServer("127.0.0.1:0") as server:
        session = SessionConfig(out=Path(folder) / "run", record=False, progress=False, speed=1.0, bridge=server)
        # It ends long after the listener has heard enough.
        config = replace(CONFIG, duration_s=120.0 + n_ticks / 60.0)
        run = threading.Thread(target=lambda: run_session(config, session, make), daemon=True)
        run.start()
        with _node(str(REPOSITORY / "bridge" / "ros2_node.py"), f"127.0.0.1:{server.port}") as node_s:
            words = [str(PYTHON), str(LISTENER), str(n_ticks), str(CARS), str(ARMS)]
            heard = subprocess.run(words, env=os.environ | _DOMAIN, capture_output=True, text=True, check=True).stdout
        _end(server.port)
        run.join()
    came = json.loads(heard.split("result ", 1)[1])
    sent = made[0].ended_s
    clock = [stamp for stamp, _ in came["/clock"]]
    whole = {stamp for stamp in sent if min(clock) < stamp < max(clock)}
    share = min(len(whole & {stamp for stamp, _ in messages}) / len(whole) for messages in came.values())
    late = [1e3 * (at_s - sent[stamp]) for messages in came.values() for stamp, at_s in messages]
    return share, np.array(late), node_s[0]


def _share(n_ticks: int) -> float:
    """Time of computing that the bridge takes with one client, by that of the ticks."""
    with Simulation(CONFIG) as simulation, BridgeServer("127.0.0.1:0") as server:
        bridge = Bridge(simulation, server, Pace(0.0))
        reader = subprocess.Popen([sys.executable, "-c", _READER, str(server.port)])
        while not server.clients:
            server.poll(0.1)
        tick_s = look_s = 0.0
        for _ in range(n_ticks):
            begin_s = time.process_time()
            simulation.tick()
            between_s = time.process_time()
            bridge.look()
            tick_s, look_s = tick_s + between_s - begin_s, look_s + time.process_time() - between_s
    reader.wait()
    return look_s / tick_s


@contextmanager
def _node(*words: str) -> Iterator[list[float]]:
    """A program under ROS 2, for as long as the block lasts; then what is yielded has its computing [s]."""
    spent: list[float] = []
    process = subprocess.Popen([str(PYTHON), *words], env=os.environ | _DOMAIN, stdout=subprocess.DEVNULL)
    try:
        yield spent
    finally:
        process.terminate()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        spent.append(used.ru_utime + used.ru_stime)


def _end(port: int) -> None:
    """Ask a run to end."""
    sys.path.insert(0, str(REPOSITORY / "bridge"))
    from link import Link  # type: ignore[import-not-found]

    Link(f"127.0.0.1:{port}").say("end")
    sys.path.pop(0)
