"""Viewer: a rerun viewer that runs, and what it is told and asked."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from fleet.recording.errors import RecordingError
from fleet.recording.rerun_cli import rerun_program

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient, ViewerState

T = TypeVar("T")
_PACKAGES = "mesa-vulkan-drivers libvulkan1 libgl1 libegl1"
_START_S = 20.0
"""Wall time given to the viewer to answer [s]."""
_LOAD_S = 120.0
"""Wall time given to it to read a recording, and to answer when it paints [s]."""
_TIMELINE = "sim_time"


class TooSlow(RecordingError):
    """This machine does not paint the recording in an acceptable time."""


class Viewer:
    """A viewer on a free loopback port, and a client of it; it stays when the program ends, unless it is closed.

    Args:
        options: More words for the program.
        environment: Its environment; None = that of this program.

    Raises:
        RecordingError: It does not run here, or does not answer.
    """

    def __init__(self, options: Sequence[str], environment: Mapping[str, str] | None = None) -> None:
        from rerun.experimental import ViewerClient

        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        command = [str(rerun_program()), "--bind", "127.0.0.1", "--port", str(port), *options]
        self._process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            self._client = _connect(ViewerClient, port, self._process)
        except BaseException:
            self.close()
            raise

    def ask(self, question: Callable[[ViewerClient], T]) -> T:
        """Ask the client something, as often as it takes; see `patiently`."""
        return patiently(self._process, lambda: question(self._client))

    def load(self, rrd: Path) -> None:
        """Open a recording and wait until all of it is there.

        Raises:
            RecordingError: It takes too long, or the viewer cannot read it.
        """
        self.ask(lambda client: client.open(str(rrd.resolve())))
        deadline = time.monotonic() + _LOAD_S
        while self.ask(lambda client: client.get_state().loading):
            if time.monotonic() > deadline:
                raise RecordingError(f"the viewer did not load {rrd} within {_LOAD_S:.0f} s")
            time.sleep(0.1)
        if not self.ask(lambda client: client.get_state().recordings):
            raise RecordingError(f"the viewer finds no recording in {rrd}; valid: a whole .rrd file of this version")

    def go_to(self, time_s: float, rrd: Path) -> None:
        """Show a moment of the recording that is loaded.

        Raises:
            RecordingError: It has none at that time.
        """
        require_moment(time_s, self.ask(lambda client: client.get_state()), rrd)
        self.ask(lambda client: client.set_time(_TIMELINE, duration=time_s, play_state="paused"))

    def close(self) -> None:
        """End the viewer."""
        self._process.terminate()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def open_window(rrd: Path, time_s: float | None = None) -> None:
    """Open a viewer that stays, on a recording.

    Args:
        rrd: The recording.
        time_s: Simulated time to show [s]; None = where it opens.

    Raises:
        RecordingError: The recording has nothing at that time or cannot be read, or the viewer does not run here.
    """
    if time_s is None:
        options = [str(rerun_program()), "--bind", "127.0.0.1", str(rrd)]
        subprocess.Popen(options, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return
    viewer = Viewer(())
    try:
        viewer.load(rrd)
        viewer.go_to(time_s, rrd)
    except BaseException:
        viewer.close()
        raise


def require_moment(time_s: float, state: ViewerState, rrd: Path) -> None:
    """Refuse a time at which a recording has nothing any more.

    Raises:
        RecordingError: It is after the end.
    """
    lines = [line for recording in state.recordings for line in recording.timelines if line.name == _TIMELINE]
    last_s = max((line.end for line in lines if line.end is not None), default=0) * 1e-9
    if time_s > last_s:
        raise RecordingError(f"time {time_s:g} s is not in {rrd}; valid: a number from 0 to {last_s:.2f}")


def patiently(process: subprocess.Popen[bytes], ask: Callable[[], T]) -> T:
    """Ask again when the viewer has not answered in the time that its client allows: painting in software is slow.

    It answers before it has looked for a graphics driver, and ends without one: then there is no answer any more.

    Raises:
        RecordingError: It has ended.
        TooSlow: It never answers.
    """
    deadline = time.monotonic() + _LOAD_S
    while True:
        try:
            return ask()
        except (ConnectionError, TimeoutError) as error:
            if process.poll() is not None:
                raise _ended(process) from error
            if time.monotonic() > deadline:
                raise TooSlow(f"the viewer did not paint within {_LOAD_S:.0f} s: {error}") from error


def _connect(client_type: type[ViewerClient], port: int, process: subprocess.Popen[bytes]) -> ViewerClient:
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise _ended(process)
        try:
            client = client_type.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.get_state()
        except (ConnectionError, RuntimeError, TimeoutError):
            time.sleep(0.1)
        else:
            return client
    raise RecordingError(f"the viewer did not answer within {_START_S:.0f} s")


def _ended(process: subprocess.Popen[bytes]) -> RecordingError:
    """What it means that the viewer has ended by itself."""
    return RecordingError(
        f"the viewer ended at once (exit status {process.returncode}): no graphics driver found; "
        f"on Debian or Ubuntu: apt-get install {_PACKAGES}"
    )
