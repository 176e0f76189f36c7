"""Recordings read back from their files: complete, true to the frames, readable after any end."""

import io
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from fleet.recording import DrawnFloor, Frame, Header, LogLine, RecordingError, RerunRecorder
from fleet.recording.check import verify_recording
from fleet.sensors.camera import Camera, CameraImage
from fleet.world.scene import Scene

Frames = Callable[[int], Iterator[Frame]]
Site = tuple[Scene, DrawnFloor]
STEP_M = 1.3e-4
"""Half a step of the grid on which poses are recorded."""


def open_recorder(path: Path, site: Site, **changes: object) -> RerunRecorder:
    settings: dict = {"tick_s": 1 / 60} | changes
    cameras = settings.pop("cameras", ())
    header = Header(scene=site[0], floor=site[1], about={"seed": 0}, cameras=cameras)
    return RerunRecorder(path, header, **settings)


def rows(path: Path, entity: str, component: str) -> dict[int, list]:
    """Tick -> value of one component, from the file."""
    from rerun.chunk import RrdReader

    found: dict[int, list] = {}
    for chunk in RrdReader(path).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        if component in batch.schema.names and "tick" in batch.schema.names:
            for tick, value in zip(batch.column("tick").to_pylist(), batch.column(component).to_pylist(), strict=True):
                if value is not None:
                    found[tick] = value
    return dict(sorted(found.items()))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Frame]]:
    """Four seconds of three cars and four arms, and the frames that went in."""
    from tests.unit.fleet.recording.conftest import lines_of, made_up_frames, made_up_scene

    site = made_up_scene(3, 4, (16.0, 12.0))
    path = tmp_path_factory.mktemp("recording") / "a.rrd"
    frames = list(made_up_frames(site[0], 120))
    with open_recorder(path, site) as recorder:
        for frame in frames:
            recorder.record(frame)
            for line in lines_of(frame):
                recorder.log(line)
    return path, frames


def test_a_finished_recording_verifies_and_shows_everything(recording: tuple[Path, list[Frame]]) -> None:
    report = verify_recording(recording[0])
    assert report.verified, report.note
    assert report.frames == 120
    assert report.last_sim_s == pytest.approx(119 / 30)
    assert (
        report.missing(
            *(
                "/world/cars/body",
                "/world/arms/link_7",
                "/world/parcels",
                "/world/paths/granted",
                "/world/paths/planned",
            ),
            *("/world/boxes/wall", "/world/floor/lanes", "/world/labels", "/states/cars/car_2", "/states/arms/arm_3"),
            *("/states/tasks/order_1", "/counts", "/metrics", "/log", "/about"),
        )
        == ()
    )
    assert report.missing("/world/elephants") == ("/world/elephants",)


def test_car_positions_are_those_of_the_frames(recording: tuple[Path, list[Frame]]) -> None:
    path, frames = recording
    found = rows(path, "/world/cars/body", "InstancePoses3D:translations")
    assert list(found) == [frame.tick for frame in frames]
    for frame in frames:
        np.testing.assert_allclose(np.array(found[frame.tick])[:, :2], frame.car_poses[:, :2], atol=STEP_M)


def test_parcels_appear_and_vanish_with_colours_that_stay(recording: tuple[Path, list[Frame]]) -> None:
    path, frames = recording
    centres = rows(path, "/world/parcels", "Boxes3D:centers")
    assert [len(centres[frame.tick]) for frame in frames] == [len(frame.parcel_ids) for frame in frames]
    colours = rows(path, "/world/parcels", "Boxes3D:colors")
    assert [len(row) for row in colours.values()] == [4, 5]
    first, second = colours.values()
    assert second[:4] == first


def test_states_are_logged_on_change_only(recording: tuple[Path, list[Frame]]) -> None:
    states = rows(recording[0], "/states/arms/arm_0", "StateChange:state")
    assert states == {0: ["idle"], 180: ["planning"]}


def test_paths_are_logged_on_change_only(recording: tuple[Path, list[Frame]]) -> None:
    path, frames = recording
    strips = rows(path, "/world/paths/granted", "LineStrips3D:strips")
    assert list(strips) == [frame.tick for frame in frames if frame.paths is not None]
    assert frames[0].paths is not None
    np.testing.assert_allclose(np.array(strips[0][1])[:, :2], frames[0].paths[1], atol=1e-5)


def test_a_run_that_raises_leaves_a_whole_recording(tmp_path: Path, site: Site, frames: Frames) -> None:
    def interrupted() -> None:
        with open_recorder(tmp_path / "a.rrd", site) as recorder:
            for frame in frames(30):
                recorder.record(frame)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    report = verify_recording(tmp_path / "a.rrd")
    assert (report.verified, report.frames) == (True, 30)


KILLED = """
import sys, time
from pathlib import Path
from tests.unit.fleet.recording.conftest import made_up_frames, made_up_scene
from fleet.recording import Header, RerunRecorder
scene, floor = made_up_scene(3, 4, (16.0, 12.0))
recorder = RerunRecorder(Path(sys.argv[1]), Header(scene=scene, floor=floor, about={}), tick_s=1 / 60)
for k, frame in enumerate(made_up_frames(scene, 10_000)):
    recorder.record(frame)
    if k == 300:
        print("going", flush=True)
    time.sleep(0.005)
"""


