"""Runs that are killed, and planning processes that are: nothing is lost; and what watches that can itself fail."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.reliability.killed_runs import Found, Killed, Moment, judge, kill_at
from benchmarks.reliability.one_hash import play
from fleet.recording import RECORDING
from fleet.recording.run_file import EVENTS
from fleet.recording.trace_file import TRACE, read_trace

WORDS = "--site cell --robots 1 --fidelity grid --tasks 6"


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Killed:
    """Return a run that was killed; nobody may write in its folder."""
    run = kill_at(tmp_path_factory.mktemp("runs") / "run", WORDS, Moment(n_ticks=300, then_s=0.0))
    assert run is not None
    return run


@pytest.fixture
def run(killed: Killed, tmp_path: Path) -> Killed:
    """Return it with a folder that may be spoiled."""
    return replace(killed, out=shutil.copytree(killed.out, tmp_path / "run"))


def test_a_killed_run_is_read_mended_and_replayed(run: Killed) -> None:
    found = Found()
    judge(run, found)
    assert (found.killed, found.replayed, found.before_files) == (1, 1, 0)
    assert (found.unreadable, found.refused, found.not_replayed) == ([], [], [])
    assert (len(found.lost_wall_s), found.lost_sim_s[0] <= 0.5) == (1, True)


def test_what_is_spoiled_is_found(run: Killed) -> None:
    trace = bytearray((run.out / TRACE).read_bytes())
    trace[trace.index(b"\n") + 20] ^= 1  # a digest
    (run.out / TRACE).write_bytes(trace[: len(trace) // 2])
    (run.out / RECORDING).write_bytes(b"")
    (run.out / "other.txt").write_text("")
    found = Found()
    judge(run, found)
    assert ["other.txt" in found.unreadable[0], RECORDING in found.unreadable[1]] == [True, True]
    assert found.lost_sim_s[0] > 0.5
    assert (found.replayed, len(found.not_replayed)) == (0, 1)
    assert "status 1" in found.not_replayed[0]


def test_a_run_without_a_tick_is_refused_in_words(run: Killed) -> None:
    head = (run.out / TRACE).read_bytes().partition(b"\n")[0]
    (run.out / TRACE).write_bytes(head + b"\n")
    assert read_trace(run.out).n_ticks == 0
    found = Found()
    judge(run, found)
    assert (found.replayed, found.not_replayed, len(found.refused)) == (0, [], 1)
    # What cannot be read of a run that had ticked is no such run.
    (run.out / EVENTS).write_text("")
    judge(run, found)
    assert EVENTS in found.unreadable[0]


def test_a_run_whose_planning_process_is_killed_is_the_same(tmp_path: Path) -> None:
    disturbed, undisturbed = play(tmp_path / "a", 6.0, [1.0]), play(tmp_path / "b", 6.0, [])
    assert disturbed.killed == 1  # it is started again when there is something to plan, which may be never
    assert (undisturbed.killed, undisturbed.started_again) == (0, 0)
    assert disturbed.state_hash == undisturbed.state_hash != ""
    assert disturbed.trace_hash == undisturbed.trace_hash != ""
