"""The files beside a recording: written at once, replaced as a whole, refused before anything runs."""

import json
import math
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np
import pytest

from fleet.recording import OutputError, RunFile, output_file, prepare_output, read_run


class Grip(StrEnum):
    SUCTION = "suction"


@dataclass(frozen=True, kw_only=True)
class Settings:
    grip: Grip = Grip.SUCTION
    orders: Path = Path("a/b.csv")
    tune: dict[str, float] = field(default_factory=lambda: {"speed": math.inf})


def test_a_run_reads_back_as_written(tmp_path: Path) -> None:
    with RunFile(tmp_path, config=Settings(), seed=7) as run:
        run.event(12, 0.2, "task", name="order_1", slots=np.array([1, 2]), cost=np.float64(0.5))
        run.result({"tasks_done": np.int64(3), "min_clearance_m": math.nan})
    record = read_run(tmp_path)
    assert record.config == {"grip": "suction", "orders": "a/b.csv", "tune": {"speed": None}}
    assert record.seed == 7
    assert {"python", "numpy", "pybullet", "rerun-sdk"} <= set(record.versions)
    assert record.events == (
        {"tick": 12, "sim_s": 0.2, "kind": "task", "name": "order_1", "slots": [1, 2], "cost": 0.5},
    )
    assert record.result == {"tasks_done": 3, "min_clearance_m": None}


def test_events_are_on_disk_at_once(tmp_path: Path) -> None:
    with RunFile(tmp_path, config={}, seed=0) as run:
        run.event(1, 0.1, "started")
        assert len((tmp_path / "run.jsonl").read_text().splitlines()) == 2
        assert read_run(tmp_path).result is None


def test_half_a_last_line_is_skipped_but_a_broken_one_before_is_named(tmp_path: Path) -> None:
    with RunFile(tmp_path, config={}, seed=0) as run:
        run.event(1, 0.1, "started")
    path = tmp_path / "run.jsonl"
    whole = path.read_text()
    path.write_text(whole + '{"tick": 2, "si')
    assert len(read_run(tmp_path).events) == 1
    path.write_text(whole + "nonsense\n" + json.dumps({"tick": 3}) + "\n")
    with pytest.raises(OutputError, match="line 3"):
        read_run(tmp_path)


def test_a_run_without_a_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="no run in"):
        read_run(tmp_path / "nowhere")


def test_preparing_creates_the_directory_and_removes_an_earlier_run(tmp_path: Path) -> None:
    directory = prepare_output(tmp_path / "runs" / "demo")
    for name in ("recording.rrd", "run.jsonl", "result.json", "notes.txt"):
        (directory / name).write_text("old")
    prepare_output(directory)
    assert [path.name for path in directory.iterdir()] == ["notes.txt"]


def test_a_path_through_a_file_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match=r"--out .*file.*Not a directory"):
        prepare_output(tmp_path / "file" / "runs")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_an_occupied_name_is_refused_before_anything_is_removed(tmp_path: Path) -> None:
    (tmp_path / "run.jsonl").write_text("old")
    (tmp_path / "recording.rrd").mkdir()
    with pytest.raises(OutputError, match=r"recording\.rrd is a directory"):
        prepare_output(tmp_path)
    assert (tmp_path / "run.jsonl").read_text() == "old"


def test_a_disk_without_room_is_named_before_anything_is_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = tmp_path / "run.jsonl"
    old.write_text("of an earlier run")
    monkeypatch.setattr(output_file, "LEAST_FREE_BYTES", 10**18)
    with pytest.raises(OutputError, match=r"MB are free on its disk; valid: at least 1000000000000 MB, or another"):
        prepare_output(tmp_path)
    with pytest.raises(OutputError, match=r"MB are free"):
        prepare_output(tmp_path / "new" / "run")
    assert [path.name for path in tmp_path.iterdir()] == ["run.jsonl"]
    assert old.read_text() == "of an earlier run"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_disk_that_becomes_full_is_named(tmp_path: Path) -> None:
    with RunFile(tmp_path, config={}, seed=0) as run:
        run._file.close()
        run._file = Path("/dev/full").open("wb", buffering=0)  # noqa: SIM115 - the run closes it
        with pytest.raises(OutputError, match=r"full: No space left on device; valid: room on its disk, or another"):
            run.event(1, 0.1, "started")
