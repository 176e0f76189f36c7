"""What a frame promises, and what importing the package costs."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from fleet.recording import Frame, NullRecorder

Frames = Callable[[int], Iterator[Frame]]


def test_a_copied_frame_shares_nothing_with_the_simulation(frames: Frames) -> None:
    frame = next(frames(1))
    copy = frame.copied()
    before = frame.car_poses[0, 0]
    frame.car_poses[0, 0] += 1.0
    assert frame.paths is not None
    frame.paths[0][0, 0] = -7.0
    assert copy.car_poses[0, 0] == before
    assert copy.paths is not None
    assert copy.paths[0][0, 0] != -7.0


def test_the_null_recorder_wants_no_frames(frames: Frames) -> None:
    with NullRecorder() as recorder:
        assert not any(recorder.due(tick) for tick in range(100))
        recorder.record(next(frames(1)))


def test_importing_the_package_does_not_load_rerun(repository: Path) -> None:
    code = "import sys, fleet.recording, fleet.recording.check, fleet.recording.shot; print('rerun' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], cwd=repository, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "False"
