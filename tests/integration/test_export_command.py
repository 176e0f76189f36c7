"""`fleet export`: a run as ROS 2 messages, read by somebody else, is the run to the last bit."""

import builtins
import math
import shutil
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.cli.main import main
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.recording.rerun_stream.poses import ArmChain
from fleet.recording.run_file import read_run
from fleet.recording.trace_file import TRACE
from fleet.session import SessionConfig, run_session
from fleet.simulation import Simulation

CONFIG = RunConfig(
    site="cell", robots=2, tasks=2, fidelity=Fidelity.KINEMATIC, duration_s=20.0, arms=ArmConfig(workers_n=0)
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run without a recording."""
    out = tmp_path_factory.mktemp("export") / "run"
    run_session(CONFIG, SessionConfig(out=out, record=False, progress=False))
    return out


def messages(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Every message of a file by its topic, with its time, as rosbags reads them."""
    highlevel = pytest.importorskip("rosbags.highlevel", reason="reading back needs the extra interop")
    from rosbags.typesys import Stores, get_typestore

    found = defaultdict(list)
    with highlevel.AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, time_ns, raw in reader.messages():
            found[connection.topic].append((time_ns, reader.deserialize(raw, connection.msgtype)))
    return found


@pytest.fixture(scope="module")
def exported(run: Path) -> dict[str, list[tuple[int, Any]]]:
    """Return what the file of that run holds, every tick of it."""
    pytest.importorskip("mcap", reason="export needs the extra mcap")
    file = run.parent / "run.mcap"
    with pytest.raises(SystemExit) as stop:
        main(["export", str(run), "--mcap", str(file), "--rate-hz", "1000"])
    assert stop.value.code == 0
    assert sorted(path.name for path in run.parent.iterdir()) == ["run", "run.mcap"]
    return messages(file)


@pytest.fixture(scope="module")
def truth() -> list[tuple[float, Any, Any, Any, Any]]:
    """Return where everything was at the start and after every tick, in a run of its own."""
    with Simulation(CONFIG) as simulation:
        world, found = simulation.world, []
        while True:
            state = (world.car_poses(), world.car_speeds(), world.car_steering(), world.arm_positions())
            found.append((simulation.sim_s, *(np.array(values) for values in state)))
            if simulation.finished:
                return found
            simulation.tick()


def stamp_ns(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def pose(position: Any, orientation: Any) -> tuple[float, float, float]:
    """x, y, yaw; all else is that of a body that lies flat."""
    assert (position.z, orientation.x, orientation.y) == (0.0, 0.0, 0.0)
    return position.x, position.y, 2.0 * math.atan2(orientation.z, orientation.w)


def near(one: tuple[float, float, float], other: Any) -> bool:
    x, y, yaw = (a - b for a, b in zip(one, other, strict=True))
    return max(abs(x), abs(y), abs(math.remainder(yaw, math.tau))) <= 1e-9


def test_every_pose_is_that_of_the_run(exported: Any, truth: Any) -> None:
    for car in range(2):
        odometry = exported[f"/car_{car}/odom"]
        assert len(odometry) == len(truth)
        for (time_ns, message), (sim_s, poses, speeds, steering, _) in zip(odometry, truth, strict=True):
            assert time_ns == stamp_ns(message.header.stamp) == round(sim_s * 1e9)
            assert (message.header.frame_id, message.child_frame_id) == ("map", f"car_{car}/base_link")
            assert near(pose(message.pose.pose.position, message.pose.pose.orientation), poses[car])
            assert message.twist.twist.linear.x == speeds[car]
            turning = speeds[car] * math.tan(steering[car]) / 0.325
            assert message.twist.twist.angular.z == pytest.approx(turning, abs=1e-9)


def test_every_frame_is_where_the_run_has_it(exported: Any, truth: Any) -> None:
    with Simulation(CONFIG) as simulation:
        scene = simulation.view.scene
    chain = ArmChain(scene.arms)
    bases = {transform.child_frame_id: transform for transform in exported["/tf_static"][0][1].transforms}
    assert list(bases) == ["arm_0/base", "arm_1/base"]
    for arm, base in enumerate(bases.values()):
        assert base.header.frame_id == "map"
        x, y, _, yaw = scene.arm_base[arm]
        assert near(pose(base.transform.translation, base.transform.rotation), (x, y, yaw))
    assert len(exported["/tf"]) == len(truth)
    for (_, message), (_, poses, _, _, arm_q) in list(zip(exported["/tf"], truth, strict=True))[::7]:
        frames = {transform.child_frame_id: transform for transform in message.transforms}
        assert list(frames) == ["car_0/base_link", "car_1/base_link", "arm_0/flange", "arm_1/flange"]
        for car in range(2):
            moved = frames[f"car_{car}/base_link"].transform
            assert near(pose(moved.translation, moved.rotation), poses[car])
        position, _ = chain.link_poses(np.zeros((2, 4)), arm_q[None])
        for arm in range(2):
            flange = frames[f"arm_{arm}/flange"]
            assert flange.header.frame_id == f"arm_{arm}/base"
            there = flange.transform.translation
            assert np.allclose((there.x, there.y, there.z), position[-1, 0, arm], rtol=0.0, atol=1e-9)


def test_every_joint_is_where_the_run_has_it(exported: Any, truth: Any) -> None:
    for arm in range(2):
        states = exported[f"/arm_{arm}/joint_states"]
        assert states[0][1].name == [f"joint_{k}" for k in range(1, 8)]
        for (_, message), (_, _, _, _, arm_q) in zip(states, truth, strict=True):
            assert np.array_equal(message.position, arm_q[arm])
            assert len(message.velocity) == 7
    assert exported["/car_0/joint_states"][0][1].name == ["left_steer", "right_steer"]


def test_every_event_of_the_run_is_there(exported: Any, run: Path) -> None:
    told = [(event["sim_s"], event["kind"]) for event in read_run(run).events]
    found = [(time_ns / 1e9, message.name) for time_ns, message in exported["/events"]]
    skipped = {"causes", "causes_legend", "run_ended", "first_move"}
    assert found == [(sim_s, kind) for sim_s, kind in told if kind not in skipped]
    assert found


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stop:
        main(words)
    said = capsys.readouterr()
    assert stop.value.code == 2
    assert said.err.count("\n") == 1
    return said.err


def test_a_run_that_is_not_the_same_again_leaves_no_file(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mcap", reason="export needs the extra mcap")
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    content = bytearray((copy / TRACE).read_bytes())
    content[content.index(b"\n") + 9] ^= 1  # in the first digest, behind the header and the sizes of the first block
    (copy / TRACE).write_bytes(content)
    said = refused(["export", str(copy), "--mcap", str(tmp_path / "x.mcap")], capsys)
    assert "the run differs from tick 0 on (0.00 s); valid: " in said
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_without_the_package_one_line_names_the_cure(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import_module = builtins.__import__

    def without_mcap(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith("mcap"):
            raise ImportError(name)
        return import_module(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without_mcap)
    said = refused(["export", str(run), "--mcap", str(tmp_path / "x.mcap")], capsys)
    assert "MCAP needs the package mcap; valid: pip install '.[mcap]'" in said
    assert list(tmp_path.iterdir()) == []
