"""What a frame promises, and what importing the package costs."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from fleet.recording import Frame, NullRecorder

Frames = Callable[[int], Iterator[Frame]]


def test_the_null_recorder_wants_no_frames(frames: Frames) -> None:
    with NullRecorder() as recorder:
        assert not any(recorder.due(tick) for tick in range(100))
        recorder.record(next(frames(1)))


def test_importing_the_package_does_not_load_rerun(repository: Path) -> None:
    code = "import sys, fleet.recording, fleet.recording.check, fleet.recording.shot; print('rerun' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], cwd=repository, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "False"
