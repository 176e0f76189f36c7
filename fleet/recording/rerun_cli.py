"""Cli: runs the program that comes with rerun-sdk, on the loopback interface and without telemetry."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from fleet.recording.errors import RecordingError
from fleet.whole_file import draft_of


def rerun_program() -> Path:
    """Path of the rerun program.

    Raises:
        RecordingError: rerun-sdk is not installed.
    """
    spec = importlib.util.find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise RecordingError("the rerun program is missing; install the package rerun-sdk")
    program = Path(spec.origin).with_name("rerun")
    if not program.exists():
        program = program.with_suffix(".exe")
    if not program.exists():
        raise RecordingError(f"no rerun program in {program.parent}; install the package rerun-sdk again")
    return program


def compact(path: Path) -> bool:
    """Put the many small chunks of a recording together, in one step: readers see the old file or the new one.

    A recorder writes several times a second, so that little is lost when it is killed; every chunk costs 2 kB.

    Returns:
        False, with the file as it was, if that did not work.
    """
    try:
        with draft_of(path) as part:
            done = run_rerun(["rrd", "optimize", str(path.resolve()), "-o", str(part)])
            if done.returncode:
                raise RecordingError(f"{path}: its chunks cannot be put together")
    except (OSError, RecordingError):
        return False
    return True


@contextmanager
def quiet_environment() -> Iterator[dict[str, str]]:
    """Environment for the program: settings in a directory of its own, in which telemetry is off."""
    with tempfile.TemporaryDirectory(prefix="rerun-") as home:
        environment = dict(os.environ, HOME=home, XDG_CONFIG_HOME=home, XDG_RUNTIME_DIR=home, RUST_LOG="warn")
        subprocess.run([rerun_program(), "analytics", "disable"], env=environment, capture_output=True, check=False)
        yield environment


def run_rerun(arguments: Sequence[str], *, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    """Run one command of the program to its end.

    Args:
        arguments: For example ``["rrd", "verify", "a.rrd"]``.
        timeout_s: Wall time allowed [s].

    Returns:
        Exit status and output.

    Raises:
        RecordingError: rerun-sdk is missing, or the time is over.
    """
    with quiet_environment() as environment:
        try:
            return subprocess.run(
                [rerun_program(), *arguments],
                env=environment,
                capture_output=True,
                text=True,
                timeout=timeout_s,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise RecordingError(f"rerun {' '.join(arguments)} did not end within {timeout_s:.0f} s") from error
