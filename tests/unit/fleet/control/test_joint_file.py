"""CSV files of joint motions are read, and what is wrong is named with its line."""

from pathlib import Path

import numpy as np
import pytest

from fleet.control import JointLimits
from fleet.control.joint_file import (
    JointRecording,
    RecordingFileError,
    check_recording,
    read_recording,
)

GOOD = "".join(f"{k / 10},{k / 100},0.5\n" for k in range(6))


def test_a_motion_is_read_with_its_set_points(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    t = np.arange(6) / 10
    np.savetxt(path, np.column_stack([t, np.sin(t), t, t, 2 * t]), delimiter=",")
    recording = read_recording(path, 2)
    assert recording.target is not None
    np.testing.assert_array_equal(recording.t, t)
    np.testing.assert_array_equal(recording.q, np.column_stack([np.sin(t), t]))
    np.testing.assert_array_equal(recording.target, np.column_stack([t, 2 * t]))


@pytest.mark.parametrize("head", ["", "\ufeff", "\ufefftime,q1,q2\n", "time,q1,q2\n", "# the left arm\nt, q1, q2\n"])
def test_names_and_remarks_may_be_there(tmp_path: Path, head: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(head + GOOD, encoding="utf-8")
    recording = read_recording(path, 2)
    assert recording.q.shape == (6, 2)
    assert recording.target is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD + "0.6,1\n", r"line 7: 2 columns; valid: 3 as in the rows above"),
        (GOOD.replace("0.5\n", "0.5,1\n"), r"line 1: 4 columns; valid: 3 \(time, q1 to q2\), or 5"),
        (GOOD + "0.6,nan,1\n", r"line 7: column 2 is 'nan'; valid: a finite number"),
        (GOOD + "0.6,a,1\n", r"line 7: column 2 is 'a'"),
        (GOOD + "0.5,1,1\n", r"line 7: time 0.5 s after 0.5 s; valid: increasing times"),
        ("time,q2,q1\n" + GOOD, r"line 1: column 'q2'; valid: 'q1'"),
        ("0,1,1\n", r"1 rows of numbers; valid: at least 5"),
        ("", r"0 rows of numbers"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RecordingFileError, match=message):
        read_recording(path, 2)


@pytest.mark.parametrize("unit", [1e9, 1e-9])
def test_times_that_are_no_seconds_are_named(unit: float) -> None:
    """Nanoseconds asked for terabytes, and seconds that were divided once more gave figures of nothing."""
    limits = JointLimits(
        lower_rad=np.full(2, -2.0),
        upper_rad=np.full(2, 2.0),
        max_velocity_radps=np.full(2, 9.0),
        max_torque_nm=np.full(2, 9.0),
        braking_radps2=np.full(2, 9.0),
    )
    recording = JointRecording(t=np.arange(6) / 10 * unit, q=np.full((6, 2), 0.5))
    with pytest.raises(RecordingFileError, match=r"the motion lasts .* s; valid: 0.1 to 3600 s"):
        check_recording(Path("a.csv"), recording, limits)


def test_no_file_and_no_text(tmp_path: Path) -> None:
    with pytest.raises(RecordingFileError, match="no such file"):
        read_recording(tmp_path / "none.csv", 2)
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordingFileError, match="not a text file"):
        read_recording(tmp_path / "b.csv", 2)
