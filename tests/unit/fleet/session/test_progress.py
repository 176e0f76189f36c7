"""Progress: a bar where there is a terminal, lines where there is none, nothing if not wanted."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.session.progress import Progress
from fleet.simulation import Simulation


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    """Return a run that has begun."""
    config = RunConfig(site="cell", robots=1, fidelity=Fidelity.GRID, arms=ArmConfig(workers_n=0))
    with Simulation(config) as simulation:
        simulation.tick()
        return simulation


def test_plain_lines_off_a_terminal(simulation: Simulation, capsys: pytest.CaptureFixture[str]) -> None:
    with Progress(simulation, shown=True) as progress:
        progress.say("hello [not markup] http://127.0.0.1:9876/proxy")
        progress.look()
        progress.look()
    assert capsys.readouterr().out == (
        "hello [not markup] http://127.0.0.1:9876/proxy\n     0.1 s simulated, 0 of 6 tasks done\n"
    )


def test_nothing_if_not_wanted(simulation: Simulation, capsys: pytest.CaptureFixture[str]) -> None:
    with Progress(simulation, shown=False) as progress:
        progress.say("hello")
        progress.look()
    assert capsys.readouterr().out == ""


def test_a_bar_on_a_terminal(repository: Path, tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    words = ["--fidelity", "grid", "--robots", "1", "--speed", "20", "--duration", "20", "--out", str(tmp_path)]
    process = subprocess.Popen(
        [sys.executable, "-m", "fleet.demo", *words, "--no-record"],
        cwd=repository,
        env=dict(os.environ, TERM="xterm", COLUMNS="100"),
        stdout=theirs,
        stderr=theirs,
    )
    os.close(theirs)
    seen = b""
    try:
        while part := os.read(ours, 4096):
            seen += part
    except OSError:  # the other side has closed
        pass
    os.close(ours)
    assert process.wait(30) == 0
    text = seen.decode()
    assert "━" in text
    assert "0/6 tasks" in text
    assert "tasks done" in text
    assert "s simulated," not in text
