"""Traces: equal runs have equal digests, the least change has another, and a file that was cut off is read so far."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fleet.recording import OutputError
from fleet.recording.trace_file import TRACE, UNKNOWN, Quantity, TraceFile, read_trace

ABOUT = {
    "run": "0123456789abcdef",
    "tick_s": 0.05,
    "plan": ("####", "#..#", "####"),
    "cell_m": 1.0,
    "stations": ("pick_1",),
    "places": ("pick_1", "parking_1"),
    "phases": ("idle", "to_pick"),
    "arm_states": ("idle", "moving"),
}
BLOCK_TICKS = 60
Alter = Callable[[int, np.ndarray, np.ndarray], None]


def write(directory: Path, n_ticks: int, alter: Alter = lambda tick, values, motion: None) -> Path:
    """Write two cars that drive on at 1 m/s, and an arm that rests."""
    directory.mkdir()
    values = np.full((len(Quantity), 3), UNKNOWN, dtype=np.int64)
    values[:, :2] = 0
    values[:2, 2] = 0
    motion = np.zeros((3, 4))
    rows = []
    for tick in range(n_ticks):
        motion[:2, 0] = 0.05 * tick
        alter(tick, values, motion)
        rows.append((values.copy(), motion.copy()))
    with TraceFile(directory, n_cars=2, n_arms=1, about=ABOUT) as file:
        for first in range(0, n_ticks, BLOCK_TICKS):
            block = rows[first : first + BLOCK_TICKS]
            file.write(first, np.stack([row[0] for row in block]), np.stack([row[1] for row in block]))
    return directory


def test_a_trace_reads_back(tmp_path: Path) -> None:
    def alter(tick: int, values: np.ndarray, motion: np.ndarray) -> None:
        values[Quantity.CELL, 1] = 5 if tick < 70 else 6
        values[Quantity.GOAL, 0] = 4 * 5 + 3

    trace = read_trace(write(tmp_path / "a", 130, alter))
    assert (trace.n_ticks, trace.n_cars, trace.n_arms, trace.size_m) == (130, 2, 1, (4.0, 3.0))
    assert trace.robots == ("car_0", "car_1", "arm_0")
    ticks, cells = trace.series(1, Quantity.CELL)
    assert (ticks.tolist(), cells.tolist()) == ([0, 70], [5, 6])
    assert trace.words(Quantity.CELL, 1, 6) == "cell (1, 2)"
    assert trace.words(Quantity.GOAL, 0, 4 * 5 + 3) == "cell (1, 1) facing south"
    assert trace.words(Quantity.PHASE, 0, 1) == "to_pick"
    assert trace.words(Quantity.PHASE, 2, 1) == "moving"
    assert trace.words(Quantity.PLACE, 0, 1) == "parking_1"
    assert trace.series(2, Quantity.GOAL)[0].size == 0


def test_the_last_bit_of_one_pose_changes_the_digest_of_its_tick_and_the_mark_of_its_robot(tmp_path: Path) -> None:
    def alter(tick: int, values: np.ndarray, motion: np.ndarray) -> None:
        if tick == 77:
            motion[1, 0] = np.nextafter(motion[1, 0], 9.0)

    a, b = read_trace(write(tmp_path / "a", 100)), read_trace(write(tmp_path / "b", 100, alter))
    assert np.flatnonzero(a.digests != b.digests).tolist() == [77]
    assert np.argwhere(a.marks != b.marks).tolist() == [[77, 1]]


def test_a_negative_zero_is_zero(tmp_path: Path) -> None:
    def alter(tick: int, values: np.ndarray, motion: np.ndarray) -> None:
        motion[0, 1] = -0.0

    a, b = read_trace(write(tmp_path / "a", 3)), read_trace(write(tmp_path / "b", 3, alter))
    assert (a.digests == b.digests).all()


@pytest.mark.parametrize("lost", [1, 200, 1500])
def test_a_trace_that_was_cut_off_is_read_up_to_its_last_whole_second(tmp_path: Path, lost: int) -> None:
    path = write(tmp_path / "a", 3 * BLOCK_TICKS) / TRACE
    whole = read_trace(path.parent)
    path.write_bytes(path.read_bytes()[:-lost])
    cut = read_trace(path.parent)
    assert cut.n_ticks in (BLOCK_TICKS, 2 * BLOCK_TICKS)
    assert (cut.digests == whole.digests[: cut.n_ticks]).all()
    assert cut.changes["tick"].max(initial=0) < cut.n_ticks


def test_the_trace_of_a_run_that_is_killed_in_its_first_second_is_there(tmp_path: Path) -> None:
    with TraceFile(tmp_path, n_cars=2, n_arms=1, about=ABOUT):
        trace = read_trace(tmp_path)
    assert (trace.n_ticks, trace.run) == (0, ABOUT["run"])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\x93NUMPY", "is no trace"),
        (b"", "is no trace"),
        (b"[]\n", "is no trace"),
        (b'{"kind":"trace","version":99}\n', "version 99; valid: .* has version 2"),
        (b'{"kind":"run","version":2}\n', "kind 'run'"),
    ],
)
def test_what_is_no_trace_is_named(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / TRACE).write_bytes(content)
    with pytest.raises(OutputError, match=said):
        read_trace(tmp_path)


def test_a_directory_without_a_trace_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="no trace in"):
        read_trace(tmp_path)
