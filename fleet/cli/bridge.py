"""The bridge command: starts what shows a run to ROS, or tells where its files lie."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from fleet.config import require

SCRIPTS = {"ros2": "ros2_node.py", "ros1": "ros1_node.py", "rosbridge": "rosbridge.py"}
PLACES = (Path(__file__).parents[2] / "bridge", Path(__file__).parents[1] / "assets" / "bridge")
"""Where the files lie: in a checkout, and in an installed package."""


@dataclass(frozen=True, kw_only=True)
class BridgeCommand:
    """Show a run with --bridge to ROS 2, ROS 1 or clients of rosbridge, by a process of its own.

    The files need no fleet: copy the folder to where your ROS is, and start them there.
    """

    kind: Annotated[Literal["ros2", "ros1", "rosbridge", "files"], tyro.conf.Positional]
    """What to start; files: print where the files lie."""
    to: str = "127.0.0.1:9870"
    """HOST:PORT of the run."""
    python: Path | None = None
    """Python that has rclpy, rospy or websockets; default: the one that runs this."""
    camera: tuple[str, ...] = ()
    """A station whose pictures are wanted; once for each."""
    port: int = 9090
    """Port of rosbridge."""

    def run(self) -> int:
        """Start it and wait for its end; returns its exit status."""
        folder = next((place for place in PLACES if place.is_dir()), PLACES[0])
        if self.kind == "files":
            print(folder)  # noqa: T201 - what was asked for
            return 0
        host, colon, port = self.to.rpartition(":")
        ok = bool(host and colon and port.isdecimal() and 0 < int(port) < 1 << 16)
        require(ok, "--to", self.to, "HOST:PORT, such as 127.0.0.1:9870")
        require(0 <= self.port < 1 << 16, "--port", self.port, f"an integer from 0 to {(1 << 16) - 1}")
        python = self.python or Path(sys.executable)
        require(python.is_file(), "--python", str(python), "a Python")
        words = [str(python), str(folder / SCRIPTS[self.kind]), self.to]
        if self.kind == "rosbridge":
            words += ["--port", str(self.port)]
        words += [word for station in self.camera for word in ("--camera", station)]
        # The descriptors 1 and 2 of this process lead to nowhere, see `fleet.terminal.console`.
        return subprocess.run(words, stdout=sys.stdout, stderr=sys.stderr, check=False).returncode
