"""The why command tells from the files of a run what the run itself told, and refuses what it cannot read."""

import json
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.insight.causes import Cause
from fleet.insight.time_table import time_columns
from fleet.session import SessionConfig, run_session
from fleet.simulation import Simulation

CONFIG = RunConfig(fidelity=Fidelity.GRID, robots=5, tasks=8, duration_s=60.0, arms=ArmConfig(workers_n=0))
TIMES_S = (0.0, 5.0, 21.3, 33.35, 60.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of five cars that queue and wait, cut off by its time."""
    out = tmp_path_factory.mktemp("runs") / "five"
    run_session(CONFIG, SessionConfig(out=out, record=False, progress=False))
    return out


def said(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stop:
        main(["why", *words])
    out = capsys.readouterr()
    assert stop.value.code == 0, out
    return out.out


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stop:
        main(["why", *words])
    out = capsys.readouterr()
    assert (stop.value.code, out.out, out.err.count("\n")) == (2, "", 1), out
    return out.err


def test_files_tell_what_the_run_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: `--json` told `"cause": 20`."""
    with Simulation(CONFIG) as simulation:
        simulation.run()
        live = {
            (robot, time_s): simulation.explain(robot, time_s)
            for robot in simulation.codebook.robots
            for time_s in TIMES_S
        }
    assert any(found.waits for found in live.values())
    for (robot, time_s), found in live.items():
        if robot in ("car_1", "arm_0"):
            assert said([robot, str(folder), "--at", str(time_s)], capsys).startswith(f"at {time_s:.2f} s: {found}")
    told = json.loads(said(["car_1", str(folder / "run.jsonl"), "--json"], capsys))
    assert {link["cause"] for link in told["chain"]} <= {cause.name.lower() for cause in Cause}
    assert [link["robot"] for link in told["chain"]] == [link.robot for link in live["car_1", 60.0].chain]


def test_the_time_of_every_robot_is_in_the_result(folder: Path) -> None:
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    columns = time_columns(result)
    assert set(columns["robot"]) == {*(f"car_{k}" for k in range(5)), *(f"arm_{k}" for k in range(4))}
    ticks = round(result["sim_s"] / 0.05)
    assert sum(columns["ticks"]) == 9 * ticks
    for table in result["blame"].values():
        assert sum(table["ticks"]) == 9 * ticks


def test_a_run_that_was_cut_off_can_be_asked(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (folder / "run.jsonl").read_text(encoding="utf-8")
    (tmp_path / "run.jsonl").write_text(text[: len(text) // 2], encoding="utf-8")
    assert said(["car_1", str(tmp_path), "--at", "5"], capsys) == said(["car_1", str(folder), "--at", "5"], capsys)


def test_what_became_of_an_order_is_told_until_a_time(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: of tasks only a running simulation could be asked."""
    events = [json.loads(line) for line in (folder / "run.jsonl").read_text(encoding="utf-8").splitlines()]
    moves = [event for event in events if event["kind"] == "task" and event["task"] == "order_1"]
    assert moves[-1]["state"] == "collected"
    first, *lines = said(["order_1", str(folder)], capsys).splitlines()
    assert first.startswith("at 60.00 s: order_1 has been collected since")
    assert sum(": ".join(line.split(": ")[1:]) in {move["cause"] for move in moves} for line in lines) == len(moves)
    carried = next(move for move in moves if move["state"] == "carried")
    first, second, *lines = said(["order_1", str(folder), "--at", str(carried["sim_s"] + 0.5)], capsys).splitlines()
    assert f"order_1 has been carried by {carried['car']} since {carried['sim_s']:.2f} s" in first
    assert second.startswith(carried["car"])
    assert lines[-1].split("  ")[-1].startswith("carried by")
    facts = json.loads(said(["order_1", str(folder), "--json", "--at", str(carried["sim_s"])], capsys))
    assert (facts["state"], facts["car"], facts["steps"][-1]["state"]) == ("carried", carried["car"], "carried")
    waiting = next(event for event in events if event["kind"] == "task_waits")
    first = said([waiting["task"], str(folder), "--at", str(waiting["sim_s"])], capsys).splitlines()[0]
    assert first.endswith(waiting["cause"])


def test_what_does_not_exist_is_refused(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    valid = "valid: car_0 to car_4, arm_0 to arm_3, or an order such as order_1"
    assert f"WHO is 'car_9'; {valid}" in refused(["car_9", str(folder)], capsys)
    assert "WHO is 'ordr_7' (did you mean order_7?)" in refused(["ordr_7", str(folder)], capsys)
    assert "time is 61 s; valid: 0 to 60 s" in refused(["car_1", str(folder), "--at", "61"], capsys)
    assert "time is -1 s" in refused(["car_1", str(folder), "--at", "-1"], capsys)
    assert "--at is 'noon'; valid: a number" in refused(["car_1", str(folder), "--at", "noon"], capsys)
    assert "FOLDER is missing; valid: WHO FOLDER" in refused(["car_1"], capsys)
    assert "valid: the --out directory of a run" in refused(["car_1", str(tmp_path / "nothing")], capsys)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "valid: the object of kind 'run'"),
        (b"RRF2\x00\x00\xff\xfe\x01", "is no text in UTF-8"),
        (b"[1, 2]\n", "line 1"),
        (b'{"kind":"run","config":{},"seed":0,"versions":{}}\n{"tick":3,"kind":"task"}\n', "tells no causes"),
        (
            b'{"kind":"run","config":{},"seed":0,"versions":{}}\n{"tick":0,"kind":"causes_legend","version":7}\n',
            "causes of version 7; valid: 1",
        ),
    ],
)
def test_what_is_no_run_is_refused(
    content: bytes, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.jsonl").write_bytes(content)
    assert says in refused(["car_0", str(tmp_path)], capsys)
