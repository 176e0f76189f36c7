"""`fleet diff`: nothing between a run and its repetition, and the tick and the robot where another one parts."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.config import ArmConfig, EstimateConfig, Fidelity, RunConfig, ScenarioEvent, TrafficConfig
from fleet.recording.trace_file import TRACE
from fleet.session import SessionConfig, run_session

PUSHED_S = 6.0


def run(out: Path, *, record: bool = False, **settings: object) -> Path:
    """Run two cars for ten seconds."""
    usual = {"site": "cell", "robots": 2, "tasks": 2, "duration_s": 10.0, "fidelity": Fidelity.KINEMATIC}
    config = RunConfig(**(usual | {"arms": ArmConfig(workers_n=0)} | settings))
    run_session(config, SessionConfig(out=out, record=record, progress=False))
    return out


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the run that others are compared with."""
    return run(tmp_path_factory.mktemp("base") / "a", record=True)


def diff(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit status, output and errors of a comparison."""
    with pytest.raises(SystemExit) as stop:
        main(["diff", *words])
    said = capsys.readouterr()
    return int(str(stop.value.code)), said.out, said.err


def test_the_same_again_has_no_difference(base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    again = run(tmp_path / "b")
    assert (again / TRACE).read_bytes() == (base / TRACE).read_bytes()
    status, said, _ = diff([str(base), str(again), "--out", str(tmp_path / "d.rrd")], capsys)
    assert status == 0
    assert "no difference in 200 ticks (10.0 s)" in said
    assert not (tmp_path / "d.rrd").exists()


def test_a_push_is_found_at_its_tick(base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    push = ScenarioEvent(time_s=PUSHED_S, kind="car_pushed", target="car_1", parameters={"dy_m": 0.05})
    other = run(tmp_path / "b", events=(push,))
    status, said, _ = diff([str(base), str(other), "--no-record"], capsys)
    assert status == 1
    assert "setting events: []" in said
    assert "the same for 120 ticks (6.00 s)" in said
    assert "first difference, tick 120 (6.00 s), event: " in said
    assert "disturbance" in said
    assert "also: car_1 does not stand or move alike" in said
    assert "robots that differ: car_1 from 6.00 s" in said
    assert "state_hash" in said


def test_another_setting_is_named(base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = run(tmp_path / "b", traffic=TrafficConfig(latency_s=0.2), estimate=EstimateConfig(noise_m=0.01))
    status, said, _ = diff([str(base), str(other), "--no-record"], capsys)
    assert status == 1
    assert "setting traffic.latency_s: 0.1 in A, 0.2 in B" in said
    assert said.count("setting ") == 1
    assert "the plan of car_" in said


def test_another_seed_is_a_setting_too(base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, said, _ = diff([str(base), str(run(tmp_path / "b", seed=1)), "--no-record"], capsys)
    assert status == 1
    assert "setting seed: 0 in A, 1 in B" in said


def test_figures_of_single_stations_are_told_if_wanted(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A friction of the first hour: more than thirty rows, most of them of no interest."""
    other = run(tmp_path / "b", seed=1)
    short, long = (diff([str(base), str(other), "--no-record", *more], capsys)[1] for more in ([], ["--all"]))
    assert "state_hash" in short
    assert "stations.pick_1." in long
    assert "│ stations." not in short
    n_left = int(short.splitlines()[-1].split(": ")[1].split()[0])
    assert short.splitlines()[-1] == f"figures of stations and bounds that differ, too: {n_left} (--all)"
    rows = [line for line in long.splitlines() if line.startswith(("│ stations.", "│ bounds.", "│ idle_percent."))]
    assert len(rows) == n_left


def test_fleets_of_other_size_part_at_the_start(base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, said, _ = diff([str(base), str(run(tmp_path / "b", robots=1)), "--no-record"], capsys)
    assert status == 1
    assert "first difference, tick 0 (0.00 s), start: cars: 2 in A, 1 in B" in said


def test_a_run_that_was_cut_off_is_the_same_until_then(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "b"
    shutil.copytree(base, cut)
    (cut / "result.json").unlink()
    (cut / TRACE).write_bytes((cut / TRACE).read_bytes()[:-10])
    lines = (cut / "run.jsonl").read_text(encoding="utf-8").splitlines()
    (cut / "run.jsonl").write_text("\n".join([*lines[:-1], lines[-1][:20]]), encoding="utf-8")
    status, said, _ = diff([str(base), str(cut), "--no-record"], capsys)
    assert status == 1
    assert "end: B ends here and A goes on; it was interrupted" in said


def test_both_are_in_one_recording(base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from rerun.chunk import RrdReader

    other = run(tmp_path / "b", record=True, robots=1)
    out = tmp_path / "both.rrd"
    status, said, _ = diff([str(base), str(other), "--out", str(out)], capsys)
    assert (status, f"recording: {out}" in said) == (1, True)

    def cars(path: Path, entity: str) -> int:
        rows = [chunk for chunk in RrdReader(path).stream() if chunk.entity_path == entity and not chunk.is_static]
        return sum(chunk.num_rows for chunk in rows)

    for root, run_of in (("a", base), ("b", other)):
        assert cars(out, f"/{root}/world/cars/body") == cars(run_of / "recording.rrd", "/world/cars/body") > 0


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_recording_that_was_cut_off_is_there_up_to_then(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from rerun.chunk import RrdReader

    other, out = run(tmp_path / "b", record=True, robots=1), tmp_path / "both.rrd"
    whole = (other / "recording.rrd").read_bytes()
    (other / "recording.rrd").write_bytes(whole[: len(whole) * 9 // 10])
    status, _, err = diff([str(base), str(other), "--out", str(out)], capsys)
    assert (status, err) == (1, "")
    with pytest.raises(RuntimeError):  # inside a message
        list(RrdReader(other / "recording.rrd").stream())
    assert any(str(chunk.entity_path).startswith("/b/world") for chunk in RrdReader(out).stream())


def test_without_a_recording_it_is_said(base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = run(tmp_path / "b", seed=1)
    _, said, _ = diff([str(base), str(other), "--out", str(tmp_path / "d.rrd")], capsys)
    assert f"no recording side by side: there is no {other / 'recording.rrd'}" in said


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (shutil.rmtree, "valid: the --out directory of a run"),
        (lambda run: (run / "run.jsonl").unlink(), "no run in"),
        (lambda run: (run / "run.jsonl").write_bytes(b"\xff\xfe\x00"), "is no text in UTF-8"),
        (lambda run: (run / "run.jsonl").write_text(""), "valid: the object of kind 'run'"),
        (lambda run: (run / "run.jsonl").write_text("[1]\n"), "line 1"),
        (lambda run: (run / "run.jsonl").write_text('{"kind":"run"}\n'), "with config, seed and versions"),
        (
            lambda run: (run / "run.jsonl").write_text('{"kind":"run","config":{},"seed":0,"versions":{}}\n'),
            "config has no site",
        ),
        (lambda run: (run / "result.json").write_text("{"), "result.json: column 2:"),
        (lambda run: (run / "result.json").write_text("[]"), "as one JSON object"),
        (lambda run: (run / TRACE).unlink(), "no trace in"),
        (lambda run: (run / TRACE).write_bytes((run / TRACE).read_bytes()[:40]), "is no trace"),
        (lambda run: (run / TRACE).write_text('{"kind":"trace","version":0}\n'), "version 0"),
        (lambda run: (run / TRACE).write_bytes((run / TRACE).read_bytes().splitlines()[0] + b"\n"), "holds no tick"),
    ],
)
def test_what_is_no_run_is_one_line(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil: object, said: str
) -> None:
    bad = tmp_path / "b"
    shutil.copytree(base, bad)
    spoil(bad)  # type: ignore[operator]
    status, out, err = diff([str(base), str(bad)], capsys)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert said in err


def test_a_run_is_not_compared_with_itself(base: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = diff([str(base), str(base / ".." / base.name)], capsys)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "the same run as A" in err


def test_a_recording_that_is_none_is_one_line(base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = run(tmp_path / "b", seed=1)
    (other / "recording.rrd").write_bytes(b"not a recording")
    status, _, err = diff([str(base), str(other), "--out", str(tmp_path / "d.rrd")], capsys)
    assert (status, err.count("\n")) == (2, 1)
    assert "cannot be read as a recording" in err


def test_a_killed_run_leaves_a_trace(tmp_path: Path) -> None:
    code = f"""
import os
from pathlib import Path
from fleet.config import *
from fleet.session import *
from fleet.simulation import Simulation
tick = Simulation.tick
def dying(self):
    tick(self)
    if self.now == 150:
        os.kill(os.getpid(), 9)
Simulation.tick = dying
config = RunConfig(site="cell", robots=1, fidelity="kinematic", arms=ArmConfig(workers_n=0))
run_session(config, SessionConfig(out=Path({str(tmp_path / "run")!r}), record=False, progress=False))
"""
    done = subprocess.run([sys.executable, "-c", code], check=False, env=dict(os.environ), timeout=300)
    assert done.returncode == -9
    from fleet.report.loaded_run import load_run

    assert load_run(tmp_path / "run").trace.n_ticks == 140
