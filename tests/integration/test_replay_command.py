"""`fleet replay`: a recorded run is the same again, a planted difference is found, what-if parts where it is told."""

import json
import os
import shutil
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fleet.cli.main import main
from fleet.config import ArmConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.recording.run_file import EVENTS, RESULT, read_run
from fleet.recording.trace_file import TRACE, read_trace
from fleet.session import SessionConfig, run_session
from fleet.simulation import Simulation

PUSH = ScenarioEvent(time_s=15.0, kind="car_pushed", target="car_1", parameters={"dy_m": 0.05})
SLOW = ScenarioEvent(time_s=4.0, kind="arm_slow", target="arm_0", parameters={"factor": 0.5, "duration_s": 5.0})
CONFIG = RunConfig(
    robots=4, tasks=12, duration_s=30.0, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0), events=(SLOW, PUSH)
)
TICKS = 600


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the run that is made again; nobody may write in it."""
    out = tmp_path_factory.mktemp("runs") / "recorded"
    run_session(CONFIG, SessionConfig(out=out, record=False, progress=False))
    return out


@pytest.fixture
def run(recorded: Path, tmp_path: Path) -> Path:
    """Return a copy of it that may be spoiled."""
    return shutil.copytree(recorded, tmp_path / "run")


@pytest.fixture
def replay(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Return a function that calls the command: exit status, output, errors."""

    def call(*words: object) -> tuple[int, str, str]:
        capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            main(["replay", *map(str, words)])
        said = capsys.readouterr()
        return int(str(stop.value.code)), said.out, said.err

    return call


