"""Runs that cannot begin: nothing of them is left, and what was there before stays."""

import sys
from pathlib import Path

import pytest

from fleet.config import Fidelity, RunConfig
from fleet.recording import OutputError, output_file
from fleet.recording.rerun_stream.stream import Stream
from fleet.session import runner
from fleet.session.runner import SessionConfig, run_session

CONFIG = RunConfig(site="cell", robots=1, tasks=1, fidelity=Fidelity.GRID)


def session(out: Path, *, record: bool) -> SessionConfig:
    return SessionConfig(out=out, record=record, progress=False)


def test_without_rerun_an_earlier_run_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A friction of the first hour: a run without rerun left files of a run, and took away those of the one before."""
    run_session(CONFIG, session(tmp_path, record=False))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ModuleNotFoundError, match="rerun"):
        run_session(CONFIG, session(tmp_path, record=True))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_disk_that_fills_at_the_start_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bad input of the first hour: a full disk was told in the words of rerun, without a cure, and files were left."""

    def full(*_: object) -> None:
        monkeypatch.setattr(output_file, "LEAST_FREE_BYTES", 10**18)
        raise RuntimeError("Failed to encode LogMsg: No space left on device (os error 28)")

    monkeypatch.setattr(Stream, "__init__", full)
    told = r"MB are free on its disk; valid: at least .* or another directory \(--out\)$"
    with pytest.raises(OutputError, match=told):
        run_session(CONFIG, session(tmp_path / "out", record=True))
    assert list((tmp_path / "out").iterdir()) == []


def test_a_trace_that_cannot_be_opened_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OutputError("no trace; valid: another directory")

    monkeypatch.setattr(runner, "Tracer", refuse)
    with pytest.raises(OutputError, match="no trace"):
        run_session(CONFIG, session(tmp_path / "out", record=False))
    assert list((tmp_path / "out").iterdir()) == []
