"""An arm in the engine under position, velocity and torque control; contacts, distances; calibration."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from fleet.cli.main import main
from fleet.control import computed_torque
from fleet.control.friction_fit import fit_friction
from fleet.control.joint_file import JointRecording
from fleet.world.bullet.bench.bench import ArmBench
from fleet.world.bullet.bench.replay import Drive, MotionReplay, drive_of, open_bench

pytestmark = pytest.mark.bullet

LINK = """<link name="{name}"><inertial><mass value="{mass}"/><origin xyz="0 0 {half}"/><inertia ixx="0.05" iyy="0.05"
izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="0 0 {half}"/><geometry><box
size="0.06 0.06 {long}"/></geometry></collision></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 {z}"/>
<axis xyz="{axis}"/><limit lower="-1.5" upper="1.5" effort="{effort}" velocity="2"/></joint>"""
ARM = (
    '<robot name="two"><link name="base"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
    'iyz="0"/></inertial></link>'
    + LINK.format(name="upper", mass=3, half=0.2, long=0.36)
    + LINK.format(name="fore", mass=2, half=0.15, long=0.26)
    + JOINT.format(name="a", parent="base", child="upper", z=0.3, axis="0 1 0", effort=60)
    + JOINT.format(name="b", parent="upper", child="fore", z=0.4, axis="1 0 0", effort=30)
    + "</robot>"
)
DAMPING, FRICTION = np.array([1.4, 0.9]), np.array([0.8, 0.5])


@pytest.fixture(scope="module")
def urdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "two.urdf"
    path.write_text(ARM, encoding="utf-8")
    return path


@pytest.fixture
def bench(urdf: Path) -> Iterator[ArmBench]:
    opened = open_bench(str(urdf))
    yield opened
    opened.close()


def motion(duration_s: float = 1.3) -> tuple[np.ndarray, np.ndarray]:
    """Set-points that go to and fro, from rest."""
    t = np.arange(0.0, duration_s, 0.01)
    return t, np.column_stack([0.5 * (1 - np.cos(4 * t)), -0.4 * (1 - np.cos(5 * t))])


def test_limits_hold_in_all_three_modes(bench: ArmBench) -> None:
    limits, rng = bench.drive.limits, np.random.default_rng(0)
    commands: dict[str, Callable[[np.ndarray], object]] = {
        "position": lambda sign: bench.drive.position(20 * sign),
        "velocity": lambda sign: bench.drive.velocity(50 * sign),
        "torque": lambda sign: bench.drive.torque(500 * sign),
    }
    for name, command in commands.items():
        for sign in ([1, 1], [1, -1], [-1, -1]):
            bench.drive.place(rng.uniform(-0.5, 0.5, 2))
            for _ in range(480):
                given = command(np.array(sign))
                if given is not None:
                    assert (np.abs(given) <= limits.max_torque_nm).all()
                bench.step()
                q, qd = bench.drive.state()
                assert (np.abs(qd) <= 1.005 * limits.max_velocity_radps).all(), name
                # The engine's own position motors run into an end stop by a milliradian.
                assert (np.abs(q) <= limits.upper_rad + 2e-3).all(), name
            np.testing.assert_allclose(q, limits.upper_rad * sign, atol=5e-3, err_msg=name)


def test_motor_torque_limits_position_control(bench: ArmBench) -> None:
    bench.drive.place([0.0, 0.0])
    wall = bench.add_box((0.12, 0.0, 0.6), (0.05, 0.3, 0.3))
    for _ in range(480):
        bench.drive.position([1.0, 0.0])
        bench.step()
    force = bench.contacts(wall).force_n.sum(axis=0)
    # The joint, 0.3 m up, gives 60 N m, to which the arm's weight adds a little.
    lever = bench.contacts(wall).position_m[:, 2] - 0.3
    moment = float(-(bench.contacts(wall).force_n[:, 0] * lever).sum())
    assert 40.0 < moment < 70.0
    assert force[0] < 0.0  # the wall pushes the arm back


def test_computed_torque_beats_plain_position_control(bench: ArmBench) -> None:
    t, target = motion()
    times = np.arange(0, 300) * bench.step_s
    wanted = np.column_stack([np.interp(times, t, column) for column in target.T])
    wanted = np.vstack([wanted[:1], wanted])

    def rms(act: Callable[[int], object]) -> float:
        bench.drive.place(wanted[1])
        error = []
        for k in range(1, 299):
            act(k)
            bench.step()
            error.append(bench.drive.state()[0] - wanted[k + 1])
        return float(np.sqrt(np.mean(np.square(error))))

    def feed(k: int) -> None:
        now, step_s = bench.drive.sense(), bench.step_s
        acceleration = (wanted[k + 1] - 2 * wanted[k] + wanted[k - 1]) / step_s**2
        rate = (wanted[k] - wanted[k - 1]) / step_s
        torque = computed_torque(now.mass, now.bias, acceleration, wanted[k] - now.q, rate - now.qd, 20.0)
        bench.drive.torque(torque, now)

    plain, computed = rms(lambda k: bench.drive.position(wanted[k + 1])), rms(feed)
    assert plain > 2e-3
    assert computed < 1e-6
    bench.drive.set_friction(DAMPING, np.zeros(2))  # known to the law through `sense`
    assert rms(feed) < 1e-6


def test_distances_and_forces_have_shapes_and_units(bench: ArmBench) -> None:
    bench.drive.place([0.0, 0.0])
    box = bench.add_box((0.13, 0.0, 0.5), (0.05, 0.05, 0.05))
    found = bench.nearest(box, within_m=0.1)
    assert len(found) >= 1
    assert found.position_m.shape == (len(found), 3)
    # The upper arm's face is at x = 0.03, the box's at 0.08.
    assert found.distance_m[0] == pytest.approx(0.05, abs=2e-3)
    np.testing.assert_allclose(found.normal[0], [-1, 0, 0], atol=1e-6)
    assert len(bench.nearest(box, within_m=0.01)) == 0
    assert len(bench.contacts(box)) == 0
    assert bench.contacts(box).force_n.shape == (0, 3)


def recorded(bench: ArmBench, *, noise: float = 1e-5) -> JointRecording:
    t, target = motion()
    plan = JointRecording(t=t, q=target, target=target)
    q = MotionReplay(bench, plan, Drive.TARGETS).run(DAMPING, FRICTION)
    return JointRecording(t=t, q=q + np.random.default_rng(0).normal(0, noise, q.shape), target=target)


def test_the_fit_recovers_the_friction_of_a_driven_arm(bench: ArmBench) -> None:
    """To 5 %, with noise of 0.01 mrad."""
    recording = recorded(bench)
    replay = MotionReplay(bench, recording, drive_of(recording, bench))
    fit = fit_friction(replay.run, recording.q, np.full(2, 0.5), np.full(2, 0.1), most_rounds=8)
    assert (fit.rms_rad < 0.05 * fit.rms_before_rad).all()
    np.testing.assert_allclose(fit.damping, DAMPING, rtol=0.05)
    np.testing.assert_allclose(fit.friction, FRICTION, rtol=0.05)
    assert (fit.damping_sigma < 0.1).all()


def test_the_fit_recovers_the_friction_of_a_released_arm(bench: ArmBench) -> None:
    """From positions alone, to 15 %: a motion that comes to rest by itself."""
    damping, friction = np.array([0.8, 0.2]), np.array([0.3, 0.06])
    t = np.arange(0.0, 0.8, 0.005)
    start = JointRecording(t=t, q=np.array([0.2, -0.3]) + t[:, None] * [1.5, -1.2])
    q = MotionReplay(bench, start, Drive.RELEASED).run(damping, friction)
    recording = JointRecording(t=t, q=q)
    assert drive_of(recording, bench) is Drive.RELEASED
    replay = MotionReplay(bench, recording, Drive.RELEASED)
    fit = fit_friction(replay.run, q, np.full(2, 0.5), np.full(2, 0.1), most_rounds=8)
    assert (fit.rms_rad < 0.1 * fit.rms_before_rad).all()
    np.testing.assert_allclose(fit.damping, damping, rtol=0.15)
    np.testing.assert_allclose(fit.friction, friction, rtol=0.15)


def test_a_driven_motion_without_set_points_is_told_apart(bench: ArmBench) -> None:
    t, target = motion()
    assert drive_of(JointRecording(t=t, q=target), bench) is Drive.FOLLOW


def test_the_command_reports_and_writes(
    bench: ArmBench, urdf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    csv, out = tmp_path / "m.csv", tmp_path / "new" / "fit.json"
    moved = recorded(bench)
    assert moved.target is not None
    np.savetxt(csv, np.column_stack([moved.t, moved.q, moved.target]), "%.9g", ",")
    with pytest.raises(SystemExit) as stop:
        main(["calibrate", str(csv), "--arm", str(urdf), "--out", str(out)])
    assert stop.value.code == 0
    assert "motors: targets" in capsys.readouterr().out
    figures = json.loads(out.read_text(encoding="utf-8"))
    np.testing.assert_allclose(figures["friction_nm"], FRICTION, rtol=0.05)
    assert max(figures["rms_rad"]) < 1e-4


@pytest.mark.slow
def test_the_example_gives_back_the_friction_that_it_was_made_with(
    repository: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Seven joints, noise of 0.1 mrad: damping to 10 %, dry friction to 5 %."""
    out = tmp_path / "fit.json"
    with pytest.raises(SystemExit) as stop:
        main(["calibrate", str(repository / "docs/examples/iiwa_motion.csv"), "--out", str(out)])
    assert stop.value.code == 0
    figures = json.loads(out.read_text(encoding="utf-8"))
    np.testing.assert_allclose(figures["damping_nms_per_rad"], [1.5, 2, 0.8, 1.2, 0.5, 0.3, 0.15], rtol=0.1)
    np.testing.assert_allclose(figures["friction_nm"], [2, 3, 1, 1.5, 0.4, 0.3, 0.1], rtol=0.05)
    assert max(figures["rms_rad"]) < 2e-4 < min(figures["rms_before_rad"])