def result(run: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((run / RESULT).read_text(encoding="utf-8"))
    return found


def kill(run: Path, n_bytes: int) -> None:
    """Leave of a run what a kill leaves, with so many bytes of its trace fewer."""
    (run / RESULT).unlink()
    (run / TRACE).write_bytes((run / TRACE).read_bytes()[:-n_bytes])
    lines = (run / EVENTS).read_text(encoding="utf-8").splitlines()
    (run / EVENTS).write_text("\n".join([*lines[:-3], lines[-3][:20]]), encoding="utf-8")


# --- again


def test_the_same_run_is_the_same_again(recorded: Path, replay: Callable[..., tuple[int, str, str]]) -> None:
    files = {path.name: path.read_bytes() for path in recorded.iterdir()}
    status, said, _ = replay(recorded / EVENTS)
    assert (status, said) == (0, f"the same run: {TICKS} ticks, hash {result(recorded)['state_hash']}\n")
    assert {path.name: path.read_bytes() for path in recorded.iterdir()} == files


def test_a_killed_run_is_compared_as_far_as_its_trace_goes(
    run: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    kill(run, 10)
    n_ticks = read_trace(run).n_ticks
    assert 500 < n_ticks < TICKS
    status, said, _ = replay(run)
    assert status == 0
    first, second = said.splitlines()
    assert first.startswith(f"the same run: {n_ticks} ticks, hash ")
    assert second == f"it is known up to {n_ticks / 20:.2f} s: the run was killed, or its trace was cut"


def test_a_trace_that_was_cut_is_compared_as_far_as_it_goes(
    run: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    content = (run / TRACE).read_bytes()
    (run / TRACE).write_bytes(content[: len(content) // 2])
    status, said, _ = replay(run)
    assert status == 0
    assert f"the same run: {read_trace(run).n_ticks} ticks" in said
    assert "its trace was cut" in said


def test_an_interrupted_run_ends_where_it_was_interrupted(
    tmp_path: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    class Interrupted(Simulation):
        def tick(self, actions: object = None) -> None:
            super().tick()
            if self.now == 130:
                os.kill(os.getpid(), signal.SIGINT)

    run_session(CONFIG, SessionConfig(out=tmp_path / "run", record=False, progress=False), Interrupted)
    assert result(tmp_path / "run")["interrupted"]
    status, said, _ = replay(tmp_path / "run")
    assert status == 0
    assert said.splitlines()[0].startswith("the same run: 130 ticks")
    assert said.splitlines()[1] == "it is known up to 6.50 s: the run was interrupted"


def first_digest(run: Path) -> int:
    """Where the first digest stands in the trace."""
    return (run / TRACE).read_bytes().index(b"\n") + 1 + 8


@pytest.mark.parametrize("killed", [False, True])
def test_a_byte_of_the_trace_is_found_at_its_tick(
    killed: bool, run: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    content = bytearray((run / TRACE).read_bytes())
    content[first_digest(run) + 8 * 3] ^= 1
    (run / TRACE).write_bytes(content)
    if killed:
        kill(run, 10)
    status, said, _ = replay(run)
    assert status == 1
    assert "the same for 3 ticks (0.15 s)" in said
    assert "no setting differs, nor does a version: other code, or another machine" in said
    assert "first difference, tick 3 (0.15 s), motion: a robot does not stand or move alike" in said


def test_a_byte_of_what_robots_did_is_found_though_digests_are_the_same(
    run: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    trace, content = read_trace(run), bytearray((run / TRACE).read_bytes())
    # The last change in the file is the last row; its value is its last field.
    last = trace.changes[-1]
    content[-4] ^= 1
    (run / TRACE).write_bytes(content)
    status, said, _ = replay(run)
    assert status == 1
    assert f"first difference, tick {last['tick']} " in said


def test_a_setting_that_was_changed_afterwards_is_found(run: Path, replay: Callable[..., tuple[int, str, str]]) -> None:
    text, name = (run / EVENTS).read_text(encoding="utf-8"), read_run(run).name
    assert text.count('"latency_s":0.1,"iterations_n":1000') == 1
    (run / EVENTS).write_text(
        text.replace('"latency_s":0.1,"iterations_n":1000', '"latency_s":0.4,"iterations_n":1000'), encoding="utf-8"
    )
    status, said, err = replay(run)
    assert (status, said) == (2, "")
    assert "run.jsonl and run.trace are of two runs" in err
    # Somebody who mends the names has a run that is not the one of its settings.
    new = read_run(run).name
    for path in (run / TRACE, run / RESULT):
        path.write_bytes(path.read_bytes().replace(name.encode(), new.encode()))
    status, said, _ = replay(run)
    assert status == 1
    assert "first difference, tick " in said
    assert ": the plan of car_" in said


def test_figures_that_were_changed_afterwards_are_found(run: Path, replay: Callable[..., tuple[int, str, str]]) -> None:
    spoiled = result(run) | {"state_hash": "0" * 16}
    (run / RESULT).write_text(json.dumps(spoiled), encoding="utf-8")
    status, said, _ = replay(run)
    assert status == 1
    assert f"no difference in {TICKS} ticks (30.0 s), but other figures" in said
    assert "state_hash" in said


# --- what if


@pytest.mark.parametrize("word", ["allocation.allocator=regret_lns", "traffic.planner=pibt", "traffic.latency_s=0.3"])
def test_another_setting_parts_from_its_moment_on(
    word: str, recorded: Path, tmp_path: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    out = tmp_path / "out"
    status, said, _ = replay(recorded, "--at", 4, "--set", word, "--out", out)
    assert status == 0
    for words in ("as recorded", "what if", "change", "throughput", "contacts between robots", "waiting in lanes"):
        assert words in said
    for name in (EVENTS, TRACE, RESULT):
        assert (out / "recorded" / name).read_bytes() == (recorded / name).read_bytes()
    before, after = read_trace(recorded), read_trace(out / "what_if")
    assert (before.digests[:80] == after.digests[:80]).all()
    assert (before.digests[80:TICKS] != after.digests[80:TICKS]).any()
    kept = json.loads((out / RESULT).read_text(encoding="utf-8"))
    assert (kept["recorded"], kept["what_if"]) == (result(recorded), result(out / "what_if"))
    assert kept["at_s"] == 4.0
    tick = kept["first_difference"]["tick"]
    assert 80 <= tick < TICKS
    assert f"the same for {tick} ticks" in said
    # The other run is a run by itself: it can be made again, too.
    status, said, _ = replay(out / "what_if")
    assert (status, said.startswith("the same run: ")) == (0, True)


def test_events_come_and_go(recorded: Path, tmp_path: Path, replay: Callable[..., tuple[int, str, str]]) -> None:
    out = tmp_path / "out"
    added = ("--add-event", "car_pushed car_0 12 dy_m=0.02", "--add-event", "car_dead car_1 900")
    status, said, _ = replay(recorded, "--at", 10, "--remove-event", 2, *added, "--out", out)
    assert status == 0
    assert "did not happen: car_dead car_1 at 900 s: the run was over before\n" in said
    assert "first difference, tick 240 (12.00 s), event: A: nothing; B: disturbance" in said
    told = [event for event in read_run(out / "what_if").events if event["kind"] == "disturbance"]
    assert [(event["sim_s"], event["target"]) for event in told] == [(4.0, "arm_0"), (12.0, "car_0")]


def test_a_setting_that_is_the_same_changes_nothing(
    recorded: Path, tmp_path: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    words = (
        "--set",
        "allocation.allocator=hungarian",
        "--set",
        "traffic.planner=multi_step_pibt",
        "--set",
        "traffic.period_s=1",
    )
    status, said, _ = replay(recorded, "--at", 5, *words, "--out", tmp_path / "out")
    assert status == 0
    assert f"no difference in {TICKS} ticks (30.0 s)\n" in said


def test_a_killed_run_goes_on_to_its_end_on_both_sides(
    recorded: Path, run: Path, tmp_path: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    kill(run, 10)
    out = tmp_path / "out"
    status, _, _ = replay(run, "--at", 20, "--add-event", "car_dead car_1 22", "--out", out)
    assert status == 0
    again = result(out / "recorded")
    assert {name: again[name] for name in ("state_hash", "tasks_done")} == {
        name: result(recorded)[name] for name in ("state_hash", "tasks_done")
    }


def test_both_recordings_are_in_one(
    recorded: Path, tmp_path: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    from rerun.chunk import RrdReader

    from fleet.recording.check import verify_recording

    out = tmp_path / "out"
    status, said, _ = replay(recorded, "--at", 28, "--add-event", "car_dead car_1 29", "--out", out, "--record")
    assert (status, f"recording: {out / 'recording.rrd'}" in said) == (0, True)
    entities = {str(chunk.entity_path) for chunk in RrdReader(out / "recording.rrd").stream()}
    assert {"/a/world/cars/body", "/b/world/cars/body"} <= entities
    assert verify_recording(out / "recording.rrd").verified


def test_a_run_that_is_not_the_same_until_then_has_no_other_end(
    run: Path, tmp_path: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    content = bytearray((run / TRACE).read_bytes())
    content[first_digest(run) + 8 * 3] ^= 1
    (run / TRACE).write_bytes(content)
    status, said, _ = replay(run, "--at", 5, "--add-event", "car_dead car_1 6", "--out", tmp_path / "out")
    assert status == 1
    assert said.startswith("the run is not the same again, so nothing can be said about another end")
    assert "first difference, tick 3 (0.15 s)" in said
    assert not (tmp_path / "out" / RESULT).exists()


# --- what cannot be


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "allocation.due=1"], "--set does not go without --at; valid: --at TIME --set ..."),
        (["--record"], "--record does not go without --at"),
        (["--at", "5"], "--at does not go alone; valid: with --set, --add-event or --remove-event"),
        (["--at", "-1", "--set", "allocation.due=1"], "--at is -1.0; valid: 0 to 30 (the run as recorded)"),
        (["--at", "31", "--set", "allocation.due=1"], "--at is 31.0; valid: 0 to 30 (the run as recorded)"),
        (["--at", "nan", "--set", "allocation.due=1"], "--at is nan; valid: 0 to 30 (the run as recorded)"),
        (["--at", "5", "--set", "robots=9"], "'robots'; valid: allocation.allocator, "),
        (["--at", "5", "--set", "site=twin"], "'site'; valid: allocation.allocator, "),
        (["--at", "5", "--set", "seed=1"], "'seed'; valid: allocation.allocator, "),
        (["--at", "5", "--set", "fidelity=grid"], "'fidelity'; valid: allocation.allocator, "),
        (["--at", "5", "--set", "allocation.due"], "--set is 'allocation.due'; valid: NAME=VALUE"),
        (["--at", "5", "--set", "traffic.period_s=0"], "traffic.period_s is 0; valid: a number > 0"),
        (["--at", "5", "--set", "allocation.allocator=nobody"], "nobody"),
        (["--at", "5", "--set", "traffic.planner_settings.nothing=1"], "nothing"),
        (["--at", "5", "--add-event", "car_dead car_1"], "valid: 'KIND TARGET TIME_S NAME=VALUE ...'"),
        (["--at", "5", "--add-event", "car_dead car_1 soon"], "time_s is 'soon'; valid: a number"),
        (
            ["--at", "5", "--add-event", "car_lost car_1 9"],
            "kind is 'car_lost' (did you mean car_out?); valid: car_dead, ",
        ),
        (["--at", "5", "--add-event", "car_dead car_9 9"], "target of car_dead is 'car_9'; valid: car_0 to car_3"),
        (["--at", "5", "--add-event", "car_dead car_1 4"], "time of --add-event is 4.0; valid: at least 5"),
        (["--at", "5", "--remove-event", "1"], "--remove-event is 1; valid: 2 (car_pushed car_1 at 15 s)"),
        (["--at", "16", "--remove-event", "2"], "valid: none, there is no event then"),
    ],
)
def test_what_cannot_be_is_one_line_and_leaves_no_files(
    words: list[str], said: str, recorded: Path, tmp_path: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    more = ["--out", str(tmp_path / "out")]
    status, out, err = replay(recorded, *words, *more)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert said in err
    assert not (tmp_path / "out").exists()


def test_a_run_does_not_write_over_itself(run: Path, replay: Callable[..., tuple[int, str, str]]) -> None:
    files = {path.name: path.read_bytes() for path in run.iterdir()}
    for out in (run, run.parent, run / ".." / run.name):
        status, _, err = replay(run, "--at", 5, "--set", "allocation.due=1", "--out", out)
        assert (status, err.count("\n"), "valid: a directory that does not hold the run itself" in err) == (2, 1, True)
    assert {path.name: path.read_bytes() for path in run.iterdir()} == files


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (shutil.rmtree, "valid: the --out directory of a run"),
        (lambda run: (run / TRACE).unlink(), "no trace in"),
        (lambda run: (run / EVENTS).write_text(""), "valid: the object of kind 'run'"),
        (lambda run: (run / "decisions.json").write_text("{}"), "a policy played this run"),
        (lambda run: (run / RESULT).write_text("{}"), "does not fit"),
    ],
)
def test_what_is_no_run_is_one_line(
    spoil: Callable[[Path], object], said: str, run: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    spoil(run)
    status, out, err = replay(run)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert said in err


def test_a_run_whose_settings_are_unknown_is_one_line(
    tmp_path: Path, replay: Callable[..., tuple[int, str, str]]
) -> None:
    run_session(replace(CONFIG, duration_s=2.0), SessionConfig(out=tmp_path, record=False, progress=False))
    text, name = (tmp_path / EVENTS).read_text(encoding="utf-8"), read_run(tmp_path).name
    (tmp_path / EVENTS).write_text(text.replace('"askew":', '"crooked":', 1), encoding="utf-8")
    for path in (tmp_path / TRACE, tmp_path / RESULT):
        path.write_bytes(path.read_bytes().replace(name.encode(), read_run(tmp_path).name.encode()))
    status, out, err = replay(tmp_path)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "run.jsonl, line 1: config has 'crooked'; valid: site, robots, " in err
