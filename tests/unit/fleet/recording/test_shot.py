"""Pictures without a display."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from fleet.recording import Header, RecordingError, RerunRecorder
from fleet.recording.rerun_cli import rerun_program
from fleet.recording.shot import _settled, parse_size, screenshot
from fleet.recording.viewer import TooSlow, patiently, require_moment
from tests.unit.fleet.recording.conftest import made_up_frames, made_up_scene

SOFTWARE_DRIVER = any(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json"))


def test_a_missing_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no recording at"):
        screenshot(tmp_path / "a.rrd", tmp_path / "a.png")


@pytest.mark.parametrize("said", ["wide", "80", "80x", "0x60", "80x-1"])
def test_a_malformed_size_is_none(said: str) -> None:
    assert parse_size(said) is None
    assert parse_size("80x60") == (80, 60)


def test_without_a_graphics_driver_the_packages_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A friction of the first hour: on a server, the bare words 'transport error'."""
    (tmp_path / "a.rrd").write_bytes(b"")
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, str(tmp_path / "none.json"))
    monkeypatch.setenv("LIBGL_DRIVERS_PATH", str(tmp_path))
    with pytest.raises(RecordingError, match="mesa-vulkan-drivers"):
        screenshot(tmp_path / "a.rrd", tmp_path / "a.png")


def test_a_viewer_that_ends_after_it_has_answered_has_no_graphics_driver() -> None:
    """A friction of the first hour: the client's 'transport error' where the viewer died late."""

    def ask() -> None:
        raise ConnectionError("transport error")

    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
        with pytest.raises(RecordingError, match=r"no graphics driver found; .*mesa-vulkan-drivers"):
            patiently(process, ask)


def test_the_viewer_is_started_itself() -> None:
    """A friction of the first hour: the launcher was killed, and the viewer that it had started went on."""
    launcher = Path(sys.executable).with_name("rerun")
    assert launcher.read_bytes()[:2] == b"#!"
    assert rerun_program().read_bytes()[:2] != b"#!"


@pytest.mark.parametrize(
    ("painted", "taken", "n_paintings"),
    [("aaa", "a", 3), ("abccc", "c", 5), ("abababaaa", "a", 9), ("ab" * 20, "b", 20)],
)
def test_a_picture_is_taken_when_it_stays_the_same(painted: str, taken: str, n_paintings: int) -> None:
    """A friction of the first hour: forty seconds for a picture, most of them after it was there."""
    left = [letter.encode() for letter in reversed(painted)]
    assert _settled(left.pop) == taken.encode()
    assert len(painted) - len(left) == n_paintings


def test_a_time_after_the_end_is_refused() -> None:
    line = SimpleNamespace(name="sim_time", end=12_500_000_000)
    state = SimpleNamespace(recordings=[SimpleNamespace(timelines=[SimpleNamespace(name="tick", end=10**12), line])])
    require_moment(12.5, state, Path("a.rrd"))  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match=r"time 13 s is not in a\.rrd; valid: a number from 0 to 12\.50"):
        require_moment(13.0, state, Path("a.rrd"))  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.skipif(not SOFTWARE_DRIVER, reason="needs the software Vulkan driver (mesa-vulkan-drivers)")
@pytest.mark.parametrize(("n_cars", "n_arms", "size_m"), [(3, 4, (16, 12)), (20, 12, (40, 24)), (100, 20, (70, 44))])
def test_the_viewer_paints_every_layout_without_complaints(
    tmp_path: Path, n_cars: int, n_arms: int, size_m: tuple[float, float]
) -> None:
    scene, floor = made_up_scene(n_cars, n_arms, size_m)
    path = tmp_path / "a.rrd"
    with RerunRecorder(path, Header(scene=scene, floor=floor, about={}), tick_s=1 / 60) as recorder:
        for frame in made_up_frames(scene, 60):
            recorder.record(frame)
    try:
        complaints = screenshot(path, tmp_path / "a.png", time_s=1.0, size=(1600, 900))
    except TooSlow as error:
        pytest.skip(str(error))
    assert complaints == ()
    assert len((tmp_path / "a.png").read_bytes()) > 50_000


@pytest.mark.slow
@pytest.mark.skipif(not SOFTWARE_DRIVER, reason="needs the software Vulkan driver (mesa-vulkan-drivers)")
def test_a_file_that_only_begins_like_a_recording_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    path.write_bytes(b"RRF2 and then something else")
    with pytest.raises(RecordingError, match="the viewer finds no recording in "):
        screenshot(path, tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()
