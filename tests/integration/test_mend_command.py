"""`fleet mend`: what a killed run left of its recording passes the viewer's own check, and loses nothing of it."""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.recording.check import verify_recording
from fleet.recording.mend import readable_rows

KILLED_TICK = 300


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run that was killed while it recorded."""
    out = tmp_path_factory.mktemp("killed") / "run"
    # The batches of a run that is over in a moment would all be written at its end.
    code = f"""
import os
from pathlib import Path
from fleet.config import *
from fleet.recording import rerun_recorder
from fleet.session import *
from fleet.simulation import Simulation
rerun_recorder._BATCH_FRAMES = 20
tick = Simulation.tick
def dying(self):
    tick(self)
    if self.now == {KILLED_TICK}:
        os.kill(os.getpid(), 9)
Simulation.tick = dying
config = RunConfig(site="cell", robots=1, fidelity="kinematic", arms=ArmConfig(workers_n=0))
run_session(config, SessionConfig(out=Path({str(out)!r}), progress=False))
"""
    done = subprocess.run([sys.executable, "-c", code], check=False, env=dict(os.environ), timeout=300)
    assert done.returncode == -9
    return out


@pytest.fixture
def recording(killed: Path, tmp_path: Path) -> Path:
    """Return a copy of its recording, in a folder of its own."""
    copy = tmp_path / "recording.rrd"
    copy.write_bytes((killed / "recording.rrd").read_bytes())
    return copy


def mend(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit status, output and errors."""
    with pytest.raises(SystemExit) as stop:
        main(["mend", str(path)])
    said = capsys.readouterr()
    return int(str(stop.value.code)), said.out, said.err


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def rows(path: Path) -> Counter[str]:
    """Count rows by entity."""
    from rerun.chunk import RrdReader

    found: Counter[str] = Counter()
    for chunk in RrdReader(path).stream():
        found[str(chunk.entity_path)] += chunk.num_rows
    return found


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_killed_run_is_mended_with_all_its_rows(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = rows(recording)
    assert not verify_recording(recording).verified
    status, said, err = mend(recording.parent, capsys)
    assert (status, err) == (0, "")
    assert said.startswith("mended: all ")
    assert verify_recording(recording).verified
    assert rows(recording) == before
    assert before["/world/cars/body"] > 20
    assert [path.name for path in recording.parent.iterdir()] == ["recording.rrd"]


def test_a_file_that_ends_in_a_message_keeps_what_is_before(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = recording.read_bytes()
    recording.write_bytes(whole[: len(whole) * 9 // 10])
    n = readable_rows(recording)
    assert n > 100
    status, said, _ = mend(recording, capsys)
    assert (status, said.splitlines()[0]) == (0, f"mended: all {n} rows that could be read")
    report = verify_recording(recording)
    assert (report.verified, report.frames > 20) == (True, True)


def test_what_is_whole_is_left_alone(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mend(recording, capsys)
    mended = recording.read_bytes()
    status, said, _ = mend(recording, capsys)
    assert (status, said.startswith("whole: ")) == (0, True)
    assert recording.read_bytes() == mended


@pytest.mark.parametrize("content", [b"", b"not a recording", b"RRF2"])
def test_what_is_no_recording_is_one_line_and_stays(
    content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "recording.rrd"
    path.write_bytes(content)
    status, out, err = mend(path, capsys)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "nothing in it can be read; valid: a recording with data" in err
    assert path.read_bytes() == content


def test_without_a_recording_or_a_folder_it_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = mend(tmp_path, capsys)
    assert (status, err.count("\n"), "no recording at" in err) == (2, 1, True)
    status, _, err = mend(tmp_path / "none", capsys)
    assert (status, err.count("\n"), "valid: the --out directory of a run" in err) == (2, 1, True)


def test_a_mended_file_that_lost_rows_does_not_take_the_place_of_the_other(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = recording.read_bytes()
    monkeypatch.setattr("fleet.recording.mend.readable_rows", lambda path: 7 if path == recording else 6)
    status, _, err = mend(recording, capsys)
    assert (status, "6 of 7 rows would be kept; it was left as it was" in err) == (2, True)
    assert recording.read_bytes() == before
    assert [path.name for path in recording.parent.iterdir()] == ["recording.rrd"]


def test_a_recording_that_grows_is_not_replaced(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = recording.read_bytes()

    def written(path: Path) -> int:
        if path != recording:  # while it is mended, the run goes on
            recording.write_bytes(before + b"more")
        return 7

    monkeypatch.setattr("fleet.recording.mend.readable_rows", written)
    status, _, err = mend(recording, capsys)
    assert (status, "is still being written" in err) == (2, True)
    assert recording.read_bytes() == before + b"more"
