"""Partners: programs of others that tests talk to: whether they are there, and how they are set up."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.interop.brokers import mosquitto

REPOSITORY = Path(__file__).resolve().parents[2]
FOLDER = REPOSITORY / ".partners"
ROS2 = REPOSITORY / ".venv-ros"
SDK = FOLDER / "vda5050-sdk"
DEBIAN_PYTHON = "/usr/bin/python3"
_ROS2_WHEELS = (
    "ros-rclpy",
    "ros-rmw-fastrtps-cpp",
    "ros-std-msgs",
    "ros-std-srvs",
    "ros-geometry-msgs",
    "ros-nav-msgs",
    "ros-sensor-msgs",
    "ros-trajectory-msgs",
    "ros-rosgraph-msgs",
)
_ROS1_DEBS = (
    "python3-rospy",
    "python3-rosmaster",
    "python3-rostopic",
    "python3-sensor-msgs",
    "python3-geometry-msgs",
    "python3-nav-msgs",
    "python3-trajectory-msgs",
    "python3-std-srvs",
    "python3-rosgraph-msgs",
)
_LINE = 200
"""Longest reason that is shown, in characters."""

Command = tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Partner:
    """A program of others."""

    name: str
    """As the marker `interop` of its tests has it."""
    home: str
    """Where it comes from."""
    lack: Callable[[], str]
    """Says what is missing; empty = it is there."""
    commands: tuple[Command, ...]
    """What sets it up, one after the other; begun anew, they do no harm."""
    needs_root: bool = False

    def set_up(self) -> str:
        """Set it up unless it is there.

        Returns:
            Why it is not there; empty = it is.
        """
        if not self.lack():
            return ""
        if self.needs_root and os.geteuid() != 0:
            return f"only root can set it up: {' '.join(self.commands[-1])}"
        for words in self.commands:
            if shutil.which(words[0]) is None:
                return f"{words[0]} is not on this machine"
            done = subprocess.run(words, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
            if done.returncode:
                return f"`{' '.join(words)[:_LINE]}` failed: {_reason(done.stderr or done.stdout)}"
        return self.lack()


def _reason(said: str) -> str:
    """The line of a failed command that says why."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    telling = [line for line in lines if "error" in line.lower() or line.startswith("E:")]
    return (telling or lines or ["it says nothing"])[0][:_LINE]


def _imports(python: str | Path, *modules: str) -> Callable[[], str]:
    def lack() -> str:
        if not Path(python).is_file():
            return f"there is no {python}"
        words = [str(python), "-c", f"import {', '.join(modules)}"]
        here = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "_ROS"))}
        done = subprocess.run(words, capture_output=True, text=True, check=False, env=here)
        return f"{python} has no {' '.join(modules)}" if done.returncode else ""

    return lack


def _venv(folder: Path, *packages: str) -> tuple[Command, ...]:
    pip = (str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    return (sys.executable, "-m", "venv", str(folder)), (*pip, "--retries", "1", *packages)


def _debs(*packages: str) -> tuple[Command, ...]:
    return (
        ("apt-get", "update", "-qq"),
        ("apt-get", "install", "-qq", "-y", "--no-install-recommends", *packages),
    )


def _npm(name: str, version: str) -> Partner:
    folder = FOLDER / name
    install = ("npm", "install", "--silent", "--no-audit", "--no-fund", "--prefix", str(folder), f"{name}@{version}")

    def lack() -> str:
        if shutil.which("node") is None:
            return "node is not on this machine"
        there = (folder / "node_modules" / name / "package.json").is_file()
        return "" if there else f"there is no {name} in {folder.relative_to(REPOSITORY)}"

    return Partner(name=name, home="npm", lack=lack, commands=(install,))


def _mosquitto() -> str:
    return "" if mosquitto() else "mosquitto is not on this machine"


PARTNERS = {
    partner.name: partner
    for partner in (
        # An environment of its own: its packages restart every Python of it with another search path for libraries.
        Partner(
            name="ROS 2",
            home="PyPI",
            lack=_imports(ROS2 / "bin" / "python", "rclpy", "rosgraph_msgs", "trajectory_msgs"),
            commands=_venv(ROS2, *_ROS2_WHEELS),
        ),
        Partner(
            name="ROS 1",
            home="Debian",
            lack=_imports(DEBIAN_PYTHON, "rospy", "rosmaster", "trajectory_msgs"),
            commands=_debs(*_ROS1_DEBS),
            needs_root=True,
        ),
        _npm("roslib", "2"),
        _npm("vda-5050-lib", "1.4.0"),
        Partner(
            name="vda5050-sdk",
            home="PyPI",
            lack=_imports(SDK / "bin" / "python", "vda5050", "aiomqtt"),
            commands=_venv(SDK, "vda5050-sdk[mqtt]==0.2.0"),
        ),
        Partner(name="mosquitto", home="Debian", lack=_mosquitto, commands=_debs("mosquitto"), needs_root=True),
    )
}
"""The partners by name."""
