"""Shot: a picture of a recording without a display."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from fleet.recording.errors import RecordingError
from fleet.recording.rerun_cli import quiet_environment, rerun_program

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient, ViewerState

T = TypeVar("T")
_PACKAGES = "mesa-vulkan-drivers libvulkan1 libgl1 libegl1"
_START_S = 20.0
"""Wall time given to the viewer to answer [s]."""
_LOAD_S = 120.0
"""Wall time given to it to read the recording [s]."""
_TIMELINE = "sim_time"
_ALIKE = 3
"""Paintings in a row that are alike when nothing loads any more: meshes, plots and labels come one after the other."""
_MOST_PAINTED = 20
"""After so many the picture is taken as it is: something in it moves."""
_SOFTWARE_VULKAN = Path("/usr/share/vulkan/icd.d")


class TooSlow(RecordingError):
    """This machine does not paint the recording in an acceptable time."""


def screenshot(
    rrd: Path,
    png: Path,
    *,
    time_s: float | None = None,
    size: tuple[int, int] = (1600, 900),
    view: str | None = None,
) -> tuple[str, ...]:
    """Paint a recording at one time and save the picture.

    Args:
        rrd: Recording.
        png: Picture to write.
        time_s: Simulated time [s]; None = where the recording opens.
        size: Width and height [px].
        view: Name of the one view to paint; None = the whole window.

    Returns:
        Complaints of the viewer, none if all is well.

    Raises:
        RecordingError: The file or view is missing, the time is after its end, or the viewer does not run here.

    Source: the viewer paints on demand when headless and takes `--screenshot-to` before views have loaded, hence
        the client and the repeated painting.
    """
    if not rrd.is_file():
        raise RecordingError(f"no recording at {rrd}")
    with _viewer(size) as (client, process):
        patiently = partial(_patiently, process)
        patiently(lambda: client.open(str(rrd.resolve())))
        deadline = time.monotonic() + _LOAD_S
        while patiently(client.get_state).loading:
            if time.monotonic() > deadline:
                raise RecordingError(f"the viewer did not load {rrd} within {_LOAD_S:.0f} s")
            time.sleep(0.1)
        if time_s is not None:
            _require_moment(time_s, patiently(client.get_state), rrd)
            patiently(lambda: client.set_time(_TIMELINE, duration=time_s, play_state="paused"))
        picture = _settled(lambda: patiently(client.take_screenshot))
        state = patiently(client.get_state)
        ids = {v.name: v.view_id for v in state.views}
        if view is not None and view not in ids:
            raise RecordingError(f"no view {view!r} in {rrd}; valid: {', '.join(sorted(map(str, ids)))}")
        if view is not None:
            picture = _settled(lambda: patiently(lambda: client.take_screenshot(view_id=ids[view])))
        png.write_bytes(picture)
        complaints = [f"{v.name}: {r.severity}: {r.summary}" for v in state.views for r in v.reports]
        complaints += [f"{e.level}: {e.message}" for e in client.get_logs() if e.level == "ERROR"]
        return tuple(complaints)


def _require_moment(time_s: float, state: ViewerState, rrd: Path) -> None:
    """Refuse a time at which a recording has nothing any more."""
    lines = [line for recording in state.recordings for line in recording.timelines if line.name == _TIMELINE]
    last_s = max((line.end for line in lines if line.end is not None), default=0) * 1e-9
    if time_s > last_s:
        raise RecordingError(f"time {time_s:g} s is not in {rrd}; valid: a number from 0 to {last_s:.2f}")


def _settled(paint: Callable[[], bytes]) -> bytes:
    """Paint until the picture stays the same, as a machine without a graphics card takes a second for each."""
    picture, n_alike = paint(), 1
    for _ in range(_MOST_PAINTED - 1):
        if n_alike == _ALIKE:
            break
        before, picture = picture, paint()
        n_alike = n_alike + 1 if picture == before else 1
    return picture


def _patiently(process: subprocess.Popen[bytes], ask: Callable[[], T]) -> T:
    """Ask again when the viewer has not answered in the time that its client allows: painting in software is slow.

    It answers before it has looked for a graphics driver, and ends without one: then there is no answer any more.
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


@contextmanager
def _viewer(size: tuple[int, int]) -> Iterator[tuple[ViewerClient, subprocess.Popen[bytes]]]:
    """A headless viewer on a free loopback port."""
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [
        str(rerun_program()),
        *("--headless", "--hide-welcome-screen", "--bind", "127.0.0.1", "--port", str(port)),
        *("--window-size", f"{size[0]}x{size[1]}", "--memory-limit", "4GB"),
    ]
    with quiet_environment() as environment:
        driver = next(iter(sorted(_SOFTWARE_VULKAN.glob("lvp_icd*.json"))), None)
        if driver is not None and "VK_DRIVER_FILES" not in os.environ:
            environment.update(VK_ICD_FILENAMES=str(driver), VK_DRIVER_FILES=str(driver))
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield _connect(ViewerClient, port, process), process
        finally:
            process.terminate()
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


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


def parse_size(text: str) -> tuple[int, int] | None:
    """Width and height [px] of ``"1600x900"``; None if it says nothing of the kind."""
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        return None
    return int(width), int(height)