@pytest.mark.parametrize(
    ("words", "text", "message"),
    [
        ([], "0,0,0\n0.1,0,x\n", "line 2: column 3 is 'x'"),
        ([], "0,0\n", "line 1: 2 columns; valid: 3 (time, q1 to q2)"),
        ([], "0,0,0\n0,0,0\n", "line 2: time 0 s after 0 s"),
        (["--drive", "targets"], "".join(f"{k},0,0\n" for k in range(6)), "the recording has no set-points"),
        (
            [],
            "".join(f"{k / 10},{k},0\n" for k in range(6)),
            "q1 is 2 rad at 0.2 s; valid: -1.5 to 1.5 rad (not degrees)",
        ),
        ([], "".join(f"{k / 10},0,{k // 3}\n" for k in range(6)), "q2 goes from 0 to 1 rad within 0.1 s, at 0.2 s"),
        ([], "".join(f"{k / 10},0,0,0,{90 * k}\n" for k in range(6)), "target2 is 90 rad at 0.1 s"),
        (["--out", "/dev/null/a/b"], "".join(f"{k / 10},0,0\n" for k in range(6)), "--out /dev/null/a/b: "),
        (["--frequency", "0"], "", "--frequency is 0.0; valid: a number > 0"),
    ],
)
def test_bad_input_is_one_line(
    urdf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], text: str, message: str
) -> None:
    csv = tmp_path / "m.csv"
    csv.write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit) as stop:
        main(["calibrate", str(csv), "--arm", str(urdf), *words])
    said = capsys.readouterr()
    assert (stop.value.code, said.err.count("\n")) == (2, 1)
    assert message in said.err


def test_an_unknown_arm_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["calibrate", str(tmp_path / "m.csv"), "--arm", "ur5"])
    assert stop.value.code == 2
    assert "arm 'ur5'; valid: iiwa, panda, xarm, or a .urdf" in capsys.readouterr().err
