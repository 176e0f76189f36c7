"""However a run ends, its files can be read and nobody is left behind."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fleet.recording import read_run
from fleet.recording.check import verify_recording
from fleet.terminal.compilation import NOTICE

PROC = Path("/proc")
pytestmark = pytest.mark.skipif(not PROC.is_dir(), reason="looks processes up in /proc")

Start = Callable[..., subprocess.Popen[str]]


def wait_for(what: Callable[[], object], timeout_s: float) -> bool:
    """Poll until `what` is true; False if it does not become so."""
    end = time.monotonic() + timeout_s
    while not what():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def children(pid: int) -> set[int]:
    found = set()
    for stat in PROC.glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text(encoding="utf-8").rpartition(")")[2].split()[1])
        except (OSError, IndexError):
            continue
        if parent == pid:
            found.add(int(stat.parent.name))
    return found


def alive(pid: int) -> bool:
    try:
        state = (PROC / str(pid) / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


@pytest.fixture
def start(repository: Path, tmp_path: Path) -> Iterator[Start]:
    """Start the demo with its files in `tmp_path`, and wait until the first car moves."""
    running: list[subprocess.Popen[str]] = []

    def begin(*words: str, until: str = "first_move") -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "fleet.demo", "--out", str(tmp_path), *words],
            cwd=repository,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        running.append(process)
        events = tmp_path / "run.jsonl"
        assert wait_for(lambda: events.is_file() and until in events.read_text(encoding="utf-8"), 90.0)
        return process

    yield begin
    for process in running:
        if process.poll() is None:
            process.kill()
        process.communicate()


def check_files(out: Path) -> None:
    """Look for what an interrupted run must leave behind."""
    run = read_run(out)
    assert run.result is not None
    assert run.result["interrupted"] is True
    assert run.result["parcel_balance"] == 0
    assert 0 < run.result["sim_s"] < 3600
    report = verify_recording(out / "recording.rrd")
    assert report.verified, report.note
    assert report.last_sim_s == pytest.approx(run.result["sim_s"], abs=0.2)


@pytest.mark.bullet
def test_ctrl_c_in_a_physical_run(start: Start, tmp_path: Path) -> None:
    process = start("--robots", "2", "--speed", "1")
    workers = children(process.pid)
    assert len(workers) == 1
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert err.replace(f"{NOTICE}\n", "") == ""
    assert "interrupted" in out
    assert not any(alive(pid) for pid in workers)
    check_files(tmp_path)


def test_sigterm_in_a_run_that_is_served_on_the_loopback_interface_only(start: Start, tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    process = start("--fidelity", "kinematic", "--speed", "1", "--serve", "--port", str(port))
    listening = []
    for table in ("tcp", "tcp6"):
        for line in (PROC / "net" / table).read_text(encoding="utf-8").splitlines()[1:]:
            address, number = line.split()[1].split(":")
            if int(number, 16) == port and line.split()[3] == "0A":
                listening.append(address)
    assert listening == ["0100007F"]
    workers = children(process.pid)
    process.terminate()
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert err.replace(f"{NOTICE}\n", "") == ""
    assert f"127.0.0.1:{port}" in out
    assert not any(alive(pid) for pid in workers)
    check_files(tmp_path)


def test_a_killed_run(start: Start, tmp_path: Path) -> None:
    process = start("--fidelity", "kinematic", "--speed", "2", until='"state":"loading"')
    workers = children(process.pid)
    assert len(workers) == 1
    process.kill()
    process.wait(10)
    run = read_run(tmp_path)
    assert run.result is None
    assert any(event["kind"] == "first_move" for event in run.events)
    report = verify_recording(tmp_path / "recording.rrd")
    assert report.frames > 30
    assert not report.missing("/world/cars", "/world/arms", "/world/parcels")
    assert wait_for(lambda: not any(alive(pid) for pid in workers), 10.0)


def test_ctrl_c_before_anything_is_written(repository: Path, tmp_path: Path) -> None:
    """The setting up takes seconds; an interrupt in it ends at once and leaves neither files nor a process."""
    process = subprocess.Popen(
        [sys.executable, "-m", "fleet.demo", "--out", str(tmp_path / "new"), "--fidelity", "kinematic"],
        cwd=repository,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    workers: set[int] = set()
    assert wait_for(lambda: workers.update(children(process.pid)) or workers, 60.0)
    os.kill(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (130, "")
    assert err.replace(f"{NOTICE}\n", "") == "python -m fleet.demo: interrupted\n"
    assert wait_for(lambda: not any(alive(pid) for pid in workers), 10.0)
    assert not (tmp_path / "new").exists()


def test_output_that_nobody_reads_is_no_error(repository: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "fleet", "site", "list"],
        cwd=repository,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    with process.stderr as stderr:
        assert stderr.read() == ""
    assert process.wait(30) == 0
