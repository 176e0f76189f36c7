"""Shot: a picture of a recording without a display."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fleet.recording.errors import RecordingError
from fleet.recording.rerun_cli import quiet_environment
from fleet.recording.viewer import Viewer
from fleet.whole_file import write_whole

_ALIKE = 3
"""Paintings in a row that are alike when nothing loads any more: meshes, plots and labels come one after the other."""
_MOST_PAINTED = 20
"""After so many the picture is taken as it is: something in it moves."""
_SOFTWARE_VULKAN = Path("/usr/share/vulkan/icd.d")


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
        RecordingError: The file or view is missing, the file cannot be read, the time is after its end, or the viewer
            does not run here.

    Source: the viewer paints on demand when headless and takes `--screenshot-to` before views have loaded, hence
        the client and the repeated painting.
    """
    if not rrd.is_file():
        raise RecordingError(f"no recording at {rrd}")
    with _headless(size) as viewer:
        viewer.load(rrd)
        if time_s is not None:
            viewer.go_to(time_s, rrd)
        picture = _settled(lambda: viewer.ask(lambda client: client.take_screenshot()))
        state = viewer.ask(lambda client: client.get_state())
        ids = {v.name: v.view_id for v in state.views}
        if view is not None and view not in ids:
            raise RecordingError(f"no view {view!r} in {rrd}; valid: {', '.join(sorted(map(str, ids)))}")
        if view is not None:
            picture = _settled(lambda: viewer.ask(lambda client: client.take_screenshot(view_id=ids[view])))
        write_whole(png, picture)
        complaints = [f"{v.name}: {r.severity}: {r.summary}" for v in state.views for r in v.reports]
        logs = viewer.ask(lambda client: client.get_logs())
        complaints += [f"{e.level}: {e.message}" for e in logs if e.level == "ERROR"]
        return tuple(complaints)


def _settled(paint: Callable[[], bytes]) -> bytes:
    """Paint until the picture stays the same, as a machine without a graphics card takes a second for each."""
    picture, n_alike = paint(), 1
    for _ in range(_MOST_PAINTED - 1):
        if n_alike == _ALIKE:
            break
        before, picture = picture, paint()
        n_alike = n_alike + 1 if picture == before else 1
    return picture


@contextmanager
def _headless(size: tuple[int, int]) -> Iterator[Viewer]:
    """A viewer without a window."""
    options = ("--headless", "--hide-welcome-screen", "--window-size", f"{size[0]}x{size[1]}", "--memory-limit", "4GB")
    with quiet_environment() as environment:
        driver = next(iter(sorted(_SOFTWARE_VULKAN.glob("lvp_icd*.json"))), None)
        if driver is not None and "VK_DRIVER_FILES" not in os.environ:
            environment.update(VK_ICD_FILENAMES=str(driver), VK_DRIVER_FILES=str(driver))
        viewer = Viewer(options, environment)
        try:
            yield viewer
        finally:
            viewer.close()


def parse_size(text: str) -> tuple[int, int] | None:
    """Width and height [px] of ``"1600x900"``; None if it says nothing of the kind."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        return None
    return int(width), int(height)
