"""A live run and its viewers: dead, frozen and late ones."""

import signal
import subprocess
from pathlib import Path

import pytest

from fleet.recording import Header, RerunRecorder
from fleet.recording.check import verify_recording
from fleet.recording.rerun_cli import quiet_environment, rerun_program
from tests.unit.fleet.recording.conftest import made_up_frames, made_up_scene
from tests.unit.fleet.recording.test_rerun_recorder import free_port, wait_for

N_FRAMES, N_LATE = 1200, 800


@pytest.mark.parametrize("fate", [signal.SIGKILL, signal.SIGSTOP])
def test_a_viewer_that_dies_or_freezes_takes_nothing_with_it_and_a_late_one_sees_all(
    tmp_path: Path, fate: signal.Signals
) -> None:
    scene, floor = made_up_scene(3, 4, (16.0, 12.0))
    path, late_path = tmp_path / "a.rrd", tmp_path / "late.rrd"
    viewers: list[subprocess.Popen[bytes]] = []
    with quiet_environment() as environment:

        def join(saved: Path) -> None:
            """A viewer without a window, which saves what it is sent."""
            command = [str(rerun_program()), "--connect", recorder.uri, "--save", str(saved)]
            silent = subprocess.DEVNULL
            viewers.append(subprocess.Popen(command, env=environment, stdout=silent, stderr=silent))
            wait_for(lambda: saved.exists() and saved.stat().st_size > 100_000)

        recorder = RerunRecorder(path, Header(scene=scene, floor=floor, about={}), tick_s=1 / 60, port=free_port())
        try:
            with recorder:
                for k, frame in enumerate(made_up_frames(scene, N_FRAMES)):
                    recorder.record(frame)
                    if k % 400 == 0:
                        wait_for(lambda k=k: recorder.n_written > k)
                    if k == 100:
                        join(tmp_path / "first.rrd")
                        viewers[0].send_signal(fate)
                    if k == N_LATE:
                        join(late_path)
                wait_for(lambda: recorder.n_written == N_FRAMES)
                wait_for(lambda: verify_recording(late_path).frames == N_FRAMES)
        finally:
            for viewer in viewers:
                viewer.kill()
                viewer.wait()
    assert (recorder.n_dropped, recorder.n_written) == (0, N_FRAMES)
    report = verify_recording(path)
    assert (report.verified, report.frames) == (True, N_FRAMES)