def test_a_killed_process_leaves_a_readable_recording(tmp_path: Path, repository: Path) -> None:
    path = tmp_path / "a.rrd"
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)], cwd=repository, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGKILL)
    report = verify_recording(path)
    assert not report.verified
    assert "repair" in report.note
    # 5 ms per frame or more: what is lost is under 1.5 s
    assert report.frames > 300 - 1.5 / 0.005 * 0.9


def test_a_file_that_ends_inside_a_message_is_read_up_to_there(
    tmp_path: Path, recording: tuple[Path, list[Frame]]
) -> None:
    content = recording[0].read_bytes()
    (tmp_path / "cut.rrd").write_bytes(content[: len(content) * 99 // 100])
    report = verify_recording(tmp_path / "cut.rrd")
    assert not report.verified
    assert report.missing("/world/boxes/wall") == ()


@pytest.mark.parametrize("content", [b"", b"not a recording"])
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.rrd").write_bytes(content)
    with pytest.raises(RecordingError, match=r"a\.rrd"):
        verify_recording(tmp_path / "a.rrd")
    with pytest.raises(RecordingError, match="no recording at"):
        verify_recording(tmp_path / "b.rrd")


def test_frames_come_at_the_rate_asked_for(tmp_path: Path, site: Site) -> None:
    with open_recorder(tmp_path / "a.rrd", site, rate_hz=30.0, tick_s=1 / 60) as recorder:
        assert [tick for tick in range(7) if recorder.due(tick)] == [0, 2, 4, 6]
    with open_recorder(tmp_path / "b.rrd", site, rate_hz=30.0, tick_s=0.1) as recorder:
        assert all(recorder.due(tick) for tick in range(7))


def test_no_parcels_no_arms_no_paths_is_a_recording_too(tmp_path: Path, site: Site, frames: Frames) -> None:
    from dataclasses import replace

    scene = replace(site[0], arms=site[0].arms.part(()), arm_base=np.empty((0, 4)), arm_start=np.empty((0, 7)))
    with open_recorder(tmp_path / "a.rrd", (scene, site[1])) as recorder:
        for frame in frames(5):
            bare = replace(
                frame,
                arm_q=np.empty((0, 7)),
                arm_state=(),
                parcel_ids=np.empty(0, np.int64),
                parcel_poses=np.empty((0, 7)),
                parcel_size_m=np.empty((0, 3)),
                paths=(np.empty((0, 2)),) * 3,
                metrics={},
                task_counts={},
            )
            recorder.record(bare)
    assert verify_recording(tmp_path / "a.rrd").frames == 5


def test_what_a_camera_saw_is_shown_once_behind_its_pinhole(tmp_path: Path, site: Site, frames: Frames) -> None:
    from dataclasses import replace

    camera = Camera.looking_at("eye", eye_m=(1, 1, 2), target_m=(2, 1, 0), width_px=40, height_px=30, far_m=4.0)
    depth = np.linspace(1.0, 3.0, 1200, dtype=np.float32).reshape(30, 40)
    depth[0, 0] = np.inf
    nothing = np.full((30, 40), -1, dtype=np.int32)
    rgb = np.full((30, 40, 3), 128, dtype=np.uint8)
    image = CameraImage(camera=camera, rgb=rgb, depth_m=depth, body=nothing, link=nothing, parcel=nothing)
    path = tmp_path / "a.rrd"
    with open_recorder(path, site, cameras=("pick_1",)) as recorder:
        for k, frame in enumerate(frames(4)):
            recorder.record(replace(frame, views={"pick_1": image} if k == 1 else {}))
    assert verify_recording(path).verified
    blobs = rows(path, "/world/cameras/pick_1/depth", "EncodedDepthImage:blob")
    assert list(blobs) == [2]
    stored = np.asarray(Picture.open(io.BytesIO(bytes(blobs[2][0]))))
    assert stored[0, 0] == 0
    np.testing.assert_allclose(stored.ravel()[1:] * 4.0 / 65_535, depth.ravel()[1:], atol=1e-4)
    picture = Picture.open(io.BytesIO(bytes(rows(path, "/world/cameras/pick_1/rgb", "EncodedImage:blob")[2][0])))
    assert picture.size == (40, 30)
    assert "/world/cameras/pick_1" in verify_recording(path).entities


def test_what_is_due_is_written_by_the_thread_of_the_run(
    tmp_path: Path, site: Site, frames: Frames, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two threads that run Python wait for each other."""
    monkeypatch.setattr("fleet.recording.rerun_recorder._BATCH_S", 0.2)
    writers = []
    with open_recorder(tmp_path / "a.rrd", site) as recorder:
        write = recorder._stream.write
        monkeypatch.setattr(
            recorder._stream, "write", lambda *batch: (writers.append(threading.current_thread()), write(*batch))
        )
        begin_s = time.monotonic()
        for frame in frames(120):
            recorder.record(frame)
            time.sleep(0.01)
        waited_s = time.monotonic() - begin_s
    assert 5 <= len(writers) <= 2 + 2 * waited_s / 0.2
    assert writers.count(threading.current_thread()) >= 3
    assert verify_recording(tmp_path / "a.rrd").frames == 120


def test_what_is_due_is_written_while_the_run_is_busy_with_one_tick(tmp_path: Path, site: Site, frames: Frames) -> None:
    with open_recorder(tmp_path / "a.rrd", site) as recorder:
        for frame in frames(5):
            recorder.record(frame)
        recorder.log(LogLine(tick=8, sim_s=0.2, text="it hangs"))
        wait_for(lambda: recorder.n_written == 5, most_s=5.0)
        wait_for(lambda: verify_recording(tmp_path / "a.rrd").frames == 5, most_s=5.0)
        assert "/log" in verify_recording(tmp_path / "a.rrd").entities


def test_a_live_run_drops_and_counts_instead_of_waiting_for_what_blocks(
    tmp_path: Path, site: Site, frames: Frames, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fleet.recording.rerun_recorder._QUEUE_FRAMES", 4)
    monkeypatch.setattr("fleet.recording.rerun_recorder._BATCH_S", 0.0)
    read = threading.Event()
    with open_recorder(tmp_path / "a.rrd", site, port=free_port()) as recorder:
        write = recorder._stream.write
        monkeypatch.setattr(recorder._stream, "write", lambda *batch: (read.wait(), write(*batch)))
        for frame in frames(12):
            recorder.record(frame)
        read.set()
    assert (recorder.n_written, recorder.n_dropped) == (4, 8)
    assert verify_recording(tmp_path / "a.rrd").frames == 4


def test_an_interrupt_amid_writing_loses_nothing(
    tmp_path: Path, site: Site, frames: Frames, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        monkeypatch.undo()
        raise KeyboardInterrupt

    with open_recorder(tmp_path / "a.rrd", site) as recorder:
        first, second, third = frames(3)
        recorder.record(first)
        recorder.record(second)
        monkeypatch.setattr("fleet.recording.rerun_recorder._BATCH_FRAMES", 2)
        monkeypatch.setattr(recorder._stream._bodies, "write", interrupted)
        with pytest.raises(KeyboardInterrupt):
            recorder.record(third)
    assert verify_recording(tmp_path / "a.rrd").frames == 3


def test_the_live_server_listens_on_loopback_only(tmp_path: Path, site: Site) -> None:
    port = free_port()
    with open_recorder(tmp_path / "a.rrd", site, port=port) as recorder:
        assert recorder.uri.startswith(f"rerun+http://127.0.0.1:{port}")
        listening = {line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines()[1:]}
        assert f"0100007F:{port:04X}" in listening
        assert f"00000000:{port:04X}" not in listening


def test_a_port_in_use_is_named(tmp_path: Path, site: Site) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(RecordingError, match=str(port)):
            open_recorder(tmp_path / "a.rrd", site, port=port)


def test_a_path_that_cannot_be_written_is_named(tmp_path: Path, site: Site) -> None:
    with pytest.raises(RecordingError, match="nowhere"):
        open_recorder(tmp_path / "nowhere" / "a.rrd", site)


def test_a_failure_of_the_writer_is_told_at_the_end_and_does_not_block(
    tmp_path: Path, site: Site, frames: Frames, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fleet.recording.rerun_recorder._BATCH_FRAMES", 4)
    recorder = open_recorder(tmp_path / "a.rrd", site)

    def fail(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(recorder._stream, "write", fail)
    for frame in frames(40):
        recorder.record(frame)
    recorder.log(LogLine(tick=0, sim_s=0.0, text="x"))
    with pytest.raises(RecordingError, match="no space left"):
        recorder.close()
    recorder.close()
    assert not any(thread.name == "recorder" for thread in threading.enumerate())


def wait_for(condition: Callable[[], bool], *, most_s: float = 60.0) -> None:
    """Poll, because what happens does so in other threads or processes."""
    end_s = time.monotonic() + most_s
    while not condition():
        assert time.monotonic() < end_s, "it did not happen"
        time.sleep(0.05)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_a_recording_ends_before_the_disk_is_full(
    tmp_path: Path, site: Site, frames: Frames, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, made = tmp_path / "a.rrd", list(frames(60))
    recorder = open_recorder(path, site)
    for frame in made[:30]:
        recorder.record(frame)
    recorder._write()
    monkeypatch.setattr("fleet.recording.output_file.LEAST_FREE_BYTES", 10**18)
    for frame in made[30:]:
        recorder.record(frame)
    with pytest.raises(RecordingError, match=r"is incomplete: .* MB are free on its disk; valid: at least"):
        recorder.close()
    assert list(rows(path, "/world/cars/body", "InstancePoses3D:translations")) == [frame.tick for frame in made[:30]]


def test_strict_mode_is_on_so_that_bad_data_fails_the_tests() -> None:
    assert os.environ["RERUN_STRICT"] == "1"
